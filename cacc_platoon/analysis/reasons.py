"""Why a verdict is what it is: which condition fails, and what a certificate cannot cover."""

from __future__ import annotations

from cacc_platoon.analysis.consistency import Consistency
from cacc_platoon.analysis.noise import LinkNoise
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.theory import (
    critical_period,
    headway_bound,
    is_internally_stable,
    is_robustly_string_stable,
    k_a_max,
    minimum_headway,
    propagation_margins,
)
from cacc_platoon.theory.noise_interval import effective_interval


def failing_condition(follower: Follower) -> str:
    """Say which condition fails, by value and rule."""
    gains, rho, tau_max = follower.gains, follower.v2v.rho, follower.tau_max
    if is_robustly_string_stable(gains, rho, tau_max):
        return ""
    low, high = effective_interval(gains.k_a, rho)
    if not is_internally_stable(gains, tau_max):
        return (
            f"not internally stable: k_v + h_w k_p must exceed tau0 k_p, with tau0 = {tau_max:g} s"
        )
    if high >= 1.0:
        return f"k_a = {gains.k_a:g} reaches the cap 1/(1 + 1/rho) = {k_a_max(rho):.6g}"
    shortest = minimum_headway(gains.k_a, rho, tau_max)
    if gains.time_headway < shortest:
        return (
            f"h_w = {gains.time_headway:g} s is below {shortest:.6g} s = 2 tau0/(1 + (1 - 1/rho) "
            "k_a), where no gains are string stable"
        )
    margins = [(k, propagation_margins(gains, tau_max, k)) for k in (low, high)]
    k, worst = min(margins, key=lambda pair: min(pair[1].C, pair[1].margin))
    name, value = ("C", worst.C) if worst.C < 0 else ("B + 2 tau sqrt(C)", worst.margin)
    return f"{name} = {value:.4g} < 0 at k_a E[w] = {k:g}, tau0 = {tau_max:g} s"


def sampled_too_slowly(scenario: Scenario, lost: list[int]) -> list[str]:
    """Say that the continuous loops of some followers pass the test and the sampled ones fail."""
    if not lost:
        return []
    first = scenario.follower(lost[0])
    limit = critical_period(first.gains, first.v2v.rho, first.tau_max)
    return [
        f"the loop of vehicle {lost[0]}, sampled every {scenario.run.step:g} s, is not string "
        f"stable; it is below {limit:.4g} s ({len(lost)} vehicles in all)"
    ]


def broken_premises(noise: list[LinkNoise], consistency: Consistency | None) -> list[str]:
    """Say why a certificate does not cover the run."""
    reasons = []
    broken = [link for link in noise if link.breaches]
    if broken:
        first = min(broken, key=lambda link: link.first_breach)
        samples = sum(link.breaches for link in broken)
        reasons.append(
            f"the channel left 1 - 1/rho <= w <= 1 + 1/rho on {len(broken)} of {len(noise)} links "
            f"({samples} samples), first on link {first.follower - 1} -> {first.follower} at "
            f"{first.first_breach:g} s"
        )
    if consistency and consistency.departures:
        follower, time, apart = min(consistency.departures, key=lambda item: item[1])
        reasons.append(
            f"vehicle {follower} departs from its scenario's equations at {time:g} s by "
            f"{apart:.3g} ({len(consistency.departures)} vehicles in all): other gains, another "
            "law, or data that were altered"
        )
    return reasons


def paper_bound_hint(follower: Follower) -> str:
    """Say the headway from which the paper promises gains, where it does."""
    gains, rho = follower.gains, follower.v2v.rho
    if effective_interval(gains.k_a, rho).high >= 1.0:
        return " Lower k_a or raise rho."
    bound = headway_bound(gains.k_a, rho, follower.tau_max)
    return f" The paper's bound for this k_a is h_w > {bound:.6g} s."
