"""Headway for noise that is drawn once per link: how likely a link amplifies, and what that allows.

A link whose factor never changes has one effective gain ``k = k_a w``. The gains that are string
stable at a headway are an interval (`stable_gain_range`), which grows with the headway: ``C`` and
``B + 2 tau sqrt(C)`` both do. Of n-bit noise, whose law is known to the last atom, the probability
to fall outside it is a sum over digits, and the least headway with at most a given one is found by
bisection (docs/theory.md, section 8 (Mean square)).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from cacc_platoon.model.noise import MAX_BITS
from cacc_platoon.theory.errors import DesignError, require, require_positive, require_rho
from cacc_platoon.theory.region import stable_gain_range

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cacc_platoon.model.control import Gains

__all__ = ["amplifying_probability", "chance_constrained_headway", "factor_below"]

_LONGEST = 1e3
"""Headway in largest lags up to which is searched."""
_PRECISION = 1e-9
_ROUNDING = 1e-12


def factor_below(rho: float, bit_probabilities: Sequence[float], limit: float) -> float:
    """Probability that a draw of the channel is below a limit, ``P(w < limit)``, exactly.

    Parameters
    ----------
    rho : float
        Linear signal-to-noise ratio, > 1.
    bit_probabilities : sequence of float
        ``P(z_j = 1)``, the most significant bit first.
    limit : float
        Of the factor w.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> factor_below(5.0, [0.5] * 16, 1.0)
    0.5
    """
    _require_channel(rho, bit_probabilities)
    if math.isinf(rho):
        return float(limit > 1.0)
    bits = len(bit_probabilities)
    code = math.ceil((limit - 1.0 + 1.0 / rho) * rho * 2.0 ** (bits - 1) - _ROUNDING * 2.0**bits)
    if code <= 0:
        return 0.0
    if code >= 2**bits:
        return 1.0
    below, equal = 0.0, 1.0
    for j, chance in enumerate(bit_probabilities):
        if code >> (bits - 1 - j) & 1:
            below += equal * (1.0 - chance)
            equal *= chance
        else:
            equal *= 1.0 - chance
    return below


def amplifying_probability(
    gains: Gains,
    rho: float,
    tau_max: float,
    bit_probabilities: Sequence[float],
    *,
    links: int = 1,
) -> float:
    """Probability that a link amplifies whose noise is drawn once, or any of several links.

    Parameters
    ----------
    gains : Gains
        Controller.
    rho, tau_max, bit_probabilities
        Signal-to-noise ratio, largest lag [s], and the channel as in `factor_below`.
    links : int, optional
        Number of links with draws of their own.

    Returns
    -------
    float
        ``P(sup|H| > 1)``, at the worst lag up to `tau_max`.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> amplifying_probability(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5, [0.5] * 16)
    0.0
    """
    _require_channel(rho, bit_probabilities)
    require(links >= 1, f"links = {links} is no number of links. Give 1 or more.")
    if gains.k_a == 0.0:
        return 0.0 if stable_gain_range(gains, tau_max) is not None else 1.0
    stable = stable_gain_range(gains, tau_max)
    if stable is None:
        return 1.0
    low, high = (k / gains.k_a for k in stable)
    above = math.nextafter(high, math.inf) + 2.0 * _ROUNDING
    one = factor_below(rho, bit_probabilities, low)
    one += 1.0 - factor_below(rho, bit_probabilities, above)
    return -math.expm1(links * math.log1p(-one)) if one < 1.0 else 1.0


def chance_constrained_headway(
    gains: Gains,
    rho: float,
    tau_max: float,
    bit_probabilities: Sequence[float],
    probability: float,
    *,
    links: int = 1,
) -> float:
    """Least headway [s] at which a link, or any of several, amplifies with at most a probability.

    Parameters
    ----------
    gains : Gains
        Controller; its headway is not used.
    rho, tau_max, bit_probabilities, links
        As in `amplifying_probability`.
    probability : float
        From 0, for every factor the channel may draw, to below 1.

    Raises
    ------
    DesignError
        If a value is out of its range, or no headway is long enough for these gains.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> A = Gains(0.95, 0.5, 0.63, 0.009)
    >>> fair = [0.5] * 16
    >>> [round(chance_constrained_headway(A, 5.0, 0.5, fair, p), 4) for p in (0.01, 0.0)]
    [0.9429, 0.946]
    """
    require_positive("tau_max", tau_max, "s")
    require(
        0.0 <= probability < 1.0,
        f"probability = {probability:g} is not from 0 to below 1: no headway is asked for. Give "
        "the share of links that may amplify.",
    )

    def enough(headway: float) -> bool:
        asked = gains._replace(time_headway=headway)
        found = amplifying_probability(asked, rho, tau_max, bit_probabilities, links=links)
        return found <= probability

    low, high = 0.0, tau_max
    while not enough(high):
        low, high = high, min(2.0 * high, _LONGEST * tau_max)
        if low == high:
            raise DesignError(
                f"no headway up to {_LONGEST * tau_max:g} s lets at most {probability:g} of the "
                f"links amplify with k_a = {gains.k_a:g}, k_v = {gains.k_v:g}, k_p = "
                f"{gains.k_p:g}: their effective gain may reach 1. Lower k_a or raise rho."
            )
    while high - low > _PRECISION * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


def _require_channel(rho: float, bit_probabilities: Sequence[float]) -> None:
    require_rho(rho)
    require(
        1 <= len(bit_probabilities) <= MAX_BITS and all(0.0 <= p <= 1.0 for p in bit_probabilities),
        f"bit_probabilities = {list(bit_probabilities)[:4]} ... are not 1 to {MAX_BITS} "
        "probabilities: the channel has no such draw. Give values from 0 to 1.",
    )
