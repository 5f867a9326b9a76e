r"""Gains between peaks: of the mean system, and for every realisation of the noise.

The impulse response of a hop is affine in the noise factor, ``h = u + w k_a v`` with ``u`` that of
``(k_v s + k_p)/D`` and ``v`` that of ``s^2/D``. Whatever ``w(t)`` does within ``[m, M]``,

.. math:: |a_i|_\infty \le \Gamma |a_{i-1}|_\infty, \qquad
          \Gamma = \int \max(|h_{m k_a}|, |h_{M k_a}|)\,dt = \|h_c\|_1 + r \|v\|_1,

``k_a w`` lying within ``r`` of its centre ``c``; and some ``w`` attains it: sign and factor may be
chosen at every instant. Gains over all lags come from a scan with a bound on what it can have
missed (docs/theory.md, section 5 (Gains between energies and between peaks)).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.theory.errors import require_positive
from cacc_platoon.theory.impulse import total_variation
from cacc_platoon.theory.noise_interval import effective_gains, effective_interval
from cacc_platoon.theory.sampled import in_unit_disc, lags_to_try, sampled_hop
from cacc_platoon.theory.transfer import gamma, is_internally_stable, poles

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from cacc_platoon.model.control import Gains

    Float = NDArray[np.float64]

__all__ = [
    "SCAN_TOLERANCE",
    "WorstGain",
    "linf_gain",
    "sampled_sure_gain",
    "sure_error_gain",
    "sure_gain",
    "worst_linf_gain",
    "worst_sure_error_gain",
    "worst_sure_gain",
]

SCAN_TOLERANCE = 0.02
"""By what share of itself a scan over lags may have missed the largest gain, unless the loop rings
so long that its lags would be too many; `WorstGain.at_most` says what holds."""
_SHORTEST = 1e-3
_COARSE = 13
_MOST_LAGS, _MOST_SWINGS = 160, 600.0
_LONGEST_SUM = 20_000  # steps, until all modes but one are dead


class WorstGain(NamedTuple):
    """The largest gain over all lags up to ``tau_max``.

    Attributes
    ----------
    gain : float
        The largest that was found.
    tau : float
        Its lag [s].
    at_most : float
        No lag has a larger one. Proven down to a thousandth of `tau_max` and of the loop's own
        times; below, ``H = (D_0/D) H_0`` bounds it with the lag-free ``H_0`` at some lags.
    """

    gain: float
    tau: float
    at_most: float


def linf_gain(gains: Gains, tau: float, k_effective: float) -> float:
    """L1 norm of the impulse response of ``H``: the gain between maximum norms, in the mean.

    It is at least `l2_gain`, and exactly one only where the impulse response keeps its sign.

    Parameters
    ----------
    gains : Gains
        Controller; ``k_a`` is not used.
    tau : float
        Actuation lag [s].
    k_effective : float
        Effective feed-forward gain.

    Returns
    -------
    float
        ``sup ||delta_i||_inf / ||delta_{i-1}||_inf``, infinite when not internally stable.

    Raises
    ------
    DesignError
        If `tau` is not positive.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> round(linf_gain(Gains(0.95, 0.5, 0.63, 0.009), 0.5, 0.524086844), 4)
    1.0214
    """
    return _at_one_lag(gains, tau, lambda lags: _hop_norms(gains, lags, (k_effective,)), 1.0)


def sure_gain(
    gains: Gains, rho: float, tau: float, *, reception: float = 1.0, late: bool = False
) -> float:
    """Gain between peaks of ``a_{i-1}`` and ``a_i`` for every noise within the SNR, at one lag.

    Parameters
    ----------
    gains : Gains
        Controller.
    rho : float
        Linear signal-to-noise ratio, > 1.
    tau : float
        Actuation lag [s].
    reception : float, optional
        Below one a packet may be lost and count as zero, so that the factor lies in ``[0, M]``.
    late : bool, optional
        Whether what is received may be late or held in any way; then only its size is known.

    Returns
    -------
    float
        ``Gamma >= 1``, attained by some ``w(t)``; infinite when not internally stable.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> round(sure_gain(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5), 5)
    1.16319
    """
    centre, reach = _centre(gains, rho, reception, late=late)
    return _at_one_lag(gains, tau, lambda lags: _sure_norms(gains, lags, centre, reach), 1.0)


def sure_error_gain(
    gains: Gains, rho: float, tau: float, *, reception: float = 1.0, late: bool = False
) -> float:
    """Largest ``|delta_i|`` per peak of ``a_{i-1}`` [s^2], for every noise, at one lag.

    Parameters
    ----------
    gains, rho, tau, reception, late
        As in `sure_gain`.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> round(sure_error_gain(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5), 4)
    22.0583
    """
    centre, reach = _centre(gains, rho, reception, late=late)
    return _at_one_lag(gains, tau, lambda lags: _error_norms(gains, lags, centre, reach), 0.0)


def worst_linf_gain(
    gains: Gains, rho: float, tau_max: float, *, reception: float = 1.0
) -> WorstGain:
    """`linf_gain` over all lags up to `tau_max` and all of I (it is convex in ``k``: the ends).

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> worst = worst_linf_gain(Gains(0.95, 0.5, 0.75, 1.0), 5.0, 0.5)
    >>> round(worst.gain, 3), worst.tau < 0.01
    (1.108, True)
    """
    ends = effective_gains(gains.k_a, rho, reception=reception)
    return _over_lags(gains, tau_max, lambda lags: _hop_norms(gains, lags, ends), 1.0)


def worst_sure_gain(
    gains: Gains, rho: float, tau_max: float, *, reception: float = 1.0, late: bool = False
) -> WorstGain:
    """`sure_gain` over all lags up to `tau_max`.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> round(worst_sure_gain(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5).gain, 3)
    1.204
    """
    centre, reach = _centre(gains, rho, reception, late=late)
    return _over_lags(gains, tau_max, lambda lags: _sure_norms(gains, lags, centre, reach), 1.0)


def worst_sure_error_gain(
    gains: Gains, rho: float, tau_max: float, *, reception: float = 1.0, late: bool = False
) -> WorstGain:
    """`sure_error_gain` over all lags up to `tau_max` [s^2].

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> round(worst_sure_error_gain(Gains(0.95, 0.5, 0.75, 1.0), 5.0, 0.5).gain, 3)
    0.461
    """
    centre, reach = _centre(gains, rho, reception, late=late)
    return _over_lags(gains, tau_max, lambda lags: _error_norms(gains, lags, centre, reach), 0.0)


def sampled_sure_gain(
    gains: Gains,
    rho: float,
    tau_max: float,
    period: float,
    *,
    reception: float = 1.0,
    late: bool = False,
    tau: float | None = None,
) -> float:
    """`sure_gain` of the loop sampled at `period`, largest of 22 lags and the plant without lag.

    ``sum |h_c[n]| + r sum |v[n]|``: term by term while more than one mode is alive, then by the
    sum of their sizes. Accelerations are largest at control instants, so that it bounds those of
    every run.

    Parameters
    ----------
    gains, rho, reception, late
        As in `sure_gain`.
    tau_max, period : float
        Largest lag and control period [s].
    tau : float, optional
        This lag alone.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> A = Gains(0.95, 0.5, 0.63, 0.009)
    >>> round(sampled_sure_gain(A, 5.0, 0.5, 0.01, tau=0.5), 4)
    1.1648
    """
    require_positive("period", period, "s")
    centre, reach = _centre(gains, rho, reception, late=late)
    h, _, k_v, k_p = gains
    lags = lags_to_try(tau_max, None) if tau is None else np.array([tau])
    T = np.full(lags.shape, period)
    mean = sampled_hop(h, k_v, k_p, lags, centre, period=period)
    more = sampled_hop(h, k_v, k_p, lags, centre + 1.0, period=period)
    if not in_unit_disc(mean.loop, T).all():
        return math.inf
    numerators = np.stack(mean.numerator[:3]), np.stack(more.numerator[:3])
    monic = np.stack(mean.loop)
    companion = np.zeros((lags.size, 3, 3))
    companion[:, 0, :] = -monic[2::-1].T
    companion[:, 1, 0] = companion[:, 2, 1] = 1.0
    d = np.linalg.eigvals(companion).astype(np.complex128)
    close = np.abs(d - d[:, [1, 2, 0]]) < 1e-6 * np.abs(d)
    d *= 1.0 + 1e-6 * np.cumsum(close, axis=1)  # what is equal is moved apart
    if not (np.abs(1.0 + period * d) < 1.0).all():  # it hardly dies out: beyond double precision
        return math.inf
    slope = np.stack([(d[:, i] - d[:, i - 1]) * (d[:, i] - d[:, i - 2]) for i in range(3)], axis=1)
    sums = []
    for n in (numerators[0], numerators[1] - numerators[0]):
        weight = period * (
            (n[2, :, np.newaxis] * d + n[1, :, np.newaxis]) * d + n[0, :, np.newaxis]
        )
        sums.append(_sum_of_sizes(weight / slope, 1.0 + period * d))
    return max(1.0, float(np.max(sums[0] + reach * sums[1])))


def _sum_of_sizes(weight: NDArray[np.complex128], mode: NDArray[np.complex128]) -> Float:
    """Sum ``|sum_i weight_i mode_i^n|`` over n >= 0, bounding the tail by the modes' sizes."""
    rate = np.log(np.where(np.abs(mode) < 1e-9, 1e-9, mode))  # one may be dead at once
    alive = np.sort(-rate.real, axis=1)[:, 1]
    steps = int(min(40.0 / float(alive.min()), _LONGEST_SUM)) + 1
    terms = np.zeros((len(weight), steps))
    for i in range(3):
        terms += (weight[:, i, np.newaxis] * np.exp(rate[:, i, np.newaxis] * np.arange(steps))).real
    tail = np.abs(weight) * np.exp(steps * rate.real) / -np.expm1(rate.real)
    return np.asarray(np.abs(terms).sum(axis=1) + tail.sum(axis=1), dtype=np.float64)


