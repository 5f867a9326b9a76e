"""A report in a few lines for a terminal: the verdict first, then what it rests on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from cacc_platoon.analysis.age_margin import describe_age
from cacc_platoon.analysis.metrics import describe_growth
from cacc_platoon.analysis.monitor import monitor_line
from cacc_platoon.theory.noise_interval import effective_interval

if TYPE_CHECKING:
    from cacc_platoon.analysis.analyse import Report
    from cacc_platoon.analysis.follower_verdict import FollowerVerdict
    from cacc_platoon.analysis.verdict import Verdict
    from cacc_platoon.runs.info import ClockOffset
    from cacc_platoon.simulation.trajectory import Array

_WHOLE, _HEAD = 25, 8  # longer tables are cut down to so many rows at both ends


def summary(report: Report, metrics: dict[str, Any]) -> str:
    """Return the lines that `platoon run` and `platoon report` print."""
    scenario = report.run.trajectory.scenario
    lines = [
        f"{report.headline}: {scenario.name}, {counted(scenario.platoon.followers)}, "
        f"{report.measured.duration:g} s",
        *_verdict_lines(report),
        *_data_lines(report),
        "",
        *_error_table(report),
        "",
        *_fact_lines(report, metrics),
    ]
    if report.run.findings:
        lines += ["", f"found in the bag ({len(report.run.findings)}):"]
        lines += [f"  - {finding}" for finding in report.run.findings]
    return "\n".join(lines)


def counted(followers: int, before: str = "") -> str:
    """Return a number of followers in words, `before` which of them.

    Examples
    --------
    >>> counted(12, "the first"), counted(1, "the first"), counted(1)
    ('the first 12 followers', 'the first follower', '1 follower')
    """
    if followers == 1:
        return f"{before or 1} follower"
    return f"{before} {followers} followers".strip()


def _verdict_lines(report: Report) -> list[str]:
    verdict, scenario = report.verdict, report.run.trajectory.scenario
    weakest = verdict.weakest
    own = scenario.follower(weakest.follower)
    low, high = effective_interval(own.gains.k_a, own.v2v.rho)
    if weakest.certificate:
        low, high = weakest.certificate.interval
    failed = "undecided" if verdict.undecided else "failed"
    certificate = weakest.certificate
    share = "p " if certificate and certificate.reception < 1.0 else ""
    passed = "passed" if verdict.string_stable else f"{failed}: {weakest.reason}"
    whose, which = "", ""
    if not verdict.equal_links:
        whose = f" (vehicle {weakest.follower})"
        which = f" (vehicle {weakest.follower}; none is weaker)"
    lines = [f"  {verdict.guarantee}"] if verdict.string_stable or verdict.another_law else []
    lines += [
        f"  exact test, every lag tau <= {own.tau_max:g} s and every {share}k_a E[w] in "
        f"[{low:.4g}, {high:.4g}]{whose}: {passed}{verdict.of_law}",
        f"  sup|H| = {weakest.l2_gain:.9g} (L2, in the mean){weakest.of_loop}{which}",
        *_margin_lines(weakest),
        f"  peaks of a_i grow per hop {verdict.hop} by a factor of {verdict.sure_gain:.6g} at most "
        f"whatever the noise does{verdict.apart}, {verdict.linf_gain:.6g} in the mean in "
        f"continuous time{_linf_of(report)}",
        *_mean_square_line(verdict),
        f"  paper's Theorem 2 (sufficient){verdict.bases.of_loop}: "
        f"{'passed' if verdict.in_paper_region else 'failed'}{verdict.of_law}",
    ]
    lines += [f"  packet loss: {basis.text}" for basis in verdict.bases.losses]
    lines += [f"  packets: {basis.text}" for basis in verdict.bases.packets]
    lines += [f"  VOID for this run: {reason}" for reason in verdict.void]
    lines += [f"  {verdict.afterwards}"] if verdict.afterwards else []
    return lines


def _margin_lines(weakest: FollowerVerdict) -> list[str]:
    """Say how far it is to growth, which sup|H| = 1 does not, and what would mend a failure."""
    C, margin = weakest.margins
    lines = [
        f"  margins{weakest.of_loop}, least over I at tau0: C = {C:.4g} 1/s^2, "
        f"B + 2 tau0 sqrt(C) = {margin:.4g} (sup|H| = 1 if and only if both are >= 0)"
    ]
    found = lines if weakest.internally_stable else []
    return [*found, f"  remedy: {weakest.remedy}"] if weakest.remedy else found


def _mean_square_line(verdict: Verdict) -> list[str]:
    """Say what noise that changes in time does to the energy, where it is known."""
    found = [row for row in verdict.guarantees if row.signal == "energy of a_i"]
    return [f"  energy of a_i in the mean square: {row.mean_square}" for row in found]


def _data_lines(report: Report) -> list[str]:
    """Say how the data stand, and what no check has seen."""
    standing = report.standing
    return [f"  data: {standing.line}", *(f"  not checked: {one}" for one in standing.unchecked)]


def _linf_of(report: Report) -> str:
    """Say whose the largest gain in the mean is, where it is of another loop than sup|H|."""
    verdict = report.verdict
    largest = [one for one in verdict.followers if one.linf_gain == verdict.linf_gain]
    if not largest or any(one.loop == verdict.weakest.loop for one in largest):
        return verdict.weakest.of_loop
    return f" (vehicle {largest[0].follower}, loop {largest[0].loop})"


def _error_table(report: Report) -> list[str]:
    recorded, expected = report.measured, report.expected
    lines = [
        "             max|delta_i| [m]        hop ratio of the",
        "  follower   this run   expectation   expectation",
    ]
    ratios = [np.nan, *expected.hop_ratio_max]
    offset = report.run.scenario.leader_index
    rows = list(
        zip(recorded.max_abs_spacing_error, expected.max_abs_spacing_error, ratios, strict=True)
    )
    for number, (own, mean, ratio) in enumerate(rows, start=1):
        if number == _HEAD + 1 and len(rows) > _WHOLE:
            lines.append("       ...")
        if len(rows) <= _WHOLE or not _HEAD < number <= len(rows) - _HEAD:
            hop = "" if np.isnan(ratio) else f"{ratio:.6f}"
            lines.append(
                f"  {number + offset:8d}   {own:8.6f}   {mean:11.6f}   {hop:>11s}".rstrip()
            )
    return lines


def _fact_lines(report: Report, facts: dict[str, Any]) -> list[str]:
    noise, length = facts["noise"], facts["platoon_length"]
    peaks = report.expected.max_abs_spacing_error
    own = report.measured.max_abs_spacing_error
    gap = _number(facts["min_gap"], "m")
    collided = facts["first_collision"]
    safety = (
        f"COLLISION of vehicle {collided['follower']} at {collided['time']:g} s"
        if collided
        else "no collision"
    )
    return [
        f"  errors, expectation run{report.left_out}: {_course(peaks)}",
        f"  errors, this run:        {_course(own)} (one run proves nothing)",
        f"  platoon length: {_number(length['initial'], 'm')} at first, "
        f"{_number(length['max'], 'm')} at most, {_number(length['final'], 'm')} at last; "
        f"smallest gap {gap}{_of_points(report)}, {safety}",
        f"  noise w: mean {_number(noise['mean_w'])}, from {_number(noise['min_w'])} to "
        f"{_number(noise['max_w'])}, SNR {_number(noise['snr_db'], 'dB')}",
        *_packet_lines(report, facts),
        *_clock_lines(report, facts),
        *_monitor_lines(report),
        f"  digest {report.run.digest}",
    ]


def _course(peaks: Array) -> str:
    """Say how the largest errors went along the platoon, from which to which."""
    if len(peaks) == 1:
        return f"{peaks[0]:.6f} m at most"
    return f"{describe_growth(peaks)}, {peaks[0]:.6f} -> {peaks[-1]:.6f} m"


def _of_points(report: Report) -> str:
    """Say that gaps include vehicles, where these are points."""
    points = not any(report.run.trajectory.scenario.lengths)
    return " (vehicle.length is 0: the vehicle ahead included)" if points else ""


def _packet_lines(report: Report, facts: dict[str, Any]) -> list[str]:
    """Say what was lost and how old the newest packet was, where links may lose packets."""
    if not any(follower.counted for follower in report.run.trajectory.scenario.followers):
        return []
    age, links = facts["age"], facts["reception"]
    keys = "sent", "lost", "overtaken", "in_blackouts"
    sent, lost, overtaken, dark = (sum(link[key] for link in links) for key in keys)
    longest = max(link["bursts"]["longest"] for link in links)
    share = f" ({100 * facts['loss']:.3g} %)" if sent else ""
    more = f"; {dark} more in blackouts" if dark else ""
    return [
        f"  packets: {sent} sent, {lost} lost{share}, at most {longest} in a row, "
        f"{overtaken} overtaken{more}",
        f"  age of information on the worst link: median {_number(age['median'], 's')}, "
        f"99 % {_number(age['p99'], 's')}, at most {_number(age['max'], 's')}",
        f"  age beside the latency margin, which is of a constant latency: "
        f"{describe_age(report.age_margins)}",
    ]


def _clock_lines(report: Report, facts: dict[str, Any]) -> list[str]:
    """Say how the samples of vehicles came that keep time by clocks."""
    clocks = facts["clocks"]
    if not clocks:
        return []
    late, age = (
        {key: _largest(one[kind][key] for one in clocks) for key in ("median", "p99", "max")}
        for kind in ("lateness", "pose_age")
    )
    samples = len(report.run.trajectory.time) * len(clocks)
    overruns, apart = sum(one["overruns"] for one in clocks), facts["distance"]
    ran = "by clocks, so not bit for bit the same again; what every follower used is recorded"
    perfect = late["max"] == 0.0 and age["max"] == 0.0
    return [
        "  by clocks that agree, of vehicles that are never late" if perfect else f"  {ran}",
        f"  lateness of samples on the worst vehicle: median {_milliseconds(late['median'])}, "
        f"99 % {_milliseconds(late['p99'])}, at most {_milliseconds(late['max'])}; "
        f"{overruns} of {samples} a period late, or more ({100 * overruns / samples:.3g} %)",
        f"  age of poses on the worst vehicle: median {_number(age['median'], 's')}, "
        f"99 % {_number(age['p99'], 's')}, at most {_number(age['max'], 's')}",
        f"  distance from the expectation run: at most {_number(apart['largest'], 'm')} "
        f"(vehicle {apart['vehicle']} at {_number(apart['time'], 's')})",
        *_offset_lines(report.run.info.clock_offsets if report.run.info else {}),
    ]


def _offset_lines(offsets: Mapping[str, ClockOffset]) -> list[str]:
    """Say which host's clock was furthest from the supervisor's."""
    if not offsets:
        return []
    name, furthest = max(offsets.items(), key=lambda item: abs(item[1].offset))
    return [
        f"  clocks of hosts: at most {_milliseconds(abs(furthest.offset))} from the supervisor's "
        f"(host {name}, to within {_milliseconds(furthest.uncertainty)})"
    ]


def _largest(values: Iterable[float | None]) -> float | None:
    """Return the largest value; None where one is not known."""
    found = list(values)
    return None if None in found else max(one for one in found if one is not None)


def _milliseconds(seconds: float | None) -> str:
    return "unknown" if seconds is None else f"{1e3 * seconds:.3g} ms"


def _monitor_lines(report: Report) -> list[str]:
    """Say which monitors noticed something or should have."""
    used = report.measured.monitor
    told = [one for one in used if one.alarms or one.detections]
    lines = [f"  monitor, {monitor_line(one)}" for one in told[:_HEAD]]
    if len(told) > _HEAD:
        lines.append(f"  monitor: {len(told) - _HEAD} more vehicles, see the report")
    quiet = len(used) - len(told)
    if quiet:
        lines.append(f"  monitor: no alarm of {counted(quiet)}, which proves nothing")
    return lines


def _number(value: float | None, unit: str = "") -> str:
    return "unknown" if value is None else f"{value:.6g} {unit}".strip()
