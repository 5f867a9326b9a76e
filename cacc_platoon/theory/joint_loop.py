r"""The loop with all of it at once: control period, V2V latency and lost packets.

At ``z = exp(j omega T)`` the sampled hop of `sampled_hop` is ``(V + k G)/D_T``, with ``k G`` what
the communicated acceleration adds. A latency ``Delta`` turns ``G`` by ``exp(-j omega Delta)``, a
receiver that holds the last packet multiplies it by ``F = p/(1 - (1 - p)/z)``, so that the hop
amplifies where

.. math:: 2 k |V F G| \cos(\arg(F G \bar V) - \omega\Delta) > |D_T|^2 - |V|^2 - k^2 |F G|^2 .

At one frequency the first ``Delta`` is therefore closed form; the latency margin is its minimum
over frequency, both ends of I (``|V + k F G|^2`` is convex in ``k``) and lag: along the valleys
between the lags of a grid, which is numerical. Packets come at the control instants, so that the
acceleration in use is ``ceil(Delta/T)`` periods old; no such age below the margin amplifies
(docs/theory.md, section 7 (V2V latency)).
"""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.theory.between_lags import between
from cacc_platoon.theory.exact import TOLERANCE, is_string_stable
from cacc_platoon.theory.first_loss import first_loss
from cacc_platoon.theory.noise_interval import effective_gains
from cacc_platoon.theory.sampled import (
    hold_integrals,
    is_sampled_string_stable,
    lags_to_try,
    longest_period,
    lost_between,
    margins_at,
    require_held,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from cacc_platoon.model.control import Gains

    Float = NDArray[np.float64]

__all__ = ["joint_critical_period", "joint_headroom", "joint_latency_margin"]

_FREQUENCIES, _COARSE = 200, 72
_VALLEYS, _PASSES = 4, 4
_FINE_SHARES = np.linspace(0.0, 1.0, 41)
_LAG_SHARES, _SHARES, _PASSES_BETWEEN = np.linspace(0.0, 1.0, 11), np.linspace(0.0, 1.0, 17), 10
_ASKEW, _ASIDE = 0.5, 0.1  # how far a valley goes from lag to lag, and its width, in log(omega)
_SHALLOW = 2.0  # times the least headroom: no valley that is as high is the deepest
_MORE_LAGS, _ROUNDING = 8, 1e-9


@np.errstate(all="ignore")  # what overflows is no headroom
def joint_headroom(
    time_headway: ArrayLike,
    k_v: ArrayLike,
    k_p: ArrayLike,
    tau: ArrayLike,
    k_effective: ArrayLike,
    *,
    period: ArrayLike,
    omega: ArrayLike,
    held: ArrayLike = 1.0,
) -> Float:
    """First latency [s] at which the sampled hop exceeds one; infinite where none does.

    All arguments broadcast. It is meaningful where the hop without latency does not amplify.

    Parameters
    ----------
    time_headway, k_v, k_p, tau, k_effective, period, held : array_like
        As in `sampled_hop`.
    omega : array_like
        Frequencies [rad/s], above 0 and up to ``pi/period``.

    Returns
    -------
    ndarray
        Latencies [s], at least 0.

    Examples
    --------
    >>> joint_headroom(0.95, 0.63, 0.009, 0.5, 0.6, period=0.01, omega=[0.1, 10.0]).round(4)
    array([0.4777,    inf])
    """
    h, v, p, k, w, share = (
        np.asarray(x, dtype=np.float64) for x in (time_headway, k_v, k_p, k_effective, omega, held)
    )
    T = np.asarray(period, dtype=np.float64)
    a1, a2, a3 = hold_integrals(np.asarray(tau, dtype=np.float64), T)
    half = a2 * T
    angle = 0.5 * w * T
    sine = np.sin(angle)
    d = 2.0 * sine / T * (1j * np.cos(angle) - sine)
    square = (2.0 * sine / T) ** 2  # |d|^2
    slope = v * a1 + p * (half * (2.0 - half) + a1 * a3 * T * T)
    own = ((v * half + p * a3 * T * T) * d + slope) * d + p * a1
    rest = ((d + a1 + h * p * half) * d + h * p * a1) * d  # D_T - V, without cancellation
    spare = (rest * np.conj(rest + 2.0 * own)).real  # |D_T|^2 - |V|^2
    heard = a1 * square
    turn = -d * d * np.conj(own)
    if (share != 1.0).any():
        last = share / (1.0 - (1.0 - share) * np.exp(-1j * w * T))
        heard, turn = heard * np.abs(last), turn * last
    size = np.abs(own)
    added = k * heard
    opening = (spare / added - added + 2.0 * size) / (4.0 * size)  # (1 + cos)/2
    reach = 2.0 * np.arcsin(np.sqrt(np.clip(opening, 0.0, 1.0)))
    delay = np.maximum(np.angle(turn) + reach, 0.0) / w
    return np.asarray(np.where((opening >= 1.0) | ~(k > 0), np.inf, delay), dtype=np.float64)


def joint_latency_margin(
    gains: Gains,
    rho: float,
    tau_max: float,
    period: float,
    *,
    held: float = 1.0,
    reception: float = 1.0,
    k_effective: float | None = None,
) -> float:
    """Largest constant V2V latency [s] that the sampled loop keeps string stability with.

    Parameters
    ----------
    gains, rho, tau_max, period, held, reception, k_effective
        As in `is_sampled_string_stable`.

    Returns
    -------
    float
        Latency margin [s] at this period and loss: 0 when not string stable without latency,
        infinite when nothing is communicated. As ``period -> 0`` it is `latency_margin`.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> A = Gains(0.95, 0.5, 0.63, 0.009)
    >>> [round(joint_latency_margin(A, 5.0, 0.5, period), 4) for period in (0.001, 0.01, 0.05)]
    [0.0809, 0.0734, 0.0395]
    """
    if not is_sampled_string_stable(
        gains, rho, tau_max, period, held=held, reception=reception, k_effective=k_effective
    ):
        return 0.0
    loop = _Loop.of(gains, rho, tau_max, held, reception=reception, k_effective=k_effective)
    return _headroom_between(loop, period)[0]


class _Loop(NamedTuple):
    """What is searched for its worst: ends of I, lags [s], and reception of held packets."""

    gains: Gains
    ends: tuple[float, ...]
    lags: Float
    held: float

    @classmethod
    def of(
        cls,
        gains: Gains,
        rho: float,
        tau_max: float,
        held: float,
        *,
        reception: float,
        k_effective: float | None,
    ) -> _Loop:
        ends = effective_gains(gains.k_a, rho, reception=reception, k_effective=k_effective)
        return cls(gains, ends, lags_to_try(tau_max, k_effective), held)

    def stable(self, periods: Float) -> NDArray[np.bool_]:
        """Say at which periods it is string stable without latency."""
        margins = margins_at(self.gains, self.ends, self.lags, periods, held=self.held)
        return np.asarray((margins >= -TOLERANCE).all(axis=1), dtype=np.bool_)

    def frequencies(self, periods: Float, count: int) -> Float:
        """Lay frequencies up to ``pi/T`` per period, dense where ``|H|`` comes closest to one.

        A design near the boundary has a dip of width ``sqrt(margin)`` at
        ``omega^2 = -B/(2 tau^2)``.
        """
        h, _, k_v, k_p = self.gains
        low = math.log(1e-3 * min(k_p / (k_v + h * k_p), math.sqrt(k_p)))
        top = np.log(math.pi / periods)[:, np.newaxis]
        grid = np.exp(low + (top - low) * np.linspace(0.0, 1.0, count))
        lag = float(self.lags[-1])
        load = 2.0 * lag * (k_v + h * k_p) - 1.0
        squares = [(load + k * k) / (2.0 * lag**2) for k in self.ends]
        dips = [math.sqrt(square) for square in squares if square > 0]
        if not dips:
            return np.asarray(grid, dtype=np.float64)
        offset = np.geomspace(1e-6, 0.4, max(count // 12, 8))
        around = np.concatenate((1.0 - offset, [1.0], 1.0 + offset))
        dense = np.minimum(np.multiply.outer(dips, around).ravel(), 0.9999 * np.exp(top))
        return np.sort(np.concatenate((grid, dense), axis=1), axis=1)

    def headroom(self, lag: Float, k: Float, period: Float | float, omega: Float) -> Float:
        """`joint_headroom` of these gains."""
        h, _, k_v, k_p = self.gains
        return joint_headroom(h, k_v, k_p, lag, k, period=period, omega=omega, held=self.held)

    def delays(self, lags: Float, periods: Float | float, omega: Float) -> Float:
        """Lay `headroom` over lags and both ends of I, the first two axes."""
        lag = lags.reshape(-1, *[1] * (1 + omega.ndim))
        k = np.reshape(self.ends, (-1, *[1] * omega.ndim))
        return self.headroom(lag, k, periods, omega)


def _least_headroom(loop: _Loop, period: float) -> float:
    """Minimise `joint_headroom` over frequency, the lags of the loop and ends of I."""
    omega = loop.frequencies(np.array([period]), _FREQUENCIES)[0]
    delay = loop.delays(loop.lags, period, omega).reshape(-1, omega.size)
    worst, envelope = np.argmin(delay, axis=0), np.min(delay, axis=0)
    best = float(np.min(envelope))
    if not math.isfinite(best):
        return best
    padded = np.concatenate(([np.inf], envelope, [np.inf]))
    valleys = np.flatnonzero((envelope <= padded[:-2]) & (envelope <= padded[2:]))
    valleys = valleys[np.argsort(envelope[valleys], kind="stable")[:_VALLEYS]]
    low = omega[np.maximum(valleys - 1, 0)]
    high = omega[np.minimum(valleys + 1, omega.size - 1)]
    place, end = np.divmod(worst[valleys], len(loop.ends))
    lag, k = loop.lags[place, np.newaxis], np.asarray(loop.ends)[end, np.newaxis]
    rows = np.arange(valleys.size)
    for _ in range(_PASSES):  # each pass narrows the brackets twentyfold
        local = between(low, high, _FINE_SHARES)
        delay = loop.headroom(lag, k, period, local)
        least = np.argmin(delay, axis=1)
        best = min(best, float(np.min(delay)))
        low, high = local[rows, np.maximum(least - 1, 0)], local[rows, np.minimum(least + 1, 40)]
    return best


def _headroom_between(loop: _Loop, period: float) -> tuple[float, float]:
    """Least headroom over the lags between those of the loop too, and the lag [s] where it is.

    From one lag to the next the frequency of a valley changes; it is followed on the way.
    """
    omega, lags = loop.frequencies(np.array([period]), _FREQUENCIES)[0], loop.lags
    delay = loop.delays(lags, period, omega)
    padded = np.full((lags.size + 2, len(loop.ends), omega.size + 2), np.inf)
    padded[1:-1, :, 1:-1] = delay
    beside = (padded[:-2, :, 1:-1], padded[2:, :, 1:-1], padded[1:-1, :, :-2], padded[1:-1, :, 2:])
    least = delay <= min(_SHALLOW * float(np.min(delay)), sys.float_info.max)
    for other in beside:
        least &= delay <= other
    place, end, at = np.nonzero(least)
    best = (math.inf, float(lags[-1]))
    if not place.size:
        return best
    deepest = np.argsort(delay[least], kind="stable")[:_VALLEYS]
    place, end, at = (np.tile(index[deepest], 2) for index in (place, end, at))
    step = np.repeat([-1, 1], deepest.size)
    beyond = np.clip(place + step, 0, lags.size - 1)
    along = np.abs(np.log(omega / omega[at, np.newaxis])) < _ASKEW
    there = omega[np.argmin(np.where(along, delay[beyond, end], np.inf), axis=1)]
    k, rows = np.asarray(loop.ends)[end, np.newaxis, np.newaxis], np.arange(place.size)
    ratio = np.log(there / omega[at])[:, np.newaxis]
    shares = np.zeros(rows.size), np.ones(rows.size)
    sides = np.full(rows.size, -_ASIDE), np.full(rows.size, _ASIDE)
    for _ in range(_PASSES_BETWEEN):
        share, aside = between(*shares, _LAG_SHARES), between(*sides, _SHARES)
        lag = lags[place, np.newaxis] + share * (lags[beyond] - lags[place])[:, np.newaxis]
        middle = omega[at, np.newaxis] * np.exp(share * ratio)
        local = np.minimum(middle[:, :, np.newaxis] * np.exp(aside)[:, np.newaxis], omega[-1])
        delay = loop.headroom(lag[:, :, np.newaxis], k, period, local).reshape(rows.size, -1)
        lowest = np.argmin(delay, axis=1)
        row = int(np.argmin(delay[rows, lowest]))
        nearest, across = np.divmod(lowest, _SHARES.size)
        best = min(best, (float(delay[row, lowest[row]]), float(lag[row, nearest[row]])))
        shares, sides = _around(share, nearest), _around(aside, across)
    return best


def _around(values: Float, at: NDArray[np.intp]) -> tuple[Float, Float]:
    """Return what is two places beside one in each row."""
    rows, last = np.arange(at.size), values.shape[1] - 1
    return values[rows, np.maximum(at - 2, 0)], values[rows, np.minimum(at + 2, last)]


def joint_critical_period(
    gains: Gains,
    rho: float,
    tau_max: float,
    *,
    latency: float = 0.0,
    held: float = 1.0,
    reception: float = 1.0,
    k_effective: float | None = None,
) -> float:
    """Control period [s] at which the loop is first lost that waits one period and the latency.

    Parameters
    ----------
    gains, rho, tau_max, held, reception, k_effective
        As in `is_sampled_string_stable`.
    latency : float, optional
        V2V latency [s]; the acceleration in use is one period older.

    Returns
    -------
    float
        Least period at which `joint_latency_margin` is below ``latency + period``, to a relative
        1e-6; 0 when no period keeps string stability.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> A = Gains(0.95, 0.5, 0.63, 0.009)
    >>> [round(joint_critical_period(A, 5.0, 0.5, latency=x), 4) for x in (0.0, 0.05)]
    [0.0443, 0.0173]
    """
    require_held(held)
    loop = _Loop.of(gains, rho, tau_max, held, reception=reception, k_effective=k_effective)
    if not all(is_string_stable(gains, tau_max, k) for k in loop.ends):
        return 0.0

    def slack(period: float) -> float:
        """How much later than required the acceleration may come; negative where it may not."""
        if not loop.stable(np.array([period])).all():
            return -math.inf
        return _least_headroom(loop, period) - latency - period

    low, high = 0.0, longest_period(gains, tau_max)
    for _ in range(3):
        periods = np.linspace(low, high, 25)[1:]
        lost = np.flatnonzero(~_bears(loop, periods, latency))
        if lost.size == 0:
            return high
        width = (high - low) / 24
        high = float(periods[lost[0]])
        low = high - width if lost[0] else low
    found = first_loss(slack, low, high, 1e-9 * tau_max)
    for _ in range(_MORE_LAGS):
        loop, lack = _with_lags_that_lose(loop, found, latency)
        if not lack:
            break
        low = max(found - lack, 0.5 * found)
        found = first_loss(slack, low, found, 1e-9 * tau_max, slack(found))
    return found


def _with_lags_that_lose(loop: _Loop, period: float, latency: float) -> tuple[_Loop, float]:
    """Add lags between those that bear a period that do not, and say how far to shorten it [s].

    A headroom that is short by some time is long enough with a period that is shorter by as much.
    """
    if not period or len(loop.lags) == 1:
        return loop, 0.0
    worse = lost_between(loop.gains, loop.ends, loop.lags, period, held=loop.held)
    lack = 0.001 * period if worse.size else 0.0
    headroom, lag = _headroom_between(loop, period)
    late = latency + period - headroom
    if late > _ROUNDING * period:
        worse, lack = np.append(worse, lag), max(lack, 1.01 * late)
    return loop._replace(lags=np.union1d(loop.lags, worse)), lack


def _bears(loop: _Loop, periods: Float, latency: float) -> NDArray[np.bool_]:
    """Say which periods leave a headroom of the latency and one period, on coarse frequencies."""
    omega = loop.frequencies(periods, _COARSE)
    few = loop.lags[[0, len(loop.lags) // 2, -1]]
    late = loop.delays(few, periods[:, np.newaxis], omega).min(axis=(0, 1, 3)) >= latency + periods
    return np.asarray(loop.stable(periods) & late, dtype=np.bool_)
