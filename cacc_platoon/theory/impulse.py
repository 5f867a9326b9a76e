r"""Exponential modes without partial fractions, and the L1 norm they give.

Partial fractions lose all digits where poles meet, and critically damped loops are not rare.
Newton's form with divided differences of ``exp`` has no such place:

.. math::
    \frac{n(s)}{(s-p_1)(s-p_2)(s-p_3)} \;\leftrightarrow\;
    n[p_1]\,E[p_1,p_2,p_3] + n[p_1,p_2]\,E[p_2,p_3] + n[p_1,p_2,p_3]\,E[p_3],

``E[...]`` being the divided differences of ``p -> exp(p t)`` (docs/theory.md, section 5 (Two
gains)).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.theory.errors import require

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Complex = NDArray[np.complex128]
    Float = NDArray[np.float64]

__all__ = ["inverse_laplace", "total_variation"]

_SERIES_TERMS = 18
_MAX_HALF_PERIODS = 3000
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
    """Time function of ``n(s)/((s-p1)(s-p2)(s-p3))`` with ``n = c2 s^2 + c1 s + c0``.

    Parameters
    ----------
    coefficients : ndarray, shape (..., 3)
        ``c2, c1, c0``, already divided by the leading coefficient of the denominator.
    poles : ndarray, shape (..., 3)
        Poles [1/s], equal ones allowed; a complex pole together with its conjugate.
    t : ndarray, shape (..., n)
        Times [s].

    Returns
    -------
    ndarray, shape (..., n)
        Real time function.
    """
    p, q, r = np.moveaxis(_farthest_first_and_last(poles)[..., np.newaxis], -2, 0)
    c2, c1, c0 = np.moveaxis(coefficients[..., np.newaxis], -2, 0)
    value = (c2 * p + c1) * p + c0
    slope = c2 * (p + q) + c1
    result = value * _exp_triple(p, q, r, t) + slope * _exp_pair(q, r, t) + c2 * np.exp(r * t)
    return np.asarray(result.real, dtype=np.float64)


def _turning_times(coefficients: Float, poles: Complex) -> Float:
    """Extrema of ``exp(-p1 t) h(t)``, between which ``h`` has one zero at most.

    The derivative of ``exp(-p1 t) h`` holds two modes only and vanishes where
    ``exp((p3 - p2) t) = n(p2)/n(p3)``; for a complex pair that is once in every half period.
    """
    times = [np.zeros(1)]
    for a, b in ((0, 1), (1, 2), (0, 2)):
        first, second = np.polyval(coefficients, poles[[a, b]])
        gap = poles[b] - poles[a]
        if first == 0 or second == 0 or gap == 0:
            continue
        if gap.imag == 0 and (first / second).real > 0:
            times.append(np.array([np.log((first / second).real) / gap.real]))
        elif poles[a] == np.conj(poles[b]):
            half = abs(np.pi / poles[a].imag)
            start = (np.log(first / second) / gap).real % half
            count = min(_DEAD / -poles[a].real / half, _MAX_HALF_PERIODS)
            times.append(start + half * np.arange(int(count) + 2))
    found = np.concatenate(times)
    return found[np.isfinite(found) & (found >= 0)]


def _time_grid(coefficients: Float, poles: Complex) -> Float:
    """Choose times that bracket every sign change; the log grid serves poles about to meet."""
    fastest, slowest = float(np.max(np.abs(poles))), float(np.min(-poles.real))
    grid = np.geomspace(1e-4 / fastest, _DEAD / slowest, 120)
    return np.union1d(_turning_times(coefficients, poles), grid)


def _zeros(coefficients: Float, poles: Complex) -> Float:
    """Sign changes of the time function, by bisection between the times of the grid.

    The error of the norm is of second order in the error of a zero: 27 halvings are plenty.
    """
    t = _time_grid(coefficients, poles)
    h = inverse_laplace(coefficients, poles, t)
    change = np.flatnonzero(np.signbit(h[1:]) != np.signbit(h[:-1]))
    low, high, sign = t[change], t[change + 1], np.signbit(h[change])
    for _ in range(27):
        middle = 0.5 * (low + high)
        same = np.signbit(inverse_laplace(coefficients, poles, middle)) == sign
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return 0.5 * (low + high)


def total_variation(impulse: Float, remainder: Float, poles: Complex) -> float:
    """L1 norm of an impulse response, as the total variation of its step response.

    Parameters
    ----------
    impulse : ndarray, shape (3,)
        Numerator of the impulse response ``h``.
    remainder : ndarray, shape (3,)
        Numerator of ``g(t)``, the integral of ``h`` from ``t`` to infinity.
    poles : ndarray, shape (3,)
        Common poles, all in the open left half plane.

    Returns
    -------
    float
        ``integral of |h| dt``, exact but for rounding: between two zeros of ``h`` it is a
        difference of ``g``; past the last stored half period the tail is a geometric series.

    Raises
    ------
    DesignError
        If a pair rings for thousands of periods while a real mode is alive.
    """
    zeros = _zeros(impulse, poles)
    pair = poles[int(np.argmax(np.abs(poles.imag)))]
    decay = -pair.real * np.pi / abs(pair.imag) if pair.imag != 0 else np.inf
    rings_on = decay * _MAX_HALF_PERIODS < _DEAD
    if rings_on:
        end = _MAX_HALF_PERIODS * np.pi / abs(pair.imag)
        require(
            bool(np.min(np.where(poles.imag == 0, -poles.real, np.inf)) * end > _DEAD),
            f"the loop rings for {_DEAD / decay:.3g} half periods beside a mode that is slower "
            "still: its L1 norm is out of reach. Choose gains nearer to 1/tau and 1/tau^2.",
        )
        zeros = zeros[zeros < end]
    g = inverse_laplace(remainder, poles, np.concatenate(([0.0], zeros)))
    steps = np.abs(np.diff(g))
    if rings_on:  # nothing but the pair is left: every further step is smaller by one factor
        return float(np.sum(steps) + steps[-1] / np.expm1(decay))
    return float(np.sum(steps)) + abs(float(g[-1]))
