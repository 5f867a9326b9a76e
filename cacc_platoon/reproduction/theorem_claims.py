"""What the paper proves, for the parameters of its example: every number is computed."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from cacc_platoon.model import Gains
from cacc_platoon.reproduction.cases import CASES, DISTANCE, RHO, TAU_0
from cacc_platoon.reproduction.claim import Claim, yes
from cacc_platoon.theory import (
    effective_interval,
    exact_region,
    gamma,
    headway_bound,
    headway_slope,
    headway_slope_roots,
    infimum_headway,
    is_string_stable,
    k_a_max,
    minimum_headway,
    optimum,
    poles,
    string_stability_map,
)
from cacc_platoon.theory.capacity import capacity
from cacc_platoon.theory.theorem2 import gamma_range

SPEED = 30.0
"""Speed [m/s] at which throughput is compared."""

_RHOS = np.geomspace(1.01, 1e6, 200)
_NEARLY_NO_NOISE = 1e9


def theorem_claims(k_mean: float) -> Iterator[Claim]:
    """Yield the statements of the theorems, their proof and their remarks.

    Parameters
    ----------
    k_mean : float
        ``k_a E[w]`` of case A.
    """
    best = optimum(RHO, TAU_0)
    yield number("Sec. IV", "largest k_a [-]", 0.8333, k_a_max(RHO), "equation (16), largest k_a")
    bound = headway_bound(0.5, RHO, TAU_0)
    yield number("Sec. IV", "headway bound at k_a = 0.5 [s]", 0.9375, bound, "Theorem 2 (b)")
    yield number("Sec. IV", "k_a* [-]", 0.3183, best.k_a, "Theorem 2 (c)")
    yield number("Sec. IV", "h* [s]", 0.8727, best.time_headway, "Theorem 2 (c)")
    yield known_gain(k_mean)
    yield worst_known_gain()
    yield from (admitted_gamma(Gains(*case[1:5])) for case in CASES if case.string_stable)
    yield from slope_signs()
    yield internal_stability(Gains(*CASES[2][1:5]))
    yield from remarks()
    yield from throughput()


def number(where: str, what: str, paper: float, measured: float, basis: str) -> Claim:
    """Compare with a number of the paper, to the four decimals it gives."""
    agrees = abs(paper - measured) < 0.5e-4 * 1.0000001
    return Claim(where, what, f"{paper:.4f}", f"{measured:.9f}", agrees, basis)


def known_gain(k: float) -> Claim:
    """Theorem 1 (b): gains at the headway of a known effective gain, none at shorter ones."""
    bound = minimum_headway(k, math.inf, TAU_0)
    at_bound = Gains(bound, k, (1.0 - k * k) / (2.0 * TAU_0), 0.1)
    holds = is_string_stable(at_bound, TAU_0, k)
    k_v, k_p = np.meshgrid(np.linspace(0.01, 4.0, 120), np.geomspace(1e-4, 10.0, 80))
    found = int(string_stability_map(0.999 * bound, k_v, k_p, TAU_0, k).sum())
    return Claim(
        "Theorem 1 (b)",
        f"headway from which gains exist, k_a E[w] = {k:.9f} known (case A) [s]",
        "2 tau_0/(1 + k_a E[w]) suffices",
        f"{bound:.9f}: at it k_p = {at_bound.k_p:g}, k_v = {at_bound.k_v:.6f} string stable: "
        f"{yes(holds)}; 0.1 % below it {found} of {k_v.size} gains",
        holds and not found,
        "exact test at tau_0, by which every smaller lag holds; below, a grid of k_p and k_v",
    )


def worst_known_gain() -> Claim:
    """Check the first half of the proof of Theorem 2 (b): the largest bound over I."""
    k_a = 0.5
    gains = np.linspace(*effective_interval(k_a, RHO), 401)
    largest = max(2.0 * TAU_0 / (1.0 + k) for k in gains.tolist())
    least = minimum_headway(k_a, RHO, TAU_0)
    there = exact_region(k_a, least * (1.0 + 1e-9), RHO, TAU_0).nonempty
    below = exact_region(k_a, least * (1.0 - 1e-6), RHO, TAU_0).nonempty
    return Claim(
        "Proof of Theorem 2",
        "largest 2 tau_0/(1 + k) over k in I, k_a = 0.5 [s]",
        "2 tau_0/(1 + m k_a), derived, then replaced by the bound of Theorem 2 (b)",
        f"{least:.6f}; robustly string stable gains there: {yes(there)}, below: {yes(below)}",
        math.isclose(largest, least, rel_tol=1e-12) and there and not below,
        "largest of 401 k in I; the exact region, which is wider than S",
    )


def admitted_gamma(gains: Gains) -> Claim:
    """Compare gamma of a case that is chosen from S with the range of the proof."""
    low, high = gamma_range(gains.k_a, gains.k_v, gains.k_p, RHO, TAU_0)
    value = gamma(gains)
    return Claim(
        "Proof of Theorem 2",
        f"gamma = k_v + h_w k_p at h_w = {gains.time_headway:g} s [1/s]",
        "sqrt(2 k_p (1 - m k_a) + k_v^2) <= gamma <= (1 - M^2 k_a^2)/(2 tau_0)",
        f"{low:.6f} <= {value:.6f} <= {high:.6f}",
        low <= value <= high,
        "both ends computed; they are C >= 0 at m k_a and B >= 0 at M k_a",
    )


def slope_signs() -> Iterator[Claim]:
    """Roots of d h_lb/d k_a and its sign between them."""
    (r1, r2), cap = headway_slope_roots(RHO), k_a_max(RHO)
    best = optimum(RHO, TAU_0)
    yield Claim(
        "Fig. f(k_a)",
        "smaller root r_1 of f [-]",
        "below the cap, the minimum of the bound",
        f"{r1:.9f} < {cap:.9f}",
        r1 < cap and math.isclose(r1, best.k_a, rel_tol=1e-12),
        "roots of f in closed form",
    )
    yield Claim(
        "Proof of Theorem 2",
        "larger root r_2 of f [-]",
        "above the cap",
        f"{r2:.9f} > {cap:.9f}",
        r2 > cap and abs(headway_slope(r2, RHO)) < 1e-9,
        "roots of f in closed form",
    )
    for name, low, high, falling in (("(0, r_1)", 0.0, r1, True), ("(r_1, 1/M)", r1, cap, False)):
        places = np.linspace(0.005, 0.995, 100).tolist()
        slopes = [_slope(low + share * (high - low)) for share in places]
        yield Claim(
            "Proof of Theorem 2",
            f"d h_lb/d k_a for k_a in {name} [s]",
            "< 0" if falling else "> 0",
            f"{min(slopes):.6g} to {max(slopes):.6g}",
            max(slopes) < 0.0 if falling else min(slopes) > 0.0,
            "differences of the bound itself at 100 gains; f has no other root there",
        )
    beyond = [headway_slope(k, RHO) for k in (0.5 * (cap + r2), 2.0 * r2)]
    yield Claim(
        "Fig. f(k_a)",
        "f between the cap and r_2, and beyond r_2 [-]",
        "r_2 need not be considered: k_a is below the cap",
        f"{beyond[0]:.6g} and {beyond[1]:.6g}",
        beyond[0] > 0.0 > beyond[1],
        "f at (cap + r_2)/2 and 2 r_2; a parabola that opens downwards",
    )


def _slope(k_a: float) -> float:
    step = 1e-6 * (k_a_max(RHO) - k_a) * min(1.0, k_a)
    ends = (headway_bound(k_a + side * step, RHO, TAU_0) for side in (1.0, -1.0))
    return (next(ends) - next(ends)) / (2.0 * step)


def internal_stability(gains: Gains) -> Claim:
    """Check the end of the proof: at h* and above the loop of every lag is stable."""
    factor = optimum(RHO, TAU_0).time_headway / TAU_0
    over_rho = min(optimum(float(rho), TAU_0).time_headway / TAU_0 for rho in _RHOS)
    slowest = float(np.max(poles(gains, TAU_0 * np.linspace(0.001, 1.0, 200)).real))
    return Claim(
        "Theorem 2 (c)",
        "internal stability at h_w >= h*: h_w k_p >= tau_0 k_p",
        "h* / tau_0 = (1 + 1/sqrt(rho))^2/(1 + 1/rho) >= 1, hence gamma > tau_0 k_p",
        f"{factor:.6f}, at least {over_rho:.6f} for 200 rho; case C: gamma - tau_0 k_p = "
        f"{gamma(gains) - TAU_0 * gains.k_p:.6f} 1/s, rightmost pole {slowest:.6f} 1/s",
        over_rho > 1.0 and gamma(gains) > TAU_0 * gains.k_p and slowest < 0.0,
        "h*/tau_0 = 1 + 2 sqrt(rho)/(1 + rho), above 1 for every rho; roots of D at 200 lags up "
        "to tau_0",
    )


def remarks() -> Iterator[Claim]:
    """Yield the limits and the three monotonicity statements of Remarks 2 and 3."""
    limit = headway_bound(0.5, _NEARLY_NO_NOISE, TAU_0)
    yield Claim(
        "Remark 2",
        "headway bound without noise, k_a = 0.5 [s]",
        "2 tau_0/(1 + k_a), as in earlier work",
        f"{limit:.9f}, from 2 tau_0/1.5 = {2 * TAU_0 / 1.5:.9f}",
        math.isclose(limit, 2 * TAU_0 / 1.5, rel_tol=1e-6),
        f"Theorem 2 (b) at rho = {_NEARLY_NO_NOISE:g}",
    )
    gains = np.linspace(0.05, 0.95, 10)
    bounds = [
        [headway_bound(k, rho, TAU_0) for rho in _RHOS.tolist() if k < k_a_max(rho)]
        for k in gains.tolist()
    ]
    steps = np.concatenate([np.diff(one) for one in bounds])
    yield Claim(
        "Remark 3",
        "headway bound at one k_a as rho falls",
        "increases",
        f"grows at {int((steps < 0).sum())} of {len(steps)} steps of rho",
        bool((steps < 0).all()),
        "10 gains, every rho of 200 that admits them; in 1/rho the numerator grows and the "
        "denominator falls",
    )
    caps = np.array([k_a_max(rho) for rho in _RHOS.tolist()])
    yield Claim(
        "Remark 3",
        "largest k_a with noise [-]",
        "smaller than 1, the one without noise",
        f"{caps.min():.6f} to {caps.max():.6f}, growing with rho: {yes(_grows(caps))}",
        bool(caps.max() < 1.0) and _grows(caps),
        f"200 rho from {_RHOS[0]:g} to {_RHOS[-1]:g}",
    )
    best = [optimum(rho, TAU_0) for rho in _RHOS.tolist()]
    k_best, headways = (np.array(part) for part in zip(*best, strict=True))
    far = optimum(_NEARLY_NO_NOISE, TAU_0)
    yield Claim(
        "Remark 3",
        "h* and k_a* as rho grows",
        "h* to tau_0, k_a* to 1",
        f"h* falls: {yes(_grows(-headways))}, k_a* grows: {yes(_grows(k_best))}; at rho = "
        f"{_NEARLY_NO_NOISE:g} {far.time_headway:.6f} s and {far.k_a:.6f}",
        _grows(-headways)
        and _grows(k_best)
        and math.isclose(far.time_headway, TAU_0, rel_tol=1e-4)
        and math.isclose(far.k_a, 1.0, rel_tol=1e-4),
        f"200 rho from {_RHOS[0]:g} to {_RHOS[-1]:g}",
    )


def throughput() -> Iterator[Claim]:
    """Yield vehicles per hour and lane of Remark 1, for the paper's headways and the least ones."""
    wide, close = (case.time_headway for case in (CASES[0], CASES[2]))
    flows = [capacity(headway, SPEED, DISTANCE) for headway in (close, wide)]
    basis = f"3600 v/(d + h_w v) at v = {SPEED:g} m/s, d = {DISTANCE:g} m with the vehicle's length"
    yield Claim(
        "Remark 1",
        f"throughput [vehicles/h and lane], h_w = {close:g} s against {wide:g} s",
        "higher",
        f"{flows[0]:.0f} against {flows[1]:.0f}",
        flows[0] > flows[1],
        basis,
    )
    best = optimum(RHO, TAU_0)
    headways = (headway_bound(0.5, RHO, TAU_0), best.time_headway)
    flows = [capacity(headway, SPEED, DISTANCE) for headway in headways]
    exact = minimum_headway(0.5, RHO, TAU_0), infimum_headway(RHO, TAU_0)
    more = [capacity(headway, SPEED, DISTANCE) for headway in exact]
    yield Claim(
        "Remark 1",
        f"throughput [vehicles/h and lane] at h* = {headways[1]:.4f} s against h_lb(0.5) = "
        f"{headways[0]:.4f} s",
        "minimising h_lb improves it",
        f"{flows[1]:.0f} against {flows[0]:.0f}; exact least headway {exact[0]:.4f} s: "
        f"{more[0]:.0f}, infimum {exact[1]:.4f} s, not attained: {more[1]:.0f}",
        flows[1] > flows[0],
        basis,
    )


def _grows(values: np.ndarray) -> bool:
    return bool((np.diff(values) > 0).all())
