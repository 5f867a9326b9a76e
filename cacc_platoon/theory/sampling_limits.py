"""How slowly a loop may be sampled, and how many packets a receiver that holds may lose.

Both are first losses of string stability in a numerical search
(docs/theory.md, section 6 (Sampling) and section 11 (Extensions)).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.theory.exact import is_string_stable
from cacc_platoon.theory.noise_interval import effective_gains
from cacc_platoon.theory.sampled import (
    is_sampled_string_stable,
    lags_to_try,
    require_held,
    stable_at,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cacc_platoon.model.control import Gains

    Float = NDArray[np.float64]

__all__ = ["critical_loss", "critical_period"]


def critical_period(
    gains: Gains,
    rho: float,
    tau_max: float,
    *,
    stale: bool = False,
    held: float = 1.0,
    reception: float = 1.0,
    k_effective: float | None = None,
) -> float:
    """Period at which robust string stability is first lost [s]; 0 when no period keeps it.

    No sampled loop without lag survives ``T >= 2/gamma``, which bounds the search.

    Parameters
    ----------
    gains, rho, tau_max, stale, held, reception, k_effective
        As in `is_sampled_string_stable`.

    Returns
    -------
    float
        Critical period [s], to a relative 1e-6.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> round(critical_period(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5), 4)
    0.0959
    >>> round(critical_period(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5, held=0.5), 4)
    0.0444
    """
    require_held(held, stale=stale)
    lags = lags_to_try(tau_max, k_effective)
    ends = effective_gains(gains.k_a, rho, reception=reception, k_effective=k_effective)
    if not all(is_string_stable(gains, tau_max, k) for k in ends):
        return 0.0
    longest = 8.0 / (gains.k_v + gains.time_headway * gains.k_p) + 8.0 * tau_max
    return _first_lost(
        lambda periods: stable_at(gains, ends, lags, periods, stale=stale, held=held),
        longest,
        1e-9 * tau_max,
    )


def critical_loss(
    gains: Gains,
    rho: float,
    tau_max: float,
    period: float,
    *,
    reception: float = 1.0,
    k_effective: float | None = None,
) -> float:
    """Share of lost packets at which a receiver that holds the last one first loses stability.

    Parameters
    ----------
    gains, rho, tau_max, period, reception, k_effective
        As in `is_sampled_string_stable`.

    Returns
    -------
    float
        Critical share ``1 - p`` at this period, to a relative 1e-6; 0 when none may be lost or
        the loop without loss is not string stable, 1 when all may.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> round(critical_loss(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5, 0.01), 3)
    0.881
    """
    if not is_sampled_string_stable(
        gains, rho, tau_max, period, reception=reception, k_effective=k_effective
    ):
        return 0.0
    lags = lags_to_try(tau_max, k_effective)
    ends = effective_gains(gains.k_a, rho, reception=reception, k_effective=k_effective)
    at = np.array([period])
    return _first_lost(
        lambda losses: stable_at(gains, ends, lags, at, stale=False, held=1.0 - losses), 1.0, 1e-9
    )


def _first_lost(
    holds: Callable[[Float], NDArray[np.bool_]], largest: float, smallest: float
) -> float:
    """Search (0, largest] for where `holds` first fails; 0 where that is below `smallest`."""
    low, high = 0.0, largest
    while high - low > 1e-7 * high:
        values = np.linspace(low, high, 33)[1:]
        lost = np.flatnonzero(~holds(values))
        if lost.size == 0:
            return high
        low, high = float(values[lost[0]] - (high - low) / 32), float(values[lost[0]])
        if high < smallest:
            return 0.0
    return low
