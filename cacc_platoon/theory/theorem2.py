r"""The paper's Theorem 2: bounds, best gain and the region S, with its slips put right.

Here ``m = 1 - 1/rho`` and ``M = 1 + 1/rho``. The region ``S = S1 and S2`` is sufficient, not
necessary, and nonempty iff ``a1 > a2`` (the text's "a1 >= a2 or b1 >= b2" is not enough):
docs/theory.md, section 2 (The paper's theorem, and its slips).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from cacc_platoon.theory.errors import require_positive, require_rho
from cacc_platoon.theory.noise_interval import checked_interval, effective_interval

if TYPE_CHECKING:
    from cacc_platoon.model.control import Gains

__all__ = [
    "GammaRange",
    "Optimum",
    "PaperRegion",
    "gamma_range",
    "headway_bound",
    "headway_slope",
    "headway_slope_roots",
    "in_paper_region",
    "optimum",
    "paper_region",
]

_SLACK = 1e-12


class Optimum(NamedTuple):
    """Theorem 2(c): the gain that minimises the paper's headway bound.

    Attributes
    ----------
    k_a : float
        ``k_a*``.
    time_headway : float
        ``h*_{w,lb}`` [s], itself not admissible: the inequality is strict.
    """

    k_a: float
    time_headway: float


class GammaRange(NamedTuple):
    """What the paper's proof admits for ``gamma = k_v + h_w k_p`` [1/s].

    Attributes
    ----------
    low, high : float
        ``sqrt(2 k_p (1 - m k_a) + k_v^2)`` and ``(1 - M^2 k_a^2)/(2 tau_0)``; low > high where
        nothing is admitted.
    """

    low: float
    high: float


class PaperRegion(NamedTuple):
    """The region S of Theorem 2(b) in the plane of ``(k_p, k_v)``.

    Attributes
    ----------
    a1, a2 : float
        Intercepts on the ``k_v`` axis [1/s] of the upper and lower line.
    b1, b2 : float
        Intercepts on the ``k_p`` axis [1/s^2].
    polygon : tuple of (k_p, k_v)
        Corners in order, empty when S is.
    area : float
        Area of S [1/s^3].
    """

    a1: float
    b1: float
    a2: float
    b2: float
    polygon: tuple[tuple[float, float], ...]
    area: float

    @property
    def nonempty(self) -> bool:
        """Whether S has an interior: ``a1 > a2``."""
        return bool(self.polygon)


def headway_bound(k_a: float, rho: float, tau_max: float, *, reception: float = 1.0) -> float:
    """Paper's lower bound ``2 tau_0 (1 - m k_a)/(1 - M^2 k_a^2)`` [s] (Theorem 2b, strict).

    Parameters
    ----------
    k_a : float
        Feed-forward gain, 0 <= k_a < k_a_max(rho).
    rho : float
        Linear signal-to-noise ratio, > 1.
    tau_max : float
        Largest actuation lag ``tau_0`` [s].
    reception : float, optional
        Smallest packet reception probability, with which ``m`` shrinks.

    Returns
    -------
    float
        The headway above which the paper's region S is not empty.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> round(headway_bound(0.5, 5.0, 0.5), 6)
    0.9375
    """
    require_positive("tau_max", tau_max, "s")
    low, high = checked_interval(k_a, rho, reception=reception)
    return 2.0 * tau_max * (1.0 - low) / ((1.0 - high) * (1.0 + high))


def optimum(rho: float, tau_max: float, *, reception: float = 1.0) -> Optimum:
    """``k_a*`` and ``h*`` of Theorem 2(c); ``1`` and ``tau_0`` without noise.

    With a `reception` below one, ``m`` shrinks by it: ``k_a* = p m/(M (M + sqrt(M^2 - p^2 m^2)))``.

    Examples
    --------
    >>> k_a, headway = optimum(5.0, 0.5)
    >>> round(k_a, 9), round(headway, 9)
    (0.318305009, 0.872677996)
    """
    require_rho(rho)
    require_positive("tau_max", tau_max, "s")
    if reception != 1.0:
        m, M = effective_interval(1.0, rho, reception=reception)
        k_a = m / (M * (M + math.sqrt((M - m) * (M + m))))
        return Optimum(k_a, headway_bound(k_a, rho, tau_max, reception=reception))
    root = 1.0 / math.sqrt(rho)
    span = 1.0 + 1.0 / rho
    return Optimum((1.0 - root) / (1.0 + root) / span, tau_max * (1.0 + root) ** 2 / span)


def headway_slope(k_a: float, rho: float) -> float:
    """``f(k_a) = -m n k_a^2 + 2 n k_a - m`` with ``n = M^2``: the sign of ``d h_lb/d k_a``.

    Examples
    --------
    >>> headway_slope(0.0, 5.0)
    -0.8
    """
    m, M = effective_interval(1.0, rho)
    n = M * M
    return (-m * n * k_a + 2.0 * n) * k_a - m


def headway_slope_roots(rho: float) -> tuple[float, float]:
    """Both roots of `headway_slope`; the smaller one is ``k_a*``, the larger is above the cap.

    Examples
    --------
    >>> [round(root, 6) for root in headway_slope_roots(5.0)]
    [0.318305, 2.181695]
    """
    m, M = effective_interval(1.0, rho)
    root = math.sqrt((M - m) * (M + m))
    return m / (M * (M + root)), (M + root) / (M * m)


def gamma_range(k_a: float, k_v: float, k_p: float, rho: float, tau_max: float) -> GammaRange:
    """Range of ``gamma`` for which ``B >= 0`` and ``C >= 0`` at every lag and ``k`` in I.

    Parameters
    ----------
    k_a, k_v, k_p : float
        Gains [-], [1/s], [1/s^2].
    rho : float
        Linear signal-to-noise ratio, > 1.
    tau_max : float
        Largest actuation lag [s].

    Returns
    -------
    GammaRange
        Of the proof of Theorem 2; S is the ``(k_p, k_v)`` whose gamma lies within it.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> low, high = gamma_range(0.5, 0.63, 0.009, rho=5.0, tau_max=0.5)
    >>> round(low, 6), round(high, 6)
    (0.638514, 0.64)
    """
    require_positive("tau_max", tau_max, "s")
    require_positive("k_p", k_p, "1/s^2")
    low, high = checked_interval(k_a, rho)
    return GammaRange(
        math.sqrt(2.0 * k_p * (1.0 - low) + k_v * k_v),
        (1.0 - high) * (1.0 + high) / (2.0 * tau_max),
    )


def paper_region(
    k_a: float, time_headway: float, rho: float, tau_max: float, *, reception: float = 1.0
) -> PaperRegion:
    """Region S of ``(k_p, k_v)`` with its intercepts, corners and area.

    Parameters
    ----------
    k_a : float
        Feed-forward gain, 0 <= k_a < k_a_max(rho).
    time_headway : float
        Headway ``h_w`` [s].
    rho : float
        Linear signal-to-noise ratio, > 1.
    tau_max : float
        Largest actuation lag [s].
    reception : float, optional
        Smallest packet reception probability, losses counted as zero; see `in_paper_region`.

    Returns
    -------
    PaperRegion
        Equation (28), region S1, and equation (32), region S2; the polygon is empty iff
        ``a1 <= a2``.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> paper_region(0.5, 0.95, 5.0, 0.5).nonempty, paper_region(0.5, 0.65, 5.0, 0.5).nonempty
    (True, False)
    """
    require_positive("time_headway", time_headway, "s")
    require_positive("tau_max", tau_max, "s")
    low, high = checked_interval(k_a, rho, reception=reception)
    a1 = (1.0 - high) * (1.0 + high) / (2.0 * tau_max)
    a2 = (1.0 - low) / time_headway
    b1, b2 = a1 / time_headway, 2.0 * a2 / time_headway
    if a1 <= a2:
        return PaperRegion(a1, b1, a2, b2, (), 0.0)
    if b1 < b2:
        corner = (2.0 * (a1 - a2) / time_headway, 2.0 * a2 - a1)
        area = (a1 - a2) ** 2 / time_headway
        return PaperRegion(a1, b1, a2, b2, ((0.0, a2), corner, (0.0, a1)), area)
    polygon = ((0.0, a2), (b2, 0.0), (b1, 0.0), (0.0, a1))
    return PaperRegion(a1, b1, a2, b2, polygon, 0.5 * (a1 * b1 - a2 * b2))


def in_paper_region(gains: Gains, rho: float, tau_max: float, *, reception: float = 1.0) -> bool:
    """Whether the paper's Theorem 2 vouches for these gains: ``(k_p, k_v)`` in S.

    The theorem knows no packet loss; with a `reception` it is applied to the larger interval I.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> in_paper_region(Gains(0.95, 0.5, 0.63, 0.009), rho=5.0, tau_max=0.5)
    True
    """
    low, high = effective_interval(gains.k_a, rho, reception=reception)
    if not (gains.k_a > 0 and high < 1 and gains.k_p > 0 and gains.k_v > 0):
        return False
    if not gains.time_headway > headway_bound(gains.k_a, rho, tau_max, reception=reception):
        return False
    upper = 2.0 * tau_max * (gains.k_v + gains.time_headway * gains.k_p)
    lower = gains.time_headway * (gains.k_v + 0.5 * gains.time_headway * gains.k_p)
    return upper <= (1.0 - high) * (1.0 + high) + _SLACK and lower >= 1.0 - low - _SLACK