def _centre(
    gains: Gains, rho: float, reception: float, *, late: bool = False
) -> tuple[float, float]:
    """Centre and half width of what ``k_a w`` may be at any instant."""
    low, high = effective_interval(gains.k_a, rho, reception=1.0 if reception == 1.0 else 0.0)
    low = -high if late else low
    return 0.5 * (low + high), 0.5 * (high - low)


def _l1_norms(gains: Gains, lags: Float, numerators: list[tuple[Float | float, ...]]) -> Float:
    """L1 norms of ``(n2 s^2 + n1 s + n0)/D``, one row per numerator, one column per lag."""
    damping, k_p = gamma(gains), gains.k_p
    impulse = np.stack([np.stack(np.broadcast_arrays(*n, lags)[:3], -1) for n in numerators])
    n2, n1, n0 = np.moveaxis(impulse, -1, 0)
    limit = n0 / k_p
    remainder = np.stack((limit * lags, limit - n2, limit * damping - n1), axis=-1)
    roots = np.broadcast_to(poles(gains, lags), (len(numerators), *lags.shape, 3))
    scale = lags[:, np.newaxis]
    norms = total_variation(
        (impulse / scale).reshape(-1, 3), (remainder / scale).reshape(-1, 3), roots.reshape(-1, 3)
    )
    return norms.reshape(len(numerators), -1)


