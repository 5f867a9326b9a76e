"""What a certificate takes for granted of a run, and where the run broke it."""

from __future__ import annotations

from cacc_platoon.analysis.age import LinkReception
from cacc_platoon.analysis.consistency import Consistency
from cacc_platoon.analysis.content import content_premises
from cacc_platoon.analysis.fallback import FallbackUse, fallback_premises
from cacc_platoon.analysis.noise import LinkNoise
from cacc_platoon.model import ConstantTimeHeadway
from cacc_platoon.scenario import Follower, Scenario


def broken_premises(
    scenario: Scenario,
    noise: list[LinkNoise],
    reception: list[LinkReception],
    consistency: Consistency | None,
    fallback: list[FallbackUse],
) -> list[str]:
    """Say why a certificate does not cover the run."""
    return [
        *_own_code(scenario),
        *_noise_out_of_range(noise),
        *_bursts_and_blackouts(scenario),
        *content_premises(scenario),
        *fallback_premises(scenario, fallback),
        *_unexplained_loss(scenario, reception),
        *_departures(consistency),
    ]


def _own_code(scenario: Scenario) -> list[str]:
    """Name custom channels and laws, of which nothing is proven."""
    channels = sorted({f.v2v.channel for f in scenario.followers if f.v2v.channel})
    return [
        *(f"v2v.channel = {name} is another channel than noise and loss" for name in channels),
        *(
            f"the control law {name} is another one than the certified one"
            for name in other_laws(scenario)
        ),
    ]


def _bursts_and_blackouts(scenario: Scenario) -> list[str]:
    """Name losses of which no theorem knows."""
    receivers = scenario.receivers
    found = []
    if any(f.v2v.burst_begin and f.holds for f in receivers):
        found.append(
            "packets are lost in bursts (v2v.burst_begin) while the last one is held: what is "
            "proven is of losses that do not depend on each other"
        )
    if times := sorted({f.v2v.blackouts for f in receivers if f.v2v.blackouts}):
        begin, end = times[0][0], times[0][-1]
        found.append(
            f"no packets come in blackouts from {begin:g} s on, until {end:g} s (v2v.blackouts): "
            "without them the headway is that of no communication, for which nothing is proven "
            "below 2 tau0"
        )
    return found


def other_laws(scenario: Scenario) -> list[str]:
    """Name the control laws that are not the certified one; custom code is not run."""
    return sorted({name for follower in scenario.followers if (name := _other_law(follower))})


def _other_law(follower: Follower) -> str:
    if follower.law_name:
        return follower.law_name
    law = follower.law()
    return "" if type(law) is ConstantTimeHeadway else type(law).__name__


def _noise_out_of_range(noise: list[LinkNoise]) -> list[str]:
    broken = [link for link in noise if link.breaches]
    if not broken:
        return []
    first = min(broken, key=lambda link: link.first_breach)
    samples = sum(link.breaches for link in broken)
    return [
        f"the channel left 1 - 1/rho <= w <= 1 + 1/rho on {len(broken)} of {len(noise)} links "
        f"({samples} samples), first on link {first.sender} -> {first.follower} at "
        f"{first.first_breach:g} s"
    ]


def _unexplained_loss(scenario: Scenario, reception: list[LinkReception]) -> list[str]:
    """Name links that lost more than v2v.loss says; a custom channel has reasons of its own."""
    custom = {follower.index for follower in scenario.followers if follower.v2v.channel}
    broken = [link for link in reception if link.loses_too_much and link.follower not in custom]
    if not broken:
        return []
    worst = max(broken, key=lambda link: link.loss - link.loss_probability)
    return [
        f"{len(broken)} of {len(reception)} links lost more packets than v2v.loss explains, most "
        f"on link {worst.sender} -> {worst.follower}: {100 * worst.loss:.3g} % at a "
        f"probability of {100 * worst.loss_probability:.3g} %"
    ]


def _departures(consistency: Consistency | None) -> list[str]:
    if not consistency or not consistency.departures:
        return []
    follower, time, difference = min(consistency.departures, key=lambda item: item[1])
    count = len(consistency.departures)
    alone, in_all = (" alone", "") if count == 1 else ("", f" ({count} vehicles in all)")
    return [
        f"vehicle {follower}{alone} departs from its scenario's equations at {time:g} s by "
        f"{difference:.3g}{in_all}: other gains, another law, or data that were altered"
    ]
