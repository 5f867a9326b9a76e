r"""The exact test of string stability, and the gain between energies.

With ``B = 1 - k^2 - 2 tau gamma`` and ``C = gamma^2 - 2 k_p - k_v^2 + 2 k k_p``,

.. math:: (|D|^2 - |N|^2)/\omega^2 = \tau^2\omega^4 + B\omega^2 + C,

so ``|H(j omega)| <= 1`` for all omega **iff** ``C >= 0`` and ``B + 2 tau sqrt(C) >= 0``
(docs/theory.md, section 3 (The exact test)). Where ``B`` and ``C`` touch zero, rounding would
decide; both conditions are therefore met down to ``-TOLERANCE`` relative to the terms they are
made of.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cacc_platoon.theory.errors import require_positive
from cacc_platoon.theory.noise_interval import effective_gains, effective_interval
from cacc_platoon.theory.transfer import (
    ROUTH_SLACK,
    gamma,
    is_internally_stable,
    poles,
    require_resolvable,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from cacc_platoon.model.control import Gains

__all__ = [
    "TOLERANCE",
    "L2Gain",
    "Margins",
    "is_robustly_string_stable",
    "is_string_stable",
    "l2_gain",
    "least_margins",
    "propagation_margins",
    "robust_string_stability_map",
    "string_stability_map",
    "worst_l2_gain",
]

TOLERANCE = 1e-12
"""Relative slack of the stability conditions."""


class Margins(NamedTuple):
    """What the exact test looks at: stable iff ``C >= 0`` and ``margin >= 0``.

    Attributes
    ----------
    B : float
        ``1 - k^2 - 2 tau gamma`` [-]; ``B >= 0`` and ``C >= 0`` are the paper's conditions.
    C : float
        ``gamma^2 - 2 k_p - k_v^2 + 2 k k_p`` [1/s^2].
    margin : float
        ``B + 2 tau sqrt(max(C, 0))`` [-].
    """

    B: float
    C: float
    margin: float


class L2Gain(NamedTuple):
    """H-infinity norm of one hop and where it is reached.

    Attributes
    ----------
    gain : float
        ``sup |H(j omega)|``, 1 when string stable, infinite when not internally stable.
    peak_omega : float
        Frequency of the supremum [rad/s].
    """

    gain: float
    peak_omega: float


def _terms(headway: Any, k_v: Any, k_p: Any, tau: Any, k: Any) -> tuple[Any, Any, Any, Any]:
    """``B`` and ``C/k_p`` without cancellation, each with the size of its terms."""
    load = 2.0 * tau * (k_v + headway * k_p)
    pull = headway * (2.0 * k_v + headway * k_p)
    return 1.0 - k * k - load, pull - 2.0 * (1.0 - k), 1.0 + k * k + abs(load), abs(pull) + 2.0


def propagation_margins(gains: Gains, tau: float, k_effective: float) -> Margins:
    """Margins of the exact test for one lag and one effective gain.

    Parameters
    ----------
    gains : Gains
        Controller; ``k_a`` is not used.
    tau : float
        Actuation lag [s].
    k_effective : float
        Effective feed-forward gain ``k_a E[w]``.

    Returns
    -------
    Margins
        ``B``, ``C`` and ``B + 2 tau sqrt(C)``.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> propagation_margins(Gains(0.65, 0.5, 0.63, 0.009), 0.5, 0.524086844).C < 0
    True
    """
    B, c, _, _ = _terms(gains.time_headway, gains.k_v, gains.k_p, tau, k_effective)
    C = gains.k_p * c
    return Margins(B, C, B + 2.0 * tau * math.sqrt(max(C, 0.0)))


def least_margins(gains: Gains, tau: float, ends: Sequence[float]) -> tuple[float, float]:
    """Least ``C`` and least ``B + 2 tau sqrt(C)`` over effective gains: how far it is to growth.

    ``sup |H| = 1`` of a string stable design says nothing of that, since ``H(0) = 1``.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> C, margin = least_margins(Gains(0.95, 0.5, 0.63, 0.009), 0.5, (0.4, 0.6))
    >>> round(C, 8), round(margin, 6)
    (4.61e-05, 0.061833)
    """
    found = [propagation_margins(gains, tau, k) for k in ends]
    return min(one.C for one in found), min(one.margin for one in found)


def is_string_stable(gains: Gains, tau: float, k_effective: float) -> bool:
    """Internally stable and ``sup |H(j omega)| <= 1``, for one lag and one effective gain.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> is_string_stable(Gains(0.95, 0.5, 0.63, 0.009), 0.5, 0.524086844)
    True
    >>> is_string_stable(Gains(0.65, 0.5, 0.63, 0.009), 0.5, 0.524086844)
    False
    """
    if not is_internally_stable(gains, tau):
        return False
    B, c, B_size, c_size = _terms(gains.time_headway, gains.k_v, gains.k_p, tau, k_effective)
    reach = 2.0 * tau * math.sqrt(max(gains.k_p * c, 0.0))
    if not math.isfinite(B + reach):  # what overflows proves nothing
        return False
    return bool(c >= -TOLERANCE * c_size and B + reach >= -TOLERANCE * B_size)


def is_robustly_string_stable(
    gains: Gains, rho: float, tau_max: float, *, reception: float = 1.0
) -> bool:
    """Test string stability for all lags in ``(0, tau_max]`` and all ``k`` in ``[m k_a, M k_a]``.

    Checking `tau_max` and the two ends of the interval is enough: the margin is linear in tau
    between ``1 - k^2 >= 0`` and its value at `tau_max`, and concave in ``k``
    (docs/theory.md, Theorem C (section 3)).

    Parameters
    ----------
    gains : Gains
        Controller.
    rho : float
        Linear signal-to-noise ratio, > 1; infinity means no noise.
    tau_max : float
        Largest actuation lag ``tau_0`` [s].
    reception : float, optional
        Smallest packet reception probability, losses counted as zero.

    Returns
    -------
    bool
        The exact answer, where the paper's region is only sufficient.

    Raises
    ------
    DesignError
        If `rho` is not above one or `reception` is not a probability.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> is_robustly_string_stable(Gains(0.95, 0.5, 0.63, 0.009), rho=5, tau_max=0.5)
    True
    """
    low, high = effective_interval(gains.k_a, rho, reception=reception)
    return is_string_stable(gains, tau_max, high) and is_string_stable(gains, tau_max, low)


def string_stability_map(
    time_headway: ArrayLike, k_v: ArrayLike, k_p: ArrayLike, tau: ArrayLike, k_effective: ArrayLike
) -> NDArray[np.bool_]:
    """`is_string_stable` over arrays that broadcast against each other.

    Parameters
    ----------
    time_headway, k_v, k_p, tau, k_effective : array_like, shape (...)
        Headway [s], gains [1/s], [1/s^2], lag [s] and effective gain.

    Returns
    -------
    ndarray of bool, shape (...)
        True where the hop is string stable.

    Examples
    --------
    >>> string_stability_map([0.95, 0.65], 0.63, 0.009, 0.5, 0.524086844).tolist()
    [True, False]
    """
    h, v, p, lag, k = (
        np.asarray(x, dtype=np.float64) for x in (time_headway, k_v, k_p, tau, k_effective)
    )
    B, c, B_size, c_size = _terms(h, v, p, lag, k)
    reach = 2.0 * lag * np.sqrt(np.maximum(p * c, 0.0))
    damping = v + h * p
    internally = (p > 0) & (damping > 0) & (damping * (1.0 - ROUTH_SLACK) > lag * p)
    within = (c >= -TOLERANCE * c_size) & (B + reach >= -TOLERANCE * B_size)
    return np.asarray(internally & within, dtype=np.bool_)


def robust_string_stability_map(
    k_a: ArrayLike,
    time_headway: ArrayLike,
    k_v: ArrayLike,
    k_p: ArrayLike,
    *,
    rho: float,
    tau_max: float,
) -> NDArray[np.bool_]:
    """`is_robustly_string_stable` over arrays that broadcast against each other.

    Parameters
    ----------
    k_a, time_headway, k_v, k_p : array_like, shape (...)
        Gains and headway, as in `Gains`.
    rho : float
        Linear signal-to-noise ratio, > 1.
    tau_max : float
        Largest actuation lag [s].

    Returns
    -------
    ndarray of bool, shape (...)
        True where the design is robustly string stable.

    Examples
    --------
    >>> robust_string_stability_map(0.5, [0.95, 0.65], 0.63, 0.009, rho=5, tau_max=0.5).tolist()
    [True, False]
    """
    low, high = effective_interval(1.0, rho)
    k = np.asarray(k_a, dtype=np.float64)
    ends = [string_stability_map(time_headway, k_v, k_p, tau_max, k * end) for end in (high, low)]
    return np.asarray(ends[0] & ends[1], dtype=np.bool_)


def l2_gain(gains: Gains, tau: float, k_effective: float) -> L2Gain:
    """``sup |H(j omega)|`` in closed form: the largest of its (at most four) stationary values.

    ``|H|^2 - 1 = -y q(y)/|D|^2`` with ``y = omega^2`` and ``q = tau^2 y^2 + B y + C`` keeps all
    digits near one, where the answer matters.

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
    L2Gain
        ``(1.0, 0.0)`` when string stable; ``(inf, omega of the rightmost pole)`` when the loop is
        not internally stable.

    Raises
    ------
    DesignError
        If `tau` is not positive.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> gain, peak_omega = l2_gain(Gains(0.65, 0.5, 0.63, 0.009), 0.5, 0.524086844)
    >>> round(gain, 9), round(peak_omega, 6)
    (1.001163718, 0.037939)
    """
    require_positive("tau", tau, "s")
    if not is_internally_stable(gains, tau):
        return L2Gain(math.inf, abs(float(poles(gains, tau)[0].imag)))
    if is_string_stable(gains, tau, k_effective):
        return L2Gain(1.0, 0.0)
    require_resolvable(gains, tau)
    return _largest_excess(gains, tau, propagation_margins(gains, tau, k_effective))


def _largest_excess(gains: Gains, tau: float, margins: Margins) -> L2Gain:
    """Maximise ``|H|^2 - 1`` over ``x = omega^2/k_p``, of order one in the spacing loop."""
    B, C, _ = margins
    damping, k_p = gamma(gains), gains.k_p
    load = tau * tau * k_p
    numerator = np.array([-load, -B, -C / k_p, 0.0])
    energy = np.array([load, 1.0 - 2.0 * tau * damping, damping**2 / k_p - 2.0, 1.0])
    slope: NDArray[np.float64] = np.polysub(
        np.polymul(np.polyder(numerator), energy), np.polymul(numerator, np.polyder(energy))
    )

    def excess(x: float) -> float:
        # |D|^2/k_p^2 as a sum of squares: a sharp resonance keeps its digits
        size = (1.0 - x) ** 2 + x * (damping - tau * k_p * x) ** 2 / k_p
        return -x * ((load * x + B) * x + C / k_p) / size if size > 0 else 0.0

    turning = [float(x) for x in np.roots(slope).real if x > 0]
    best = _climb(excess, max(turning, key=excess, default=1.0))
    if excess(best) <= 0:
        return L2Gain(1.0, 0.0)
    return L2Gain(math.sqrt(1.0 + excess(best)), math.sqrt(k_p * best))


def _climb(function: Callable[[float], float], start: float) -> float:
    """Finish a maximum by golden section; roots of the slope are coarse where a peak is narrow."""
    shrink = 0.5 * (math.sqrt(5.0) - 1.0)
    low, high = start * (1.0 - 1e-6), start * (1.0 + 1e-6)
    left, right = high - shrink * (high - low), low + shrink * (high - low)
    f_left, f_right = function(left), function(right)
    for _ in range(48):
        if f_left < f_right:
            low, left, f_left = left, right, f_right
            right = low + shrink * (high - low)
            f_right = function(right)
        else:
            high, right, f_right = right, left, f_left
            left = high - shrink * (high - low)
            f_left = function(left)
    return max((start, left, right), key=function)


def worst_l2_gain(
    gains: Gains,
    rho: float,
    tau_max: float,
    *,
    reception: float = 1.0,
    k_effective: float | None = None,
) -> L2Gain:
    """Compute ``sup |H|`` over all frequencies, lags in (0, tau_max] and ``k`` in I.

    It is that of `tau_max` at an end of I: ``|N|^2`` is convex in ``k``, and where a smaller lag
    is worse at one frequency, `tau_max` is worse still at another
    (docs/theory.md, Theorem F (section 5)).

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> worst_l2_gain(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5)
    L2Gain(gain=1.0, peak_omega=0.0)
    """
    ends = effective_gains(gains.k_a, rho, reception=reception, k_effective=k_effective)
    return max(l2_gain(gains, tau_max, k) for k in ends)
