r"""Exponential modes, and the L1 norm they give, for many impulse responses at once.

Partial fractions lose all digits where poles meet, and critically damped loops are not rare.
There Newton's form with divided differences of ``exp`` is taken, which has no such place:

.. math::
    \frac{n(s)}{(s-p_1)(s-p_2)(s-p_3)} \;\leftrightarrow\;
    n[p_1]\,E[p_1,p_2,p_3] + n[p_1,p_2]\,E[p_2,p_3] + n[p_1,p_2,p_3]\,E[p_3],

``E[...]`` being the divided differences of ``p -> exp(p t)`` (docs/theory.md, section 5 (Gains
between energies and between peaks)).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.theory.errors import require

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Complex = NDArray[np.complex128]
    Float = NDArray[np.float64]

__all__ = ["inverse_laplace", "total_variation"]

_CLOSE = 0.02  # two poles this close together, relative to the larger, are not taken apart
_SERIES_TERMS = 18
_MAX_HALF_PERIODS = 3000
_GRID, _MOST_STEPS = 60, 60
_NARROW = 1e-9  # how closely a zero is found, relative to its time
_DEAD = 45.0  # exp(-45) < 3e-20


def _exp_pair(p: Complex, q: Complex, t: Float) -> Complex:
    """``E[p, q](t) = t exp((p+q)t/2) sinhc((p-q)t/2)``, written so that nothing overflows."""
    gap = (p - q) * t
    near = np.abs(gap) < 1.0
    small = np.where(near, gap, 0.0)
    term = np.ones_like(small)
    series = np.ones_like(small)
    for n in range(2, _SERIES_TERMS):
        term = term * small / n
        series = series + term
    away = (np.exp(p * t) - np.exp(q * t)) / np.where(near, 1.0, gap)
    return np.asarray(t * np.where(near, np.exp(q * t) * series, away), dtype=np.complex128)


def _exp_triple(p: Complex, q: Complex, r: Complex, t: Float) -> Complex:
    """``E[p, q, r](t)``; ``p`` and ``r`` must be the pair farthest apart."""
    centre = (p + q + r) / 3.0
    x, y, z = (p - centre) * t, (q - centre) * t, (r - centre) * t
    near = np.maximum(np.abs(x), np.maximum(np.abs(y), np.abs(z))) < 1.0
    pairs, triple = np.where(near, x * y + x * z + y * z, 0.0), np.where(near, x * y * z, 0.0)
    # complete homogeneous polynomials h_n, with x + y + z = 0: h_n = -e2 h_{n-2} + e3 h_{n-3}
    history = [np.ones_like(pairs), np.zeros_like(pairs), -pairs]
    factorial = 2.0
    series = history[0] / factorial
    for n in range(1, _SERIES_TERMS):
        factorial *= n + 2
        series = series + history[1] / factorial
        history = [history[1], history[2], -pairs * history[1] + triple * history[0]]
    spread = (p - r) * t
    away = t * (_exp_pair(p, q, t) - _exp_pair(q, r, t)) / np.where(near, 1.0, spread)
    return np.where(near, t * t * np.exp(centre * t) * series, away)


def _farthest_first_and_last(p: Complex) -> Complex:
    """Order three poles (last axis) so that the first and the last are the farthest apart."""
    a, b, c = p[..., 0], p[..., 1], p[..., 2]
    ab, ac, bc = np.abs(a - b), np.abs(a - c), np.abs(b - c)
    middle = np.where((ab >= ac) & (ab >= bc), 2, np.where(ac >= bc, 1, 0))
    order = np.stack([(middle + 1) % 3, middle, (middle + 2) % 3], axis=-1)
    return np.take_along_axis(p, order, axis=-1)


def inverse_laplace(coefficients: Float, poles: Complex, t: Float) -> Float:
    """Time functions of ``n(s)/((s-p1)(s-p2)(s-p3))`` with ``n = c2 s^2 + c1 s + c0``.

    Parameters
    ----------
    coefficients : ndarray, shape (n, 3)
        ``c2, c1, c0``, already divided by the leading coefficient of the denominator.
    poles : ndarray, shape (n, 3)
        Poles [1/s], equal ones allowed; a complex pole together with its conjugate.
    t : ndarray, shape (n, m)
        Times [s].

    Returns
    -------
    ndarray, shape (n, m)
        Real time functions.
    """
    return _time_functions(coefficients, poles)(np.arange(len(poles)), t)


def _time_functions(
    coefficients: Float, poles: Complex
) -> Callable[[NDArray[np.intp], Float], Float]:
    """Prepare `inverse_laplace`: what is returned takes rows, of shape (k,), and their times."""
    gaps = poles[:, [0, 1, 2]] - poles[:, [1, 2, 0]]
    size = np.abs(poles)
    close = (np.abs(gaps) < _CLOSE * np.maximum(size, size[:, [1, 2, 0]])).any(axis=1)
    value = (coefficients[:, :1] * poles + coefficients[:, 1:2]) * poles + coefficients[:, 2:]
    apart = np.where(close[:, np.newaxis], 1.0, gaps)
    weight = value / (-apart * apart[:, [2, 0, 1]])

    def at(row: NDArray[np.intp], t: Float) -> Float:
        near = close[row]
        result = _sum_of_modes(weight[row], np.where(near[:, np.newaxis], 0.0, poles[row]), t)
        if near.any():
            both = row[near]
            result[near] = _newton_form(coefficients[both], poles[both], t[near])
        return np.asarray(result, dtype=np.float64)

    return at


def _sum_of_modes(weight: Complex, poles: Complex, t: Float) -> Float:
    """``sum w exp(p t)`` in real terms: a pair of conjugates is twice the real part of one."""
    size = np.where(poles.imag == 0, weight.real, 0.0)
    decay = np.exp(poles.real[..., np.newaxis] * t[:, np.newaxis])
    result = (size[..., np.newaxis] * decay).sum(axis=1)
    row, upper = np.nonzero(poles.imag > 0)
    if row.size:
        twice, times = 2.0 * weight[row, upper, np.newaxis], t[row]
        turn = poles.imag[row, upper, np.newaxis] * times
        wave = twice.real * np.cos(turn) - twice.imag * np.sin(turn)
        result[row] += decay[row, upper] * wave
    return np.asarray(result, dtype=np.float64)


def _newton_form(coefficients: Float, poles: Complex, t: Float) -> Float:
    p, q, r = np.moveaxis(_farthest_first_and_last(poles)[..., np.newaxis], -2, 0)
    c2, c1, c0 = np.moveaxis(coefficients[..., np.newaxis], -2, 0)
    value = (c2 * p + c1) * p + c0
    slope = c2 * (p + q) + c1
    result = value * _exp_triple(p, q, r, t) + slope * _exp_pair(q, r, t) + c2 * np.exp(r * t)
    return np.asarray(result.real, dtype=np.float64)


@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def _turning_times(coefficients: Float, poles: Complex) -> Float:
    """Extrema of ``exp(-p1 t) h(t)``, between which ``h`` has one zero at most; NaN where none.

    The derivative of ``exp(-p1 t) h`` holds two modes only and vanishes where
    ``exp((p3 - p2) t) = n(p2)/n(p3)``; for a complex pair that is once in every half period.
    """
    value = (coefficients[:, :1] * poles + coefficients[:, 1:2]) * poles + coefficients[:, 2:]
    times = [np.zeros((len(poles), 1))]
    for a, b in ((0, 1), (1, 2), (0, 2)):
        gap, ratio = poles[:, b] - poles[:, a], value[:, a] / value[:, b]
        real = (gap.imag == 0) & (ratio.real > 0)
        times.append(np.where(real, np.log(np.abs(ratio)) / gap.real, np.nan)[:, np.newaxis])
        pair = (poles[:, a] == np.conj(poles[:, b])) & (gap.imag != 0) & np.isfinite(ratio)
        if not pair.any():
            continue
        half = np.where(pair, np.abs(np.pi / poles[:, a].imag), np.nan)
        count = np.minimum(_DEAD / -poles[:, a].real / half, _MAX_HALF_PERIODS)
        start = (np.log(ratio) / gap).real % half
        number = np.arange(int(np.nanmax(count)) + 2)
        ringing = start[:, np.newaxis] + half[:, np.newaxis] * number
        times.append(np.where(number <= count[:, np.newaxis] + 1, ringing, np.nan))
    found = np.concatenate(times, axis=1)
    return np.where(np.isfinite(found) & (found >= 0), found, np.nan)


def _time_grid(coefficients: Float, poles: Complex) -> Float:
    """Choose times that bracket every sign change; the log grid serves poles about to meet."""
    first = 1e-4 / np.abs(poles).max(axis=1, keepdims=True)
    last = _DEAD / np.min(-poles.real, axis=1, keepdims=True)
    grid = first * (last / first) ** np.linspace(0.0, 1.0, _GRID)
    times = np.concatenate((grid, _turning_times(coefficients, poles)), axis=1)
    times = np.sort(times, axis=1)  # NaN to the end
    return np.where(np.isnan(times), np.nanmax(times, axis=1, keepdims=True), times)


def _zeros(coefficients: Float, poles: Complex) -> Float:
    """Sign changes of each time function, between the times of the grid; then inf.

    The error of the norm is of second order in the error of a zero.
    """
    t = _time_grid(coefficients, poles)
    function = _time_functions(coefficients, poles)
    h = function(np.arange(len(t)), t)
    row, place = np.nonzero(np.signbit(h[:, 1:]) != np.signbit(h[:, :-1]))
    ends = (t[row, place], h[row, place]), (t[row, place + 1], h[row, place + 1])
    found = _crossings(lambda which, times: function(row[which], times[:, np.newaxis])[:, 0], *ends)
    count = np.bincount(row, minlength=len(t))
    zeros = np.full((len(t), int(np.max(count, initial=0))), np.inf)
    column = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    zeros[row, column] = found
    return zeros


@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def _crossings(
    function: Callable[[NDArray[np.intp], Float], Float],
    first: tuple[Float, Float],
    last: tuple[Float, Float],
) -> Float:
    """Places between `first` and `last`, each places and values, where functions change sign.

    The method of T. R. Chandrupatla, Advances in Engineering Software 28 (1997) 145-149: inverse
    quadratic interpolation through the last three points where that is safe, else bisection.
    """
    (b, fb), (a, fa) = first, last
    c, fc = b, fb
    step, left = np.full(len(a), 0.5), np.arange(len(a))
    found = 0.5 * (a + b)
    for _ in range(_MOST_STEPS):
        if not left.size:
            break
        x = a + step * (b - a)
        fx = function(left, x)
        same = np.signbit(fx) == np.signbit(fa)
        c, fc = np.where(same, a, b), np.where(same, fa, fb)
        b, fb = np.where(same, b, a), np.where(same, fb, fa)
        a, fa = x, fx
        found[left] = np.where(np.abs(fa) < np.abs(fb), a, b)
        phi, xi = (fa - fb) / (fc - fb), (a - b) / (c - b)
        quadratic = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (
            fc - fb
        )
        safe = (phi**2 < xi) & ((1.0 - phi) ** 2 < 1.0 - xi) & np.isfinite(quadratic)
        margin = _NARROW * np.abs(a) / np.abs(b - a)
        step = np.clip(np.where(safe, quadratic, 0.5), margin, 1.0 - margin)
        go_on = (margin < 0.5) & (fa != 0)
        left, step = left[go_on], step[go_on]
        a, fa, b, fb, c, fc = (each[go_on] for each in (a, fa, b, fb, c, fc))
    return found


def total_variation(impulse: Float, remainder: Float, poles: Complex) -> Float:
    """L1 norms of impulse responses, as the total variations of their step responses.

    Parameters
    ----------
    impulse : ndarray, shape (n, 3)
        Numerators of the impulse responses ``h``.
    remainder : ndarray, shape (n, 3)
        Numerators of ``g(t)``, the integrals of ``h`` from ``t`` to infinity.
    poles : ndarray, shape (n, 3)
        Poles, all in the open left half plane.

    Returns
    -------
    ndarray, shape (n,)
        ``integral of |h| dt``, exact but for rounding: between two zeros of ``h`` it is a
        difference of ``g``; past the last stored half period the tail is a geometric series.

    Raises
    ------
    DesignError
        If a pair rings for thousands of periods while a real mode is alive.
    """
    pair = np.take_along_axis(poles, np.argmax(np.abs(poles.imag), axis=1)[:, np.newaxis], 1)[:, 0]
    turn = np.where(pair.imag != 0, np.abs(pair.imag), np.nan)
    decay = -pair.real * np.pi / turn
    rings_on = decay * _MAX_HALF_PERIODS < _DEAD
    zeros = _zeros(impulse, poles)
    if rings_on.any():
        end = np.where(rings_on, _MAX_HALF_PERIODS * np.pi / turn, np.inf)
        slowest = np.where(poles.imag == 0, -poles.real, np.inf).min(axis=1)
        require(
            bool((slowest * end > _DEAD)[rings_on].all()),
            f"the loop rings for {_DEAD / np.nanmin(decay):.3g} half periods beside a mode that is "
            "slower still: its L1 norm is out of reach. Choose gains nearer to 1/tau and 1/tau^2.",
        )
        zeros = np.where(zeros < end[:, np.newaxis], zeros, np.inf)
    past = ~np.isfinite(zeros)
    g = inverse_laplace(remainder, poles, np.where(past, 0.0, zeros))
    first = inverse_laplace(remainder, poles, np.zeros((len(poles), 1)))
    g = np.concatenate((first, np.where(past, 0.0, g)), axis=1)
    steps = np.abs(np.diff(g, axis=1, append=0.0))
    if rings_on.any():  # nothing but the pair is left: every further step is smaller by one factor
        count = np.sum(~past, axis=1)
        rows = np.flatnonzero(rings_on & (count > 0))
        last = steps[rows, count[rows] - 1]
        steps[rows, count[rows]] = last / np.expm1(decay[rows])
    return np.asarray(steps.sum(axis=1), dtype=np.float64)
