r"""The exact robust region of ``(k_p, k_v)``, the minimum headway, and how far S is from both.

For one ``k`` in I, with ``Q = (1 - k^2)/(2 tau_0)`` and ``X = Q h_w - (1 - k)``, a design is
string stable iff ``X >= 0`` and ``L <= k_v <= Q + sqrt(2 k_p X)``, where
``L = (1 - k)/h_w - h_w k_p/2`` if ``k_p h_w^2 <= 2 X`` and ``Q - sqrt(2 k_p X)`` beyond. The
robust region is the intersection at both ends of I (docs/theory.md, section 4 (The exact region
and the exact minimum headway)). In ``z = sqrt(k_p)`` every boundary is a parabola or a line, so
areas are exact.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.model.control import Gains
from cacc_platoon.theory.errors import require, require_positive
from cacc_platoon.theory.exact import is_robustly_string_stable, is_string_stable
from cacc_platoon.theory.noise_interval import checked_interval, effective_interval
from cacc_platoon.theory.theorem2 import headway_bound, paper_region
from cacc_platoon.theory.transfer import gamma

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Conservatism",
    "ExactRegion",
    "conservatism",
    "exact_region",
    "infimum_headway",
    "minimum_headway",
    "stable_gain_range",
]

_SLACK = 1e-12


def minimum_headway(k_a: float, rho: float, tau_max: float, *, reception: float = 1.0) -> float:
    """Exact minimum headway ``2 tau_0/(1 + m k_a)`` [s], attained with ``k_p`` large enough.

    With a `reception` below one, the smallest share of packets that arrives, ``m`` shrinks by it.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> round(minimum_headway(0.5, rho=5.0, tau_max=0.5), 6)
    0.714286
    """
    require_positive("tau_max", tau_max, "s")
    return 2.0 * tau_max / (1.0 + checked_interval(k_a, rho, reception=reception).low)


def infimum_headway(rho: float, tau_max: float, *, reception: float = 1.0) -> float:
    """Infimum of `minimum_headway` over ``k_a``, ``tau_0 (1 + 1/rho)`` [s], not attained.

    With a `reception` ``p`` below one it is ``2 tau_0/(1 + p m/M)``.

    Examples
    --------
    >>> infimum_headway(rho=5.0, tau_max=0.5)
    0.6
    """
    require_positive("tau_max", tau_max, "s")
    m, M = effective_interval(1.0, rho, reception=reception)
    return tau_max * M if reception == 1.0 else 2.0 * tau_max * M / (M + m)


class _End(NamedTuple):
    """One end of I: its ``k``, ``Q`` and ``sqrt(2 X)`` (NaN-free: infeasible ends are refused)."""

    k: float
    Q: float
    reach: float


class ExactRegion(NamedTuple):
    """All ``(k_p, k_v)`` that are robustly string stable at one headway.

    Attributes
    ----------
    k_a, time_headway, rho, tau_max, reception : float
        The question.
    ends : tuple
        ``(k, Q, sqrt(2 X))`` at ``m k_a`` and ``M k_a``; empty when the headway is infeasible.
    k_p_min : float
        Smallest ``k_p`` [1/s^2] of the region: 0 above the paper's bound, infinite when empty.
    """

    k_a: float
    time_headway: float
    rho: float
    tau_max: float
    ends: tuple[_End, ...]
    k_p_min: float
    reception: float = 1.0

    @property
    def nonempty(self) -> bool:
        """Whether any gains are robustly string stable at this headway."""
        return math.isfinite(self.k_p_min)

    def bounds(self, k_p: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lower and upper ``k_v`` [1/s] over ``k_p`` [1/s^2]; lower > upper where there is none.

        Examples
        --------
        >>> low, high = exact_region(0.5, 0.95, rho=5.0, tau_max=0.5).bounds([0.009])
        >>> low.round(6).tolist(), high.round(6).tolist()
        ([0.627304], [0.701188])
        """
        p = np.asarray(k_p, dtype=np.float64)
        z = np.sqrt(np.maximum(p, 0.0))
        low, high = np.zeros_like(p), np.full_like(p, np.inf if self.ends else -np.inf)
        for k, Q, reach in self.ends:
            line = (1.0 - k) / self.time_headway - 0.5 * self.time_headway * p
            low = np.maximum(low, np.where(z * self.time_headway <= reach, line, Q - reach * z))
            high = np.minimum(high, Q + reach * z)
        return low, high

    def contains(self, k_p: float, k_v: float) -> bool:
        """Whether these gains are robustly string stable (the exact test itself)."""
        gains = Gains(self.time_headway, self.k_a, k_v, k_p)
        return k_v > 0 and is_robustly_string_stable(
            gains, self.rho, self.tau_max, reception=self.reception
        )

    def area(self, k_p_limit: float) -> float:
        """Area [1/s^3] of the part with ``k_p <= k_p_limit``; the whole region is unbounded.

        Examples
        --------
        >>> region = exact_region(0.5, 0.95, rho=5.0, tau_max=0.5)
        >>> round(region.area(0.0177285), 8)
        0.00123893
        """
        require_positive("k_p_limit", k_p_limit, "1/s^2")
        if not k_p_limit > self.k_p_min:
            return 0.0
        start, stop = math.sqrt(self.k_p_min), math.sqrt(k_p_limit)
        breaks = [z for z in self._breakpoints() if start < z < stop]
        edges = np.array([start, *sorted(breaks), stop])
        nodes, weights = np.polynomial.legendre.leggauss(3)  # exact up to degree 5
        half = 0.5 * np.diff(edges)[:, np.newaxis]
        z = edges[:-1, np.newaxis] + half * (1.0 + nodes)
        low, high = self.bounds(z * z)
        return float(np.sum(half * weights * np.maximum(high - low, 0.0) * 2.0 * z))

    def _breakpoints(self) -> list[float]:
        h = self.time_headway
        curves = [(0.0, 0.0, 0.0)]
        for k, Q, reach in self.ends:
            curves += [(-0.5 * h, 0.0, (1.0 - k) / h), (0.0, -reach, Q), (0.0, reach, Q)]
        found = [end.reach / h for end in self.ends]
        for i, first in enumerate(curves):
            for second in curves[:i]:
                roots = np.roots(np.trim_zeros(np.subtract(first, second), "f"))
                found += [float(root.real) for root in roots if abs(root.imag) == 0]
        return found


