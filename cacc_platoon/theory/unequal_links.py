"""Platoons whose links differ: lags tau_i, mean noise E[w_i] or gains of their own.

``delta_i = H delta_{i-1}`` needs equal links. The true accelerations always obey
``a_i = H_i a_{i-1}`` with ``H_i = (k_i s^2 + k_v s + k_p)/D_i``: a mixed platoon is certified on
accelerations, link by link (docs/theory.md, section 10 (Unequal vehicles and links)).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.theory.errors import require
from cacc_platoon.theory.exact import is_string_stable, l2_gain
from cacc_platoon.theory.noise_interval import effective_interval
from cacc_platoon.theory.transfer import frequency_response, poles

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cacc_platoon.model.control import Gains

__all__ = ["ChainCertificate", "Hop", "certify_chain", "slow_error_ratio"]


class Hop(NamedTuple):
    """One follower: its controller, lag [s] and effective gain ``k_a E[w_i]``."""

    gains: Gains
    tau: float
    k_effective: float


class ChainCertificate(NamedTuple):
    """What holds for a platoon with unequal links.

    Attributes
    ----------
    string_stable : bool
        Every ``sup |H_i| <= 1``: the energy of ``a_i`` does not grow at any hop.
    hop_gains : tuple of float
        ``sup |H_i|`` per link.
    end_to_end_gain : float
        ``sup |H_1 ... H_N|``; may be 1 although a link amplifies.
    weakest : int
        Number (from 1) of the link with the largest gain.
    """

    string_stable: bool
    hop_gains: tuple[float, ...]
    end_to_end_gain: float
    weakest: int


def slow_error_ratio(gains: Gains, rho: float) -> float:
    """Factor by which one hop may multiply slow spacing errors where ``E[w_i]`` differ.

    ``Phi_i(0)/Phi_{i-1}(0) = (M k_a + h_w k_v - 1)/(m k_a + h_w k_v - 1)``; it exceeds one for
    every design, although the accelerations do not grow. Where the two have opposite signs some
    pair of means within I makes it infinite.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> round(slow_error_ratio(Gains(0.95, 0.5, 0.63, 0.009), 5.0), 6)
    -132.333333
    """
    low, high = effective_interval(gains.k_a, rho)
    rest = gains.time_headway * gains.k_v - 1.0
    smallest = low + rest
    return (high + rest) / smallest if abs(smallest) > 1e-12 else math.inf


def certify_chain(links: Sequence[Hop]) -> ChainCertificate:
    """Certify ``a_i = H_i a_{i-1}`` for every link and end to end.

    Parameters
    ----------
    links : sequence of Hop
        Followers 1 to N.

    Returns
    -------
    ChainCertificate
        Exact per link; the end-to-end gain is a maximum over a frequency grid.

    Raises
    ------
    DesignError
        If there are no links or a lag is not positive.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> gains = Gains(0.95, 0.5, 0.63, 0.009)
    >>> certify_chain([Hop(gains, 0.5, 0.52), Hop(gains, 0.3, 0.3)]).string_stable
    False
    """
    require(len(links) > 0, "links is empty: a platoon needs a follower. Give one Hop or more.")
    hops = [l2_gain(*link) for link in links]
    total = math.inf
    if all(math.isfinite(hop.gain) for hop in hops):
        rates = np.abs(np.concatenate([poles(link.gains, link.tau) for link in links]))
        omega = np.geomspace(1e-3 * rates.min(), 1e2 * rates.max(), 4000)
        omega = np.concatenate(([0.0], omega, [hop.peak_omega for hop in hops]))
        response = np.prod([np.abs(frequency_response(*link, omega)) for link in links], axis=0)
        total = max(1.0, float(np.max(response)))
    gains = tuple(hop.gain for hop in hops)
    return ChainCertificate(
        all(is_string_stable(*link) for link in links), gains, total, int(np.argmax(gains)) + 1
    )
