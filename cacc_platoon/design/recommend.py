"""Which design to take: a Pareto set of certified designs, and a few of them by name.

Shorter headway, latency margin, sampling margin, L-infinity gain and a fast slowest mode pull
against each other, so there is no best design; there is a front to choose from. The search is a
grid over the exact robust region with estimates; every design returned is certified exactly
(docs/theory.md, section 12 (Choosing)).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.design.candidates import Candidates, Estimates, sample_region
from cacc_platoon.design.pareto import pareto_front, ranks, spread_out
from cacc_platoon.design.requirements import (
    Design,
    Recommendation,
    Requirements,
    assess,
    paper_design,
)
from cacc_platoon.theory.errors import require
from cacc_platoon.theory.lifted_hop import MOST_INTERVAL, packet_interval
from cacc_platoon.theory.noise_interval import k_a_max
from cacc_platoon.theory.region import minimum_headway
from cacc_platoon.theory.theorem2 import optimum

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from cacc_platoon.model.control import Gains

__all__ = ["recommend"]

FRONT_SIZE = 24
_SAFETY = 1.02  # estimates are coarse; what is asked of them is a little more than required
_LONGER = (1.4, 2.0, 3.0)
_LONGEST = 2.5  # default max_headway in units of tau_max; without V2V 2 would do


def recommend(
    rho: float, tau_max: float, requirements: Requirements | None = None
) -> Recommendation:
    """Search the exact robust region and return certified designs that meet the requirements.

    Parameters
    ----------
    rho : float
        Linear signal-to-noise ratio, > 1 and finite.
    tau_max : float
        Largest actuation lag ``tau_0`` [s].
    requirements : Requirements, optional
        Period, latency, limits and given values.

    Returns
    -------
    Recommendation
        Named designs, why each, and the Pareto set. The paper's design is always listed, with
        the requirements it misses.

    Raises
    ------
    DesignError
        If a value is out of range or no design meets the requirements; the message names the
        requirement that cannot be met.

    Examples
    --------
    >>> result = recommend(5.0, 0.5, Requirements(period=0.01, latency=0.05, k_a=0.5))
    >>> result["shortest"].unmet, result["shortest"].gains.time_headway < 0.95
    ((), True)
    """
    ask = requirements or Requirements()
    ask.check(rho, tau_max)
    longest = ask.max_headway or ask.time_headway or _LONGEST * tau_max
    ask = replace(ask, max_headway=longest)
    estimates = Estimates(rho, tau_max, ask.counted_as_zero, ask.held)
    grid = _first_grid(rho, tau_max, ask)
    feasible = _filter(grid, estimates, ask, explain=True)
    costs = _estimate_costs(feasible, estimates, ask)
    keep = pareto_front(costs)
    front_candidates, costs = feasible.pick(keep), costs[keep]
    shown = spread_out(costs, FRONT_SIZE)
    chosen = [front_candidates.gains(int(i)) for i in shown]
    chosen.append(_refine_shortest(feasible, estimates, ask))
    certified = (ask.certify(gains, rho, tau_max) for gains in chosen)
    front = [Design("", certificate) for certificate in certified if ask.meets(certificate)]
    require(
        bool(front),
        "no candidate met the requirements when certified exactly: they are at the limit of what "
        "this search finds. Relax latency, period or max_linf a little.",
    )
    final = pareto_front(np.array([design.costs for design in front]))
    front = [front[int(i)] for i in final]
    return Recommendation(rho, tau_max, ask, _named(front, rho, tau_max, ask), tuple(front))


def _first_grid(rho: float, tau_max: float, ask: Requirements) -> Candidates:
    cap, longest = k_a_max(rho), ask.max_headway or _LONGEST * tau_max
    p = ask.counted_as_zero
    gains = np.unique([*(cap * np.linspace(0.08, 0.95, 9)), optimum(rho, tau_max, reception=p).k_a])
    gains = gains if ask.k_a is None else np.array([ask.k_a])
    shortest = minimum_headway(float(np.max(gains)), rho, tau_max, reception=p)
    headways = np.geomspace(min(1.002 * shortest, longest), longest, 14)
    if ask.time_headway is not None:
        headways = np.array([ask.time_headway])
    k_p = np.geomspace(3e-4, 10.0, 16) / tau_max**2
    fractions = np.array([0.03, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9])
    return sample_region(
        gains.tolist(), headways, k_p, fractions, rho=rho, tau_max=tau_max, reception=p
    )


def _filter(
    c: Candidates, estimates: Estimates, ask: Requirements, *, explain: bool = False
) -> Candidates:
    """Drop what misses a requirement; name the requirement that drops the last design."""
    if explain:
        require(
            len(c) > 0,
            f"max_headway = {ask.max_headway} s leaves no robust region that can be sampled: it is "
            "too close to the exact minimum, where k_p has no upper limit. Raise max_headway.",
        )
    for name, shown, unit, limit, measure in _demands(estimates, ask, explain=explain):
        if not len(c):
            break
        cost = measure(c)
        if explain:
            best, least = abs(float(np.min(cost))), "at least " if name == "period" else ""
            require(
                bool(np.min(cost) <= limit),
                f"{name} = {shown:.6g}{unit} is out of reach: of the designs that meet the other "
                f"requirements the best has {least}{best:.4g}{unit}, so string stability would be "
                f"lost. Relax {name}, raise max_headway or lower tau_max.",
            )
        c = c.pick(cost <= limit)
    return c


def _demands(
    estimates: Estimates, ask: Requirements, *, explain: bool
) -> list[tuple[str, float, str, float, Callable[[Candidates], NDArray[np.float64]]]]:
    """List each requirement: name, value, unit, and the upper limit on which measure it means.

    How far out of reach one is that no design meets is looked for to `explain` it.
    """

    def lost_period(c: Candidates) -> NDArray[np.float64]:
        """Negative of the longest period among period, period/2, ... that a design bears."""
        period = _SAFETY * ask.period
        for _ in range(20 if explain else 1):
            margin = estimates.joint_latency_margin(c, period)
            good = margin >= _SAFETY * (ask.latency + period)
            if good.any():
                return np.where(good, -period, 0.0)
            period *= 0.5
        return np.zeros(len(c))

    def lost_rate(c: Candidates) -> NDArray[np.float64]:
        """Likewise of the times from packet to packet."""
        interval = packet_interval(ask.v2v_period or ask.period, ask.period)
        while interval:
            good = _bears_packets(c, estimates, ask, interval)
            if good.any():
                return np.where(good, -round(interval * ask.period, 12), 0.0)
            interval = interval // 2 if explain else 0
        return np.zeros(len(c))

    late = ask.latency_margin
    demands = [
        ("latency + period", late, " s", -_SAFETY * late, _latency_cost(estimates)),
        ("period", ask.period, " s", -_SAFETY * ask.period, lost_period),
    ]
    if ask.v2v_period is not None:
        demands.append(("v2v_period", ask.v2v_period, " s", -round(ask.v2v_period, 12), lost_rate))
    if ask.max_time_constant is not None:
        slow = ask.max_time_constant
        demands.append(("max_time_constant", slow, " s", slow, estimates.slowest_time_constant))
    if ask.max_linf is not None:
        limit = 1.0 + (ask.max_linf - 1.0) / _SAFETY + 1e-9
        demands.append(("max_linf", ask.max_linf, "", limit, estimates.linf_gain))
    return demands


def _bears_packets(
    c: Candidates, estimates: Estimates, ask: Requirements, interval: int
) -> NDArray[np.bool_]:
    return estimates.bears_packets(c, ask.period, interval, ask.latency)


def _critical_interval(
    c: Candidates, estimates: Estimates, ask: Requirements
) -> NDArray[np.float64]:
    """Estimate the longest time from packet to packet, on a scale of ratios, where one is asked."""
    asked = packet_interval(ask.v2v_period or ask.period, ask.period)
    found, left = np.full(len(c), float(asked)), np.arange(len(c))
    for interval in sorted({min(round(ratio * asked), MOST_INTERVAL) for ratio in _LONGER}):
        left = left[_bears_packets(c.pick(left), estimates, ask, interval)]
        found[left] = interval
    return found


def _latency_cost(estimates: Estimates) -> Callable[[Candidates], NDArray[np.float64]]:
    return lambda c: -estimates.latency_margin(c)


def _estimate_costs(c: Candidates, estimates: Estimates, ask: Requirements) -> NDArray[np.float64]:
    margin = estimates.joint_latency_margin(c, ask.period)
    costs = [
        c.time_headway,
        -margin,
        -estimates.critical_period(c, margin, ask.latency, ask.period),
        estimates.linf_gain(c),
        estimates.slowest_time_constant(c),
    ]
    if ask.v2v_period is not None:
        costs.append(-_critical_interval(c, estimates, ask))
    return np.stack(costs, axis=1)


def _refine_shortest(feasible: Candidates, estimates: Estimates, ask: Requirements) -> Gains:
    """Shorten the headway further on ever finer grids around the shortest design so far."""
    best = feasible.gains(int(np.argmin(feasible.time_headway)))
    rho, tau_max, width = estimates.rho, estimates.tau_max, 0.2
    for _ in range(5):
        if ask.time_headway is not None:
            break
        cap = k_a_max(rho)
        k_a = np.clip(best.k_a + cap * width * np.linspace(-0.5, 0.5, 7), 0.0, 0.999 * cap)
        k_a = k_a if ask.k_a is None else np.array([ask.k_a])
        headways = best.time_headway * (1.0 - width * np.array([0.5, 0.3, 0.15, 0.05, 0.0]))
        k_p = best.k_p * np.geomspace(1.0 - 0.8 * width, 1.0 / (1.0 - 0.8 * width), 7)
        fractions = np.linspace(0.02, 0.98, 9)
        near = sample_region(
            k_a.tolist(),
            headways,
            k_p,
            fractions,
            rho=rho,
            tau_max=tau_max,
            reception=estimates.reception,
        )
        for headway in np.unique(near.time_headway):  # the shortest that will do is enough
            good = _filter(near.pick(near.time_headway == headway), estimates, ask)
            if len(good):
                best = good.gains(0)
                break
        width *= 0.6
    return best


def _named(
    front: list[Design], rho: float, tau_max: float, ask: Requirements
) -> tuple[Design, ...]:
    """Name the extremes and the middle of the front; the paper's design always comes first."""
    costs = ranks(np.array([design.costs for design in front]))
    shortest = front[int(np.argmin(costs[:, 0]))]
    tolerance = [
        min(
            one.certificate.joint_latency_margin / ask.latency_margin,
            one.certificate.joint_critical_period / ask.period,
        )
        for one in front
    ]
    robust = front[int(np.argmax(tolerance))]
    balanced = front[int(np.argmin(np.max(costs, axis=1)))]
    paper = assess(
        paper_design(rho, tau_max, reception=ask.counted_as_zero),
        rho,
        tau_max,
        ask,
        name="paper",
        reason="k_a* and 1.01 h* of Theorem 2(c), gains at the centre of S",
    )
    reasons = {
        "shortest": "shortest headway found that meets every requirement",
        "robust": "largest factor by which both latency + period and period may grow: "
        f"{max(tolerance):.3g}",
        "balanced": "smallest worst rank among headway, latency margin, critical period, "
        "L-infinity gain and slowest mode",
    }
    chosen = {"shortest": shortest, "robust": robust, "balanced": balanced}
    return (
        paper,
        *(replace(design, name=name, reason=reasons[name]) for name, design in chosen.items()),
    )
