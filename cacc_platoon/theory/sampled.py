r"""Sampled-data certificate: the loop at period T with its plant under exact zero-order hold.

In the delta operator ``d = (z - 1)/T`` the hop is ``H_T = N_T(d)/D_T(d)``; as T -> 0 it becomes
``N(s)/D(s)``, and no digits are lost on the way. On the unit circle ``|d|^2 = eta``,
``d + d* = -T eta`` with ``0 <= eta <= 4/T^2``, hence

.. math:: |D_T|^2 - |N_T|^2 = \mathrm{Re}\,(D_T - N_T)(D_T + N_T)^* = \eta\, q(\eta)

with ``q`` of degree 2, or 3 when a receiver holds the last packet, which arrives with probability
``p``: in the mean that filters it by ``p/(1 - (1 - p)/z)``, and ``D_T``, ``N_T`` are multiplied by
``z - (1 - p)``. The hop is string stable iff ``q >= 0`` on ``(0, 4/T^2]`` and the roots of ``D_T``
are in the unit disc.
The worst ``k`` is an end of I, since ``|N_T|^2`` is convex in ``k``. At one lag all this is exact;
the worst lag is closed in on where the slack is least among lags of a grid over ``[0, tau_0]``:
that part is numerical (docs/theory.md, section 6 (Sampling)).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.theory.between_lags import least_between
from cacc_platoon.theory.errors import require_positive, require_reception
from cacc_platoon.theory.exact import TOLERANCE
from cacc_platoon.theory.noise_interval import effective_gains

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from cacc_platoon.model.control import Gains

    Float = NDArray[np.float64]

__all__ = [
    "LAG_FRACTIONS",
    "SampledHop",
    "hold_integrals",
    "in_unit_disc",
    "is_sampled_string_stable",
    "lags_to_try",
    "longest_period",
    "lost_between",
    "margins_at",
    "propagation_polynomial",
    "require_held",
    "sampled_hop",
    "sampled_stability_map",
    "stable_at",
]

LAG_FRACTIONS = np.concatenate(([0.0], 2.0 ** np.arange(-10, -4), np.linspace(0.0, 1.0, 17)[1:]))
"""Of the largest lag: none, evenly, and halved down to 1/1024, for lags as short as a period."""


_SERIES = [(-1.0) ** n / math.factorial(n + 3) for n in range(13)]  # of p3 in r


class SampledHop(NamedTuple):
    """One hop in the delta operator, coefficients from the lowest power up.

    Attributes
    ----------
    numerator, denominator : tuple of ndarray
        ``N_T`` and ``D_T``; an acceleration that is held multiplies both by ``z - (1 - p)`` except
        in its own term, and that by ``p z``.
    loop : tuple of ndarray
        Monic characteristic polynomial of the vehicle's own loop.
    """

    numerator: tuple[Float, ...]
    denominator: tuple[Float, ...]
    loop: tuple[Float, ...]


def hold_integrals(tau: Float, period: Float) -> tuple[Float, Float, Float]:
    """Integrate a unit command held for one period: acceleration/T, velocity/T^2, position/T^3.

    With ``r = T/tau``: ``p1 = (1 - e^-r)/r``, ``p2 = (1 - p1)/r``, ``p3 = (1/2 - p2)/r``; the
    results are ``r p_i/T``. Small ``r`` needs the series, ``r = inf`` is the plant without lag.
    """
    r = np.divide(period, tau, out=np.full(np.broadcast(period, tau).shape, np.inf), where=tau > 0)
    near = r < 0.5
    small, large = np.where(near, r, 0.0), np.where(near, 1.0, r)
    series = np.full_like(small, _SERIES[-1])
    for coefficient in _SERIES[-2::-1]:
        series = coefficient + small * series
    third = small * series
    second = small * (0.5 - third)
    first = -np.expm1(-r)
    held = 1.0 - first / large
    return (
        first / period,
        np.where(near, second, held) / period,
        np.where(near, third, 0.5 - held / large) / period,
    )


def require_held(held: ArrayLike) -> None:
    """Refuse what is no probability.

    Raises
    ------
    DesignError
        If a value is outside 0 to 1.
    """
    shares = np.asarray(held, dtype=float)
    least, most = float(shares.min()), float(shares.max())
    require_reception(most if least >= 0 else least, "held")


def sampled_hop(
    time_headway: ArrayLike,
    k_v: ArrayLike,
    k_p: ArrayLike,
    tau: ArrayLike,
    k_effective: ArrayLike,
    *,
    period: ArrayLike,
    held: ArrayLike = 1.0,
) -> SampledHop:
    """Discretise one hop exactly; all arguments broadcast.

    Parameters
    ----------
    time_headway, k_v, k_p, tau, k_effective : array_like
        Headway [s], gains [1/s], [1/s^2], lag [s] (0 allowed) and effective gain.
    period : array_like
        Control period T [s].
    held : array_like, optional
        Packet reception probability of a receiver that holds the last packet.

    Returns
    -------
    SampledHop
        Coefficients in the delta operator.

    Raises
    ------
    DesignError
        If `held` is not a probability.

    Examples
    --------
    >>> hop = sampled_hop(0.95, 0.63, 0.009, 0.5, 0.5, period=1e-9)
    >>> [round(float(0.5 * c), 6) for c in hop.denominator]
    [0.009, 0.63855, 1.0, 0.5]
    """
    require_held(held)
    arguments = (time_headway, k_v, k_p, tau, k_effective, period, held)
    h, v, p, lag, k, T, share = (np.asarray(x, dtype=float) for x in arguments)
    h, v, p, k, T, share, a1, a2, a3 = np.broadcast_arrays(
        h, v, p, k, T, share, *hold_integrals(lag, T)
    )
    half = a2 * T
    position = (a1, half * (2.0 - half) + a1 * a3 * T * T, a3 * T * T)
    feedback = [p * position[0], v * a1 + p * position[1], v * half + p * position[2]]
    loop = (
        feedback[0],
        feedback[1] + h * p * a1,
        feedback[2] + h * p * half + a1,
        np.ones_like(a1),
    )
    zero = np.zeros_like(a1)
    if (share == 1.0).all():
        return SampledHop((feedback[0], feedback[1], feedback[2] + k * a1, zero), loop, loop)
    numerator = _times((*feedback, zero), share, T)  # z - (1 - share) = share + T d
    numerator[2] = numerator[2] + share * k * a1
    numerator[3] = numerator[3] + share * k * a1 * T
    return SampledHop((*numerator,), (*_times(loop, share, T),), loop)


def _times(polynomial: tuple[Float, ...], first: Float, period: Float) -> list[Float]:
    """Multiply a polynomial in d, coefficients from the lowest power up, by first + T d."""
    zero = np.zeros_like(polynomial[0])
    own, shifted = (*polynomial, zero), (zero, *polynomial)
    return [first * c + period * d for c, d in zip(own, shifted, strict=True)]


def propagation_polynomial(hop: SampledHop, period: Float) -> tuple[Float, Float]:
    """Coefficients of ``q(eta)`` from the lowest power up, and the sizes of their terms."""
    n = len(hop.denominator)
    error = [d - c for d, c in zip(hop.denominator, hop.numerator, strict=True)]
    total = [d + c for d, c in zip(hop.denominator, hop.numerator, strict=True)]
    # c_n(eta) = Re d^n: c_n = -T eta c_{n-1} - eta c_{n-2}
    powers = [np.zeros((n, *period.shape)) for _ in range(n)]
    powers[0][0] = 1.0
    powers[1][1] = -0.5 * period
    for i in range(2, n):
        powers[i][1:] = -period * powers[i - 1][:-1] - powers[i - 2][:-1]
    q, size = np.zeros((n, *period.shape)), np.zeros((n, *period.shape))
    for i in range(1, n):
        for j in range(n):
            weight, shift = error[i] * total[j], min(i, j)
            term = weight * powers[abs(i - j)]
            q[shift:] += term[: n - shift]
            size[shift:] += np.abs(term[: n - shift])
    return q[1:], size[1:]


def in_unit_disc(loop: tuple[Float, ...], period: Float) -> NDArray[np.bool_]:
    """Routh test of the cubic after ``d = w/(1 - T w/2)`` maps the unit disc to the left."""
    d0, d1, d2, _ = loop
    T = period
    w3 = 1.0 - T * (d2 / 2.0 - T * (d1 / 4.0 - T * d0 / 8.0))
    w2 = d2 - T * (d1 - 0.75 * T * d0)
    w1 = d1 - 1.5 * T * d0
    stable = (w3 > 0) & (w2 > 0) & (w1 > 0) & (d0 > 0) & (w2 * w1 > w3 * d0)
    return np.asarray(stable, dtype=np.bool_)


def sampled_stability_map(
    time_headway: ArrayLike,
    k_v: ArrayLike,
    k_p: ArrayLike,
    tau: ArrayLike,
    k_effective: ArrayLike,
    *,
    period: ArrayLike,
    held: ArrayLike = 1.0,
) -> NDArray[np.bool_]:
    """Exact sampled-data string stability over arrays that broadcast; see `sampled_hop`.

    Returns
    -------
    ndarray of bool
        True where the sampled hop is stable and ``|H_T| <= 1`` on the unit circle.

    Examples
    --------
    >>> sampled_stability_map(0.95, 0.63, 0.009, 0.5, 0.6, period=[0.01, 0.1]).tolist()
    [True, False]
    """
    hop = sampled_hop(time_headway, k_v, k_p, tau, k_effective, period=period, held=held)
    return np.asarray(_margin(hop, period) >= -TOLERANCE, dtype=np.bool_)


@np.errstate(all="ignore")  # what overflows counts as not stable
def _margin(hop: SampledHop, period: ArrayLike) -> Float:
    """Find the least ``q`` over the size of its terms on ``(0, 4/T^2]``; -inf if unstable."""
    T = np.broadcast_to(np.asarray(period, dtype=float), hop.loop[0].shape)
    q, size = propagation_polynomial(hop, T)
    scale = np.multiply.accumulate(np.broadcast_to(4.0 / T**2, q.shape)[1:], axis=0)
    q[1:] *= scale
    size[1:] *= scale
    q3 = q[3] if len(q) > 3 else np.zeros_like(T)
    root = np.sqrt(np.maximum(q[2] ** 2 - 3.0 * q3 * q[1], 0.0))
    pivot = -(q[2] + np.where(q[2] >= 0, root, -root))
    places = np.stack((np.zeros_like(T), np.ones_like(T), pivot / (3.0 * q3), q[1] / pivot))
    y = np.clip(np.nan_to_num(places), 0.0, 1.0)
    value, bound = np.zeros_like(y), np.zeros_like(y)
    for c, s in zip(q[::-1], size[::-1], strict=True):
        value, bound = value * y + c, bound * y + s
    margins = np.divide(value, bound, out=np.zeros_like(y), where=bound != 0)
    stable = in_unit_disc(hop.loop, T) & np.isfinite(size).all(axis=0)
    return np.where(stable, margins.min(axis=0), -np.inf)


def stable_at(
    gains: Gains,
    ends: tuple[float, ...],
    lags: Float,
    periods: Float,
    *,
    held: Float | float,
) -> NDArray[np.bool_]:
    """Say for each period, or each share `held`, whether all lags and ends of I are stable."""
    margins = margins_at(gains, ends, lags, periods, held=held)
    return np.asarray((margins >= -TOLERANCE).all(axis=1), dtype=np.bool_)


def margins_at(
    gains: Gains,
    ends: tuple[float, ...],
    lags: Float,
    periods: Float,
    *,
    held: Float | float = 1.0,
) -> Float:
    """List for each period, or each share `held`, what must not be below ``-TOLERANCE``."""
    h, _, k_v, k_p = gains
    T = periods[:, np.newaxis, np.newaxis]
    hop = sampled_hop(
        h,
        k_v,
        k_p,
        lags[:, np.newaxis],
        np.asarray(ends),
        period=T,
        held=np.reshape(held, (-1, 1, 1)),
    )
    margins = _margin(hop, T)
    return margins.reshape(len(margins), -1)


def lost_between(
    gains: Gains,
    ends: tuple[float, ...],
    lags: Float,
    period: float,
    *,
    held: float = 1.0,
) -> Float:
    """List lags [s] between those tried at which string stability is lost, the worst of each."""

    def margins(between: Float) -> Float:
        found = margins_at(gains, ends, between, np.array([period]), held=held)
        return found.reshape(len(between), -1)

    found, least = least_between(margins, lags, -TOLERANCE)
    return found[least < -TOLERANCE]


def lags_to_try(tau_max: float, k_effective: float | None) -> Float:
    """List the lags that stand for all up to `tau_max`; that one alone for a `k_effective`."""
    require_positive("tau_max", tau_max, "s")
    return tau_max * LAG_FRACTIONS if k_effective is None else np.array([tau_max])


def longest_period(gains: Gains, tau_max: float) -> float:
    """Period [s] that no sampled loop survives: without lag all are lost at ``T >= 2/gamma``."""
    return 8.0 / (gains.k_v + gains.time_headway * gains.k_p) + 8.0 * tau_max


def is_sampled_string_stable(
    gains: Gains,
    rho: float,
    tau_max: float,
    period: float,
    *,
    held: float = 1.0,
    reception: float = 1.0,
    k_effective: float | None = None,
) -> bool:
    """Certify the sampled loop at one period, for all of I and every lag up to `tau_max`.

    The test of one lag is exact; which lag is the worst is found numerically, between lags that
    are tried too.

    Parameters
    ----------
    gains : Gains
        Controller.
    rho : float
        Linear signal-to-noise ratio, > 1.
    tau_max : float
        Largest actuation lag [s].
    period : float
        Control period T [s].
    held : float, optional
        Packet reception probability of a receiver that holds the last packet; 0 is a receiver
        that never has one.
    reception : float, optional
        Smallest packet reception probability, losses counted as zero.
    k_effective : float, optional
        Ask for this effective gain at `tau_max` only.

    Returns
    -------
    bool
        Whether ``|H_T| <= 1`` and the loop is stable, worst case.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> is_sampled_string_stable(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5, period=0.01)
    True
    """
    require_positive("period", period, "s")
    require_held(held)
    lags = lags_to_try(tau_max, k_effective)
    ends = effective_gains(gains.k_a, rho, reception=reception, k_effective=k_effective)
    return (
        max(map(abs, ends)) <= 1
        and bool(stable_at(gains, ends, lags, np.array([period]), held=held)[0])
        and not lost_between(gains, ends, lags, period, held=held).size
    )