def exact_region(
    k_a: float, time_headway: float, rho: float, tau_max: float, *, reception: float = 1.0
) -> ExactRegion:
    """Exact robust region at one ``k_a`` and headway.

    Parameters
    ----------
    k_a : float
        Feed-forward gain, 0 <= k_a < k_a_max(rho).
    time_headway : float
        Headway [s].
    rho : float
        Linear signal-to-noise ratio, > 1.
    tau_max : float
        Largest actuation lag [s].
    reception : float, optional
        Smallest packet reception probability.

    Returns
    -------
    ExactRegion
        Boundary curves, ``k_p_min``, membership and area.

    Raises
    ------
    DesignError
        If a value is out of its range. A headway that is too short gives an empty region.

    Examples
    --------
    >>> exact_region(0.5, 0.95, rho=5.0, tau_max=0.5).k_p_min
    0.0
    >>> round(exact_region(0.5, 0.8, rho=5.0, tau_max=0.5).k_p_min, 6)
    0.039586
    """
    require_positive("time_headway", time_headway, "s")
    require_positive("tau_max", tau_max, "s")
    ends = []
    for k in checked_interval(k_a, rho, reception=reception):
        # X = (1 - k) ((1 + k) h_w/(2 tau_0) - 1): its sign is that of the headway excess
        excess = (1.0 + k) * time_headway / (2.0 * tau_max) - 1.0
        if excess < -_SLACK:
            return ExactRegion(k_a, time_headway, rho, tau_max, (), math.inf, reception)
        Q = (1.0 - k) * (1.0 + k) / (2.0 * tau_max)
        ends.append(_End(k, Q, math.sqrt(2.0 * (1.0 - k) * max(excess, 0.0))))
    z = max(_first_overlap(lower, upper, time_headway) for lower in ends for upper in ends)
    return ExactRegion(k_a, time_headway, rho, tau_max, tuple(ends), z * z, reception)


