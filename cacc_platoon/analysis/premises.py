"""What a certificate takes for granted of a run, and where the run broke it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from cacc_platoon.analysis.age import LinkReception
from cacc_platoon.analysis.clocks import ClockUse, clock_premises
from cacc_platoon.analysis.consistency import Consistency
from cacc_platoon.analysis.content import content_premises
from cacc_platoon.analysis.fallback import FallbackUse, fallback_premises
from cacc_platoon.analysis.follower_verdict import FollowerVerdict
from cacc_platoon.analysis.limits import LimitUse, limit_premises
from cacc_platoon.analysis.noise import LinkNoise
from cacc_platoon.analysis.packets import PacketRate, packet_times, send_together
from cacc_platoon.model import ConstantTimeHeadway
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.scenario.timeline import Change
from cacc_platoon.theory import rounded_down
from cacc_platoon.theory.switching import blend_is_stable

IF_INDEPENDENT = "if losses did not depend on each other"


class Conduct(NamedTuple):
    """What vehicles did in a run beside what a certificate is of."""

    fallback: Sequence[FallbackUse] = ()
    limits: Sequence[LimitUse] = ()
    clocks: Sequence[ClockUse] = ()


def broken_premises(
    scenario: Scenario,
    noise: list[LinkNoise],
    reception: list[LinkReception],
    consistency: Consistency | None,
    conduct: Conduct,
) -> list[str]:
    """Say why a certificate does not cover the run."""
    return [
        *_own_code(scenario),
        *_changes(scenario),
        *_noise_out_of_range(noise),
        *_bursts_and_blackouts(scenario),
        *content_premises(scenario),
        *fallback_premises(scenario, conduct.fallback),
        *limit_premises(scenario, conduct.limits),
        *clock_premises(conduct.clocks),
        *_unexplained_loss(scenario, reception),
        *_departures(consistency),
    ]


def missed_by_the_loop(
    scenario: Scenario, verdicts: Sequence[FollowerVerdict], *, equal: bool
) -> list[str]:
    """Say what the sampled loop misses with its packets although each gain passes its test."""
    return [*_sampled_too_slowly(verdicts), *_growth_with_packets(scenario, verdicts, equal=equal)]


def _sampled_too_slowly(verdicts: Sequence[FollowerVerdict]) -> list[str]:
    """Say that the continuous loops of some followers pass the test and the sampled ones fail."""
    lost = [
        (one.certificate.critical_period, one.follower, one.certificate)
        for one in verdicts
        if one.certificate is not None and one.string_stable and not one.sampled
    ]
    if not lost:
        return []
    longest, worst, certificate = min(lost, key=lambda one: one[:2])
    held = " with the last packet held" if certificate.held < 1.0 else ""
    alone, count = (" alone", "") if len(lost) == 1 else ("", f" ({len(lost)} vehicles in all)")
    loop = f"the loop of vehicle {worst}{alone}, sampled every {certificate.period:g} s{held}"
    if not longest:
        return [
            f"{loop}, is not string stable, nor is it at any other run.step{count}: raise "
            "time_headway and lower run.step"
        ]
    return [
        f"{loop}, is not string stable; at periods below {rounded_down(longest)} s it is{count}: "
        "lower run.step"
    ]


def _growth_with_packets(
    scenario: Scenario, verdicts: Sequence[FollowerVerdict], *, equal: bool
) -> Iterator[str]:
    """Say where the packets of a run make errors grow, or where no theorem covers them."""
    rare = [one for one in verdicts if one.certificate is not None and one.certificate.rare]
    if rare and not equal:
        yield (
            "packets have a period of their own on unequal links: growth per hop is proven of "
            "equal ones alone"
        )
    elif rare and not send_together(scenario):
        yield (
            "packets have a period of their own and links send at different instants (v2v.phase): "
            "growth per hop is proven where all send at the same ones"
        )
    growing = {
        one.follower: one.certificate.v2v_growth
        for one in verdicts
        if one.certificate is not None
        and one.certificate.v2v_growth is not None
        and one.certificate.v2v_growth.growth > 1.0
    }
    if not growing:
        return
    worst = max(growing, key=lambda follower: growing[follower].growth)
    follower = scenario.follower(worst)
    times = packet_times(follower, scenario.run.step)
    sent = " (v2v.send_rule = cam sends less often)" if follower.triggered else ""
    were = f", {IF_INDEPENDENT}" if holds_in_bursts(follower) else ""
    count = "" if len(growing) == len(verdicts) else f" (vehicle {worst}, {len(growing)} in all)"
    found = growing[worst]
    where = " of a platoon of such followers" if len(verdicts) == 1 else ""
    yield (
        f"with {times}{sent}{were}, accelerations grow in the mean by {found.growth:.6g} per hop"
        f"{where} at {found.omega:.4g} rad/s, lag {found.tau:g} s and k = "
        f"{found.k_effective:.4g}{count}: {_remedy(follower, times)} gains that bear it "
        "(platoon design --v2v-period)"
    )


def _remedy(follower: Follower, times: PacketRate) -> str:
    """Say what to do about packets that make errors grow, up to "gains that bear it"."""
    if follower.send_times.interval > 1:
        return "send more often, or take"
    return "send with less latency, or take" if times.latency else "take"


def _own_code(scenario: Scenario) -> list[str]:
    """Name custom channels, receptions and laws, of which nothing is proven."""
    channels = sorted({f.v2v.channel for f in scenario.followers if f.v2v.channel})
    receivers = sorted({f.v2v.receiver for f in scenario.followers if f.v2v.receiver})
    return [
        *(f"v2v.channel = {name} is another channel than noise and loss" for name in channels),
        *(f"v2v.receiver = {name} does what only its own code knows" for name in receivers),
        *(
            f"the control law {name} is another one than the certified one"
            for name in other_laws(scenario)
        ),
    ]


def _changes(scenario: Scenario) -> list[str]:
    """Name the changes in the course of the run: what is proven is of what was before."""
    changes = _effective_changes(scenario)
    if not changes:
        return []
    step, first = scenario.run.step, changes[0]
    more = f" and {len(changes) - 1} more" if changes[1:] else ""
    back = restored(scenario)
    until = "" if back is None else f"; all is as before from {back:g} s on"
    return [
        f"parameters change from {first.sample * step:g} s on (run.timeline: {first.text(step)}"
        f"{more}): what is proven is of those at the beginning{until}",
        *_moving_headways(scenario),
    ]


def _effective_changes(scenario: Scenario) -> list[Change]:
    """Return the changes within the run that give a parameter another value than it had."""
    latest: dict[tuple[int, str], float] = {}
    found = []
    for one in scenario.changes:
        key = one.vehicle, one.name
        before = latest.get(key, _initial(scenario.follower(one.vehicle), one.name))
        latest[key] = one.value
        if one.sample < scenario.samples and one.value != before:
            found.append(one)
    return found


def _initial(follower: Follower, name: str) -> float:
    """Return what a parameter that may change is at the beginning."""
    group, _, field = name.partition(".")
    return float(getattr(follower.v2v if group == "v2v" else follower.gains, field))


def _moving_headways(scenario: Scenario) -> Iterator[str]:
    """Say whose time headway moves further than one Lyapunov function serves."""
    for follower in scenario.followers:
        headways = follower.headways(scenario.samples)
        if headways is None:
            continue
        least, most = float(np.min(headways)), float(np.max(headways))
        first, last = (follower.gains._replace(time_headway=end) for end in (least, most))
        if not blend_is_stable(first, last, follower.tau_max):
            yield (
                f"the time headway of vehicle {follower.index} moves between {least:g} s and "
                f"{most:g} s, and no Lyapunov function serves all in between: such changes may "
                "make it unstable"
            )


def restored(scenario: Scenario) -> float | None:
    """Return when all that a timeline changes is again what it was [s]; None where it is not."""
    changes = _effective_changes(scenario)
    ends = [0.0]
    for vehicle, name in {(one.vehicle, one.name) for one in changes}:
        own = [one for one in changes if (one.vehicle, one.name) == (vehicle, name)]
        follower = scenario.follower(vehicle)
        initial = _initial(follower, name)
        if own[-1].value != initial:
            return None
        end = own[-1].sample
        if name == "controller.time_headway":
            moved = np.flatnonzero(follower.headways(scenario.samples) != initial)
            end = int(moved[-1]) + 1 if moved.size else 0
        if end >= scenario.samples:
            return None
        ends.append(end * scenario.run.step)
    return max(ends)


def holds_in_bursts(follower: Follower) -> bool:
    """Return whether it holds the last packet while losses come in bursts."""
    return follower.v2v.burst_begin > 0.0 and follower.holds


def blackouts(scenario: Scenario) -> list[tuple[float, float]]:
    """Return begin and end [s] of each blackout that begins before the run ends."""
    step = scenario.run.step
    found = {
        (round(begin * step, 9), round(end * step, 9))
        for receiver in scenario.receivers
        for begin, end in receiver.blackouts
    }
    return sorted(pair for pair in found if pair[0] < scenario.run.duration)


def holds_again(scenario: Scenario, conduct: Conduct, void: Sequence[str]) -> float | None:
    """Return when all that voids a certificate is over [s], None where that is not within the run.

    Blackouts end, vehicles that fell back come back, limits act no longer, and what a timeline
    changed is again what it was.

    Examples
    --------
    >>> scenario = Scenario.from_values({"v2v.blackouts": [10.0, 12.0, 30.0, 31.5]})
    >>> holds_again(scenario, Conduct(), ["no packets come in blackouts"])
    31.5
    """
    dark = [end for _, end in blackouts(scenario)]
    back_again = restored(scenario) if _effective_changes(scenario) else None
    back = [one.end for one in conduct.fallback if one.turns]
    free = [one.end for one in conduct.limits if one.share]
    same = [] if back_again is None else [back_again]
    ends = [max(times) for times in (dark, back, free, same) if times]
    over = bool(ends) and len(ends) == len(void) and max(ends) < scenario.run.duration
    return max(ends) if over else None


def _bursts_and_blackouts(scenario: Scenario) -> list[str]:
    """Name losses of which no theorem knows."""
    found = []
    if any(holds_in_bursts(receiver) for receiver in scenario.receivers):
        found.append(
            "packets are lost in bursts (v2v.burst_begin) while the last one is held: what is "
            "proven is of losses that do not depend on each other"
        )
    if dark := blackouts(scenario):
        found.append(
            f"no packets come in blackouts from {dark[0][0]:g} s on, until "
            f"{max(end for _, end in dark):g} s (v2v.blackouts): what is proven is of packets that "
            "come"
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
