r"""More predecessors, by reduction to one.

With ``r`` predecessors and

.. math::
    u_i = \sum_{j=1}^{r} \left[k_a w a_{i-j} - k_v (v_i - v_{i-j})
          - k_p (x_i - x_{i-j} + j d + j h_w v_i)\right]

the platoon is the one-predecessor platoon with gains ``r k_a, r k_v, r k_p`` and headway
``(r + 1) h_w/2`` (docs/theory.md, section 11 (Extensions)).
"""

from __future__ import annotations

from typing import NamedTuple

from cacc_platoon.model.control import Gains
from cacc_platoon.theory.errors import require
from cacc_platoon.theory.noise_interval import (
    checked_interval,
    effective_interval,
)
from cacc_platoon.theory.theorem2 import headway_bound, optimum

__all__ = [
    "MultiPredecessorBounds",
    "equivalent_gains",
    "multi_predecessor_bounds",
    "multi_predecessor_gains",
]


class MultiPredecessorBounds(NamedTuple):
    """Bounds for ``r`` predecessors, all headways per vehicle.

    Attributes
    ----------
    paper : float
        ``2/(r + 1) h_lb(r k_a)`` [s].
    exact : float
        ``4 tau_0/((1 + r)(1 + m r k_a))`` [s].
    optimal_k_a : float
        ``k_a*/r``.
    optimal_headway : float
        ``2 h*/(r + 1)`` [s].
    k_a_max : float
        ``1/(r (1 + 1/rho))``, excluded.
    """

    paper: float
    exact: float
    optimal_k_a: float
    optimal_headway: float
    k_a_max: float


def _check_count(predecessors: int) -> None:
    require(
        predecessors >= 1,
        f"predecessors = {predecessors} is below 1: a follower needs a vehicle to follow. Give "
        "1 or more.",
    )


def equivalent_gains(gains: Gains, predecessors: int) -> Gains:
    """One-predecessor gains equivalent to the given ones with `predecessors` predecessors.

    Examples
    --------
    >>> equivalent_gains(Gains(0.8, 0.25, 0.3, 0.005), predecessors=2)
    Gains(time_headway=1.2000000000000002, k_a=0.5, k_v=0.6, k_p=0.01)
    """
    _check_count(predecessors)
    h, k_a, k_v, k_p = gains
    r = predecessors
    return Gains(0.5 * (r + 1) * h, r * k_a, r * k_v, r * k_p)


def multi_predecessor_gains(gains: Gains, predecessors: int) -> Gains:
    """Invert `equivalent_gains`: spread a one-predecessor design over `predecessors`.

    Examples
    --------
    >>> round(multi_predecessor_gains(Gains(1.2, 0.5, 0.6, 0.01), predecessors=2).time_headway, 6)
    0.8
    """
    _check_count(predecessors)
    h, k_a, k_v, k_p = gains
    r = predecessors
    return Gains(2.0 * h / (r + 1), k_a / r, k_v / r, k_p / r)


def multi_predecessor_bounds(
    k_a: float, rho: float, tau_max: float, predecessors: int
) -> MultiPredecessorBounds:
    """Headway bounds and best gain with `predecessors` predecessors.

    Raises
    ------
    DesignError
        If ``r k_a`` is not below ``1/(1 + 1/rho)`` or another value is out of its range.

    Examples
    --------
    >>> bounds = multi_predecessor_bounds(0.25, 5.0, 0.5, predecessors=2)
    >>> round(bounds.paper, 6), round(bounds.exact, 6)
    (0.625, 0.47619)
    """
    _check_count(predecessors)
    r = predecessors
    require(
        k_a < 1.0 / (r * effective_interval(1.0, rho).high),
        f"k_a = {k_a:g} for each of {r} predecessors is not below "
        f"{1.0 / (r * effective_interval(1.0, rho).high):.6g} = 1/(r (1 + 1/rho)): their sum may "
        "reach 1 and no headway is string stable. Lower k_a.",
    )
    low, _ = checked_interval(r * k_a, rho)
    best = optimum(rho, tau_max)
    return MultiPredecessorBounds(
        paper=2.0 / (r + 1) * headway_bound(r * k_a, rho, tau_max),
        exact=4.0 * tau_max / ((1 + r) * (1.0 + low)),
        optimal_k_a=best.k_a / r,
        optimal_headway=2.0 * best.time_headway / (r + 1),
        k_a_max=1.0 / (r * effective_interval(1.0, rho).high),
    )
