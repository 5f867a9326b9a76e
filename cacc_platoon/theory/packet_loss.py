"""What packet loss leaves of the communicated acceleration, in the mean.

Where a lost packet counts as zero, the lower end of I falls to ``p (1 - 1/rho) k_a`` and every
guarantee takes that as `reception`. A receiver that holds the last packet filters instead
(docs/theory.md, section 11 (Extensions)).
"""

from __future__ import annotations

import cmath
from typing import TYPE_CHECKING

from cacc_platoon.theory.errors import require, require_positive
from cacc_platoon.theory.exact import is_robustly_string_stable
from cacc_platoon.theory.noise_interval import EffectiveInterval, effective_interval
from cacc_platoon.theory.region import minimum_headway

if TYPE_CHECKING:
    from cacc_platoon.model.control import Gains

__all__ = [
    "fallback_headway",
    "hold_last_response",
    "is_reception_string_stable",
    "reception_interval",
    "reception_minimum_headway",
]


def reception_interval(k_a: float, rho: float, reception: float) -> EffectiveInterval:
    """Interval of ``k`` when at least a share `reception` of the packets arrives, losses as zero.

    Raises
    ------
    DesignError
        If `reception` is not a probability.

    Examples
    --------
    >>> reception_interval(0.5, 5.0, reception=0.5)
    EffectiveInterval(low=0.2, high=0.6)
    """
    return effective_interval(k_a, rho, reception=reception)


def is_reception_string_stable(gains: Gains, rho: float, tau_max: float, reception: float) -> bool:
    """Robust string stability of the mean system for every reception in ``[reception, 1]``.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> is_reception_string_stable(Gains(1.1, 0.5, 0.62, 0.05), 5.0, 0.5, reception=0.9)
    True
    """
    return is_robustly_string_stable(gains, rho, tau_max, reception=reception)


def reception_minimum_headway(k_a: float, rho: float, tau_max: float, reception: float) -> float:
    """Exact minimum headway ``2 tau_0/(1 + p m k_a)`` [s] at packet reception probability ``p``.

    Examples
    --------
    >>> reception_minimum_headway(0.5, 5.0, 0.5, reception=0.0) == fallback_headway(0.5)
    True
    """
    return minimum_headway(k_a, rho, tau_max, reception=reception)


def fallback_headway(tau_max: float) -> float:
    """Headway ``2 tau_0`` [s] to open up to when V2V is lost altogether (``k_a = 0``).

    Examples
    --------
    >>> fallback_headway(0.5)
    1.0
    """
    require_positive("tau_max", tau_max, "s")
    return 2.0 * tau_max


def hold_last_response(reception: float, period: float, omega: float) -> complex:
    """Mean feed-forward filter ``p/(1 - (1 - p) z^-1)`` of a receiver that holds the last packet.

    Parameters
    ----------
    reception : float
        Packet reception probability, > 0.
    period : float
        Packet period [s].
    omega : float
        Frequency [rad/s].

    Returns
    -------
    complex
        Response at ``z = exp(j omega T)``; it multiplies ``k`` in ``N``.

    Examples
    --------
    >>> hold_last_response(0.5, 0.1, omega=0.0)
    (1+0j)
    """
    require(
        0 < reception <= 1,
        f"reception = {reception:g} is outside (0, 1]: with no packet there is nothing to hold. "
        "Give a positive packet reception probability.",
    )
    return reception / (1.0 - (1.0 - reception) * cmath.exp(-1j * omega * period))
