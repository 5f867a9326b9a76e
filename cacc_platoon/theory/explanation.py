"""The formulas with their numbers in them, and what a verdict means and asks for."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.theory.exact import is_string_stable, l2_gain, propagation_margins
from cacc_platoon.theory.noise_interval import effective_interval, k_a_max, snr_db_from_rho
from cacc_platoon.theory.region import exact_region, infimum_headway, minimum_headway
from cacc_platoon.theory.theorem2 import headway_bound, in_paper_region, optimum, paper_region
from cacc_platoon.theory.transfer import gamma, is_internally_stable

if TYPE_CHECKING:
    from cacc_platoon.model.control import Gains

__all__ = ["explain_bounds", "explain_design", "nominal_verdict", "verdict"]


def explain_bounds(rho: float, tau_max: float, k_a: float) -> list[str]:
    """Write out the bounds that do not need k_v and k_p.

    Examples
    --------
    >>> print(explain_bounds(5.0, 0.5, 0.5)[2])
    paper  h_lb = 2 tau_0 (1 - m k_a)/(1 - M^2 k_a^2) = 2*0.5*(1 - 0.4)/(1 - 0.36) = 0.9375 s
    """
    m, M = effective_interval(1.0, rho)
    low, high = effective_interval(k_a, rho)
    best = optimum(rho, tau_max)
    t = f"{tau_max:g}"
    lines = [
        f"noise  m = 1 - 1/rho = {m:.6g}, M = 1 + 1/rho = {M:.6g} at rho = {rho:.6g} "
        f"({snr_db_from_rho(rho):.4g} dB); k_a E[w] in [m k_a, M k_a] = [{low:.6g}, {high:.6g}]",
        f"cap    k_a < 1/M = {k_a_max(rho):.6g}, excluded (Theorem 2b)",
    ]
    if high < 1:
        lines += [
            f"paper  h_lb = 2 tau_0 (1 - m k_a)/(1 - M^2 k_a^2) = 2*{t}*(1 - {low:.6g})/"
            f"(1 - {high * high:.6g}) = {headway_bound(k_a, rho, tau_max):.6g} s",
            f"exact  minimum 2 tau_0/(1 + m k_a) = 2*{t}/(1 + {low:.6g}) = "
            f"{minimum_headway(k_a, rho, tau_max):.6g} s, attained with k_p large enough",
        ]
    return [
        *lines,
        f"best   k_a* = {best.k_a:.9g}, h* = {best.time_headway:.9g} s (Theorem 2c, excluded)",
        f"limit  tau_0 (1 + 1/rho) = {t}*{M:.6g} = {infimum_headway(rho, tau_max):.6g} s over all "
        "k_a, not attained",
    ]


def explain_design(gains: Gains, rho: float, tau_max: float) -> list[str]:
    """Write out the paper's region and the exact test for one design.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> print(explain_design(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5)[0])
    Routh  gamma = k_v + h_w k_p = 0.63855 > tau_0 k_p = 0.0045 and k_p > 0: internally stable
    """
    h, k_a, k_v, k_p = gains
    stable = is_internally_stable(gains, tau_max)
    lines = [
        f"Routh  gamma = k_v + h_w k_p = {gamma(gains):.6g} {'>' if stable else 'not >'} "
        f"tau_0 k_p = {tau_max * k_p:.6g} and k_p > 0: "
        f"{'internally stable' if stable else 'NOT internally stable'}"
    ]
    if k_a < k_a_max(rho):
        region = paper_region(k_a, h, rho, tau_max)
        first, second = k_v / region.a1 + k_p / region.b1, k_v / region.a2 + k_p / region.b2
        inside = in_paper_region(gains, rho, tau_max)
        lines += [
            f"paper  S1: k_v/a1 + k_p/b1 = {first:.6g} (must be <= 1), a1 = {region.a1:.6g}, "
            f"b1 = {region.b1:.6g}",
            f"paper  S2: k_v/a2 + k_p/b2 = {second:.6g} (must be >= 1), a2 = {region.a2:.6g}, "
            f"b2 = {region.b2:.6g}: {'in S' if inside else 'not in S'}"
            f"{'' if region.nonempty else ', which is empty (a1 <= a2)'}",
        ]
    for name, k in zip(("m k_a", "M k_a"), effective_interval(k_a, rho), strict=True):
        B, C, margin = propagation_margins(gains, tau_max, k)
        good = is_string_stable(gains, tau_max, k)
        lines.append(
            f"exact  k = {name} = {k:.6g}: B = {B:.6g}, C = {C:.6g}, "
            f"B + 2 tau_0 sqrt(C) = {margin:.6g}: {'sup|H| <= 1' if good else 'AMPLIFIES'}"
        )
    return lines


def verdict(gains: Gains, rho: float, tau_max: float) -> str:
    """Say in one line whether a design is robustly string stable; if not, why and what to change.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> print(verdict(Gains(0.65, 0.5, 0.63, 0.009), 5.0, 0.5).split(":")[0])
    time_headway = 0.65 s is below 0.714286 s = 2 tau_0/(1 + (1 - 1/rho) k_a)
    """
    h, k_a, _, _ = gains
    cap = k_a_max(rho)
    if not k_a < cap:
        return (
            f"k_a = {k_a:g} is not below {cap:.6g} = 1/(1 + 1/rho): the noise may raise k_a E[w] "
            f"to 1, and spacing errors grow along the platoon. Lower k_a below {cap:.6g}."
        )
    shortest = minimum_headway(k_a, rho, tau_max)
    if h < shortest * (1.0 - 1e-12):
        return (
            f"time_headway = {h:g} s is below {shortest:.6g} s = 2 tau_0/(1 + (1 - 1/rho) k_a): "
            "spacing errors grow along the platoon whatever k_v and k_p are. Raise time_headway "
            "or lower tau_max."
        )
    if all(is_string_stable(gains, tau_max, k) for k in effective_interval(k_a, rho)):
        basis = "in the paper's region S" if in_paper_region(gains, rho, tau_max) else "exact test"
        return (
            f"robustly string stable ({basis}): sup|H| = 1 for every lag up to {tau_max:g} s and "
            f"all noise of rho >= {rho:g}; error energy does not grow along the platoon."
        )
    return _gain_verdict(gains, rho, tau_max)


def nominal_verdict(gains: Gains, tau: float, k_effective: float) -> str:
    """Say in one line whether a design is string stable for one lag and one effective gain.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> print(nominal_verdict(Gains(0.95, 0.5, 0.63, 0.009), 0.5, 0.524))
    string stable at tau = 0.5 s and k_a E[w] = 0.524 alone: sup|H| = 1
    """
    where = f"at tau = {tau:g} s and k_a E[w] = {k_effective:.6g} alone"
    gain, omega = l2_gain(gains, tau, k_effective)
    if is_string_stable(gains, tau, k_effective):
        return f"string stable {where}: sup|H| = 1"
    if math.isinf(gain):
        return (
            f"not internally stable {where}: gamma = {gamma(gains):.6g} is not above tau k_p = "
            f"{tau * gains.k_p:.6g} > 0, errors grow in every vehicle. Raise k_v or lower k_p."
        )
    return (
        f"sup|H| = {gain:.9g} {where} is above 1: errors near {omega:.6g} rad/s grow at every "
        "hop. Raise time_headway, or take k_v and k_p from the exact region."
    )


def _gain_verdict(gains: Gains, rho: float, tau_max: float) -> str:
    """Explain gains outside the exact region at a headway that has one."""
    h, k_a, k_v, k_p = gains
    region = exact_region(k_a, h, rho, tau_max)
    if not k_p > 0:
        return (
            f"k_p = {k_p:g} 1/s^2 is not positive: nothing closes the gap and the spacing error "
            f"stays. Give k_p > {region.k_p_min:.6g}."
        )
    if k_p < region.k_p_min:
        return (
            f"k_p = {k_p:g} 1/s^2 is below {region.k_p_min:.6g}, the least that string stability "
            f"needs at time_headway = {h:g} s: no k_v serves both ends of the noise interval. "
            f"Raise k_p or raise time_headway above {headway_bound(k_a, rho, tau_max):.6g} s."
        )
    low, high = (float(x) for x in region.bounds(np.float64(k_p)))
    if not math.isfinite(high) or k_v < low:
        return (
            f"k_v = {k_v:g} 1/s is below {low:.6g}: slow disturbances grow along the platoon at "
            f"k_a E[w] = m k_a (C < 0). Raise k_v into [{low:.6g}, {high:.6g}] or raise k_p."
        )
    return (
        f"k_v = {k_v:g} 1/s is above {high:.6g}: disturbances near the bandwidth grow along the "
        f"platoon (B + 2 tau_0 sqrt(C) < 0). Lower k_v into [{low:.6g}, {high:.6g}]."
    )