def _hop_norms(gains: Gains, lags: Float, ends: tuple[float, ...]) -> Float:
    return _l1_norms(gains, lags, [(k, gains.k_v, gains.k_p) for k in ends]).max(axis=0)


def _sure_norms(gains: Gains, lags: Float, centre: float, reach: float) -> Float:
    hop, heard = _l1_norms(gains, lags, [(centre, gains.k_v, gains.k_p), (1.0, 0.0, 0.0)])
    return np.asarray(hop + reach * heard, dtype=np.float64)


def _error_norms(gains: Gains, lags: Float, centre: float, reach: float) -> Float:
    """``Phi`` of `leader_error_norm` is affine in ``k``, too: its slope is ``(h_w s + 1)/D``."""
    h, _, k_v, _ = gains
    error = (0.0, h * centre - lags, centre + h * k_v - 1.0)
    mean, heard = _l1_norms(gains, lags, [error, (0.0, h, 1.0)])
    return np.asarray(mean + reach * heard, dtype=np.float64)


def _at_one_lag(gains: Gains, tau: float, norms: Callable[[Float], Float], least: float) -> float:
    require_positive("tau", tau, "s")
    if not is_internally_stable(gains, tau):
        return math.inf
    return max(least, float(norms(np.array([tau]))[0]))