def _first_overlap(lower: _End, upper: _End, headway: float) -> float:
    """Smallest ``sqrt(k_p)`` where the lower curve of one end is below the upper of another."""
    gap = (1.0 - lower.k) / headway - upper.Q
    if gap <= 0:
        return 0.0
    z = 2.0 * gap / (upper.reach + math.sqrt(upper.reach**2 + 2.0 * headway * gap))
    if z * headway <= lower.reach:
        return z
    if lower.Q <= upper.Q:
        return lower.reach / headway
    speed = lower.reach + upper.reach
    return (lower.Q - upper.Q) / speed if speed > 0 else math.inf


class Conservatism(NamedTuple):
    """What the paper's sufficient conditions give away.

    Attributes
    ----------
    headway : float
        Paper's headway bound over the exact minimum, >= 1.
    area : float
        Area of S over the area of the exact region up to the largest ``k_p`` of S, in [0, 1];
        0 when S is empty.
    """

    headway: float
    area: float


def conservatism(
    k_a: float, time_headway: float, rho: float, tau_max: float, *, reception: float = 1.0
) -> Conservatism:
    """Compare the paper's bound and region with the exact ones.

    Examples
    --------
    >>> result = conservatism(0.5, 0.95, rho=5.0, tau_max=0.5)
    >>> round(result.headway, 4), round(result.area, 3)
    (1.3125, 0.06)
    """
    shortest = minimum_headway(k_a, rho, tau_max, reception=reception)
    ratio = headway_bound(k_a, rho, tau_max, reception=reception) / shortest
    paper = paper_region(k_a, time_headway, rho, tau_max, reception=reception)
    if not paper.nonempty:
        return Conservatism(ratio, 0.0)
    k_p_limit = max(k_p for k_p, _ in paper.polygon)
    whole = exact_region(k_a, time_headway, rho, tau_max, reception=reception).area(k_p_limit)
    return Conservatism(ratio, paper.area / whole if whole > 0 else 0.0)


def stable_gain_range(gains: Gains, tau_max: float) -> tuple[float, float] | None:
    """Range of ``k = k_a E[w]`` in [0, 1] that these gains tolerate for every lag up to `tau_max`.

    Divided by ``k_a`` it is the range of mean noise factors the platoon survives.

    Returns
    -------
    tuple of float or None
        Lowest and highest effective gain, None when no gain is string stable.

    Examples
    --------
    >>> low, high = stable_gain_range(Gains(0.95, 0.5, 0.63, 0.009), tau_max=0.5)
    >>> round(low, 6), round(high, 6)
    (0.397439, 0.655436)
    """
    require_positive("tau_max", tau_max, "s")
    h, _, k_v, k_p = gains
    require(
        all(math.isfinite(gain) for gain in gains),
        f"{gains} holds a value that is not finite: no range exists. Give finite gains.",
    )
    load = 2.0 * tau_max * gamma(gains)
    pull = h * (2.0 * k_v + h * k_p) - 2.0
    square = 4.0 * tau_max**2 * k_p
    quartic = [1.0, 0.0, 2.0 * (load - 1.0), -2.0 * square, (load - 1.0) ** 2 - square * pull]
    edges = [0.0, -0.5 * pull, *np.roots(quartic).real.tolist(), 1.0]
    edges = sorted({k for k in edges if 0.0 <= k <= 1.0})
    stable = [k for k in edges if is_string_stable(gains, tau_max, k)]
    for low, high in pairwise(edges):
        if is_string_stable(gains, tau_max, 0.5 * (low + high)):
            stable += [low, high]
    return (min(stable), max(stable)) if stable else None
