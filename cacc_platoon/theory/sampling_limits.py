"""How slowly a loop may be sampled, and how many packets a receiver that holds may lose.

Both are first losses of string stability in a numerical search over periods or losses, and lags
(docs/theory.md, section 6 (Sampling) and section 11 (Extensions)).
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.theory.exact import TOLERANCE, is_string_stable
from cacc_platoon.theory.noise_interval import effective_gains
from cacc_platoon.theory.sampled import (
    is_sampled_string_stable,
    lags_to_try,
    longest_period,
    lost_between,
    margins_at,
    require_held,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from cacc_platoon.model.control import Gains

    Float = NDArray[np.float64]

__all__ = ["critical_loss", "critical_period"]

_LONGEST_DELAY = 1e9  # of packets that are held, in periods
_PER_E_FOLD, _ROUNDS = 16.0, 4
_MORE_LAGS = 8  # how often lags between those tried are added where they are lost first


def critical_period(
    gains: Gains,
    rho: float,
    tau_max: float,
    *,
    held: float = 1.0,
    reception: float = 1.0,
    k_effective: float | None = None,
    lost_at: float = math.inf,
) -> float:
    """Period at which robust string stability is first lost [s]; 0 when no period keeps it.

    Parameters
    ----------
    gains, rho, tau_max, held, reception, k_effective
        As in `is_sampled_string_stable`.
    lost_at : float, optional
        A period that is known not to keep it; what is returned is not above.

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
    require_held(held)
    lags = lags_to_try(tau_max, k_effective)
    ends = effective_gains(gains.k_a, rho, reception=reception, k_effective=k_effective)
    if not all(is_string_stable(gains, tau_max, k) for k in ends):
        return 0.0
    longest, shortest = min(longest_period(gains, tau_max), lost_at), 1e-9 * tau_max

    def margins(periods: Float, lags: Float) -> Float:
        return margins_at(gains, ends, lags, periods, held=held)

    tried = partial(margins, lags=lags)
    within = (0.0, longest) if held == 1.0 else _enclosed(tried, shortest, longest)
    found = _first_lost(tried, shortest, *within)
    for _ in range(_MORE_LAGS):
        worse = lost_between(gains, ends, lags, found, held=held) if found else lags[:0]
        if not worse.size:
            break
        found = _first_lost(partial(margins, lags=worse), shortest, 0.0, found)
        lags = np.union1d(lags, worse)
    return found


def critical_loss(
    gains: Gains,
    rho: float,
    tau_max: float,
    period: float,
    *,
    reception: float = 1.0,
    k_effective: float | None = None,
    lost_at: float = 1.0,
) -> float:
    """Share of lost packets at which a receiver that holds the last one first loses stability.

    Parameters
    ----------
    gains, rho, tau_max, period, reception, k_effective
        As in `is_sampled_string_stable`.
    lost_at : float, optional
        A share that is known not to keep it; what is returned is not above.

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
    most = lost_at / (1.0 - lost_at) if lost_at < 1.0 else _LONGEST_DELAY

    def margins(delays: Float, lags: Float) -> Float:
        return margins_at(gains, ends, lags, at, held=1.0 / (1.0 + delays))

    tried = partial(margins, lags=lags)
    delay = _first_lost(tried, 1e-9, *_enclosed(tried, 1e-9, most))
    for _ in range(_MORE_LAGS):
        worse = lost_between(gains, ends, lags, period, held=1.0 / (1.0 + delay))
        if not worse.size:
            break
        delay = _first_lost(partial(margins, lags=worse), 1e-9, 0.0, delay)
        lags = np.union1d(lags, worse)
    return lost_at if delay >= most else delay / (1.0 + delay)


def _lost(margins: Float) -> NDArray[np.intp]:
    return np.flatnonzero(~(margins >= -TOLERANCE).all(axis=1))


def _enclosed(
    margins_of: Callable[[Float], Float], smallest: float, largest: float
) -> tuple[float, float]:
    """Enclose the first loss on a geometric grid, refined where a margin dips between its values.

    Packets that are held for long are like none, which may be stable again: what is lost may be
    a narrow band alone.
    """
    smallest = min(smallest, largest)
    values = np.geomspace(smallest, largest, 2 + int(_PER_E_FOLD * math.log(largest / smallest)))
    low, high = 0.0, largest
    for _ in range(_ROUNDS):
        margins = margins_of(values)
        last = next(iter(_lost(margins)), len(values) - 1)
        low, high = (float(values[last - 1]) if last else 0.0), float(values[last])
        finer = [np.linspace(values[i], values[i + 2], 17) for i in _dips(margins[: last + 1])]
        if not finer:
            break
        values = np.unique(np.concatenate((values[: last + 1], *finer)))
    return low, high


def _dips(margins: Float) -> NDArray[np.intp]:
    """List the i at whose successor a margin is least, and may vanish beside it: twice as deep."""
    left, inner, right = margins[:-2], margins[1:-1], margins[2:]
    least = (inner <= left) & (inner <= right) & (np.maximum(left, right) > 2.0 * inner + TOLERANCE)
    return np.flatnonzero(least.any(axis=1))


def _first_lost(
    margins_of: Callable[[Float], Float], smallest: float, low: float, high: float
) -> float:
    """Search (low, high] for where a margin first fails; 0 where that is below `smallest`."""
    while high - low > 1e-7 * high:
        values = np.linspace(low, high, 33)[1:]
        lost = _lost(margins_of(values))
        if lost.size == 0:
            return high
        low, high = float(values[lost[0]] - (high - low) / 32), float(values[lost[0]])
        if high < smallest:
            return 0.0
    return low