def _over_lags(
    gains: Gains, tau_max: float, norms: Callable[[Float], Float], least: float
) -> WorstGain:
    r"""Scan lags so densely that between two of them no gain can exceed both by much.

    With ``E = tau s^3/D`` a lag ``(1 + x) tau`` has ``F (1 + x E)^{-1} = F - x E F + x^2 E^2 F
    (1 + x E)^{-1}``. The norm of ``F - x E F`` is convex in ``x``, so that between two lags no
    gain exceeds the larger of their two by more than ``2 (x e)^2/(1 - x e)`` of the gain in their
    middle, ``e = ||E||_1`` there, which is at most ``1/(1 - x e)`` of the larger.
    """
    require_positive("tau_max", tau_max, "s")
    if not is_internally_stable(gains, tau_max):
        return WorstGain(math.inf, tau_max, math.inf)
    lags = _lags(gains, tau_max)
    shorter = np.maximum(lags[0] * np.array([1e-4, 0.1, 0.3, 1.0]), _stiffest(gains))
    middle = np.sqrt(lags[1:] * lags[:-1])
    wide = np.maximum(lags[1:] / middle, 2.0 - lags[:-1] / middle) - 1.0
    change, change_below = np.split(_change(gains, np.append(middle, shorter)), [middle.size])
    reach = wide * change
    excess = np.where(reach < 1.0, 2.0 * reach**2 / (1.0 - reach), np.inf)
    lags = np.append(lags, shorter[0])
    found = np.maximum(norms(lags), least)
    between = np.maximum(found[1:-1], found[:-2])
    bound = between * (1.0 + excess / np.maximum(1.0 - reach, 1e-9))
    below = float(found[-1]) * (np.max(change_below) - 1.0)  # ||D_0/D||_1 times the limit
    at = int(np.argmax(found))
    return WorstGain(float(found[at]), float(lags[at]), float(max(np.max(bound), below)))


def _lags(gains: Gains, tau_max: float) -> Float:
    """Lay lags up to `tau_max` as densely as the change of the loop between them asks for."""
    shortest = _SHORTEST * min(tau_max, 1.0 / gamma(gains), 1.0 / math.sqrt(gains.k_p))
    shortest = min(max(shortest, 10.0 * _stiffest(gains)), 0.5 * tau_max)
    coarse = np.geomspace(shortest, tau_max, _COARSE)
    reach = 0.5 * (math.sqrt(1.0 + 2.0 * 0.8 * SCAN_TOLERANCE) - 1.0) ** 0.5  # 2 y^2/(1 - y)
    density = _change(gains, coarse) / (2.0 * reach)
    log = np.log(coarse)
    count = np.concatenate(([0.0], np.cumsum(np.diff(log) * 0.5 * (density[1:] + density[:-1]))))
    roots = poles(gains, coarse)
    swings = float(np.max(np.abs(roots.imag) / -roots.real))  # how often a pair rings, about
    most = min(_MOST_LAGS, max(_COARSE, int(_MOST_SWINGS / max(swings, 1.0))))
    number = min(math.ceil(float(count[-1])) + 1, most)
    lags = np.exp(np.interp(np.linspace(0.0, count[-1], number), count, log))
    lags[-1] = tau_max
    return np.asarray(lags, dtype=np.float64)


def _stiffest(gains: Gains) -> float:
    """Give the shortest lag [s] whose mode can be told from the slowest one."""
    return 1e-13 / min(gains.k_p / gamma(gains), math.sqrt(gains.k_p))


def _change(gains: Gains, lags: Float) -> Float:
    """``||tau s^3/D||_1``: one for the direct part, and the rest of ``D - tau s^3`` over ``D``."""
    rest = _l1_norms(gains, lags, [(1.0, gamma(gains), gains.k_p)])[0]
    return np.asarray(1.0 + rest, dtype=np.float64)
