r"""More predecessors and lost packets, by reduction to one predecessor and a wider interval I.

With ``r`` predecessors and

.. math::
    u_i = \sum_{j=1}^{r} \left[k_a w a_{i-j} - k_v (v_i - v_{i-j})
          - k_p (x_i - x_{i-j} + j d + j h_w v_i)\right]

the platoon is the one-predecessor platoon with gains ``r k_a, r k_v, r k_p`` and headway
``(r + 1) h_w/2``. A packet that arrives with probability ``p``, counted as zero when lost, has
``k = p k_a E[w]``: the lower end of I falls to ``p (1 - 1/rho) k_a``.
"""

from __future__ import annotations

import cmath
from typing import NamedTuple

from cacc_platoon.design.errors import require, require_positive
from cacc_platoon.design.exact import is_string_stable
from cacc_platoon.design.paper import (
    EffectiveInterval,
    checked_interval,
    effective_interval,
    headway_bound,
    optimum,
)
from cacc_platoon.model.control import Gains

__all__ = [
    "MultiPredecessorBounds",
    "equivalent_gains",
    "fallback_headway",
    "hold_last_response",
    "is_reception_string_stable",
    "multi_predecessor_bounds",
    "multi_predecessor_gains",
    "reception_interval",
    "reception_minimum_headway",
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


def reception_interval(k_a: float, rho: float, reception: float) -> EffectiveInterval:
    """Interval of ``k`` when at least a share `reception` of the packets arrives, losses as zero.

    Raises
    ------
    DesignError
        If `reception` is not a probability.

    Examples
    --------
    >>> reception_interval(0.5, 5.0, reception=0.5)
    EffectiveInterval(low=0.2, high=0.6)
    """
    require(
        0 <= reception <= 1,
        f"reception = {reception:g} is not a probability: no share of packets can be outside "
        "0 to 1. Give the smallest packet reception probability.",
    )
    low, high = effective_interval(k_a, rho)
    return EffectiveInterval(reception * low, high)


def is_reception_string_stable(gains: Gains, rho: float, tau_max: float, reception: float) -> bool:
    """Robust string stability of the mean system for every reception in ``[reception, 1]``.

    Examples
    --------
    >>> is_reception_string_stable(Gains(1.1, 0.5, 0.62, 0.05), 5.0, 0.5, reception=0.9)
    True
    """
    low, high = reception_interval(gains.k_a, rho, reception)
    return high <= 1 and all(is_string_stable(gains, tau_max, k) for k in (low, high))


def reception_minimum_headway(k_a: float, rho: float, tau_max: float, reception: float) -> float:
    """Exact minimum headway ``2 tau_0/(1 + p m k_a)`` [s] at packet reception probability ``p``.

    Examples
    --------
    >>> reception_minimum_headway(0.5, 5.0, 0.5, reception=0.0) == fallback_headway(0.5)
    True
    """
    require_positive("tau_max", tau_max, "s")
    checked_interval(k_a, rho)
    return 2.0 * tau_max / (1.0 + reception_interval(k_a, rho, reception).low)


def fallback_headway(tau_max: float) -> float:
    """Headway ``2 tau_0`` [s] to open up to when V2V is lost altogether (``k_a = 0``).

    Examples
    --------
    >>> fallback_headway(0.5)
    1.0
    """
    require_positive("tau_max", tau_max, "s")
    return 2.0 * tau_max


def hold_last_response(reception: float, period: float, omega: float) -> complex:
    """Mean feed-forward filter ``p/(1 - (1 - p) z^-1)`` of a receiver that holds the last packet.

    Parameters
    ----------
    reception : float
        Packet reception probability, > 0.
    period : float
        Packet period [s].
    omega : float
        Frequency [rad/s].

    Returns
    -------
    complex
        Response at ``z = exp(j omega T)``; it multiplies ``k`` in ``N``.

    Examples
    --------
    >>> hold_last_response(0.5, 0.1, omega=0.0)
    (1+0j)
    """
    require(
        0 < reception <= 1,
        f"reception = {reception:g} is outside (0, 1]: with no packet there is nothing to hold. "
        "Give a positive packet reception probability.",
    )
    return reception / (1.0 - (1.0 - reception) * cmath.exp(-1j * omega * period))
