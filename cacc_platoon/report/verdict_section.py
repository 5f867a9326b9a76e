"""The top of the page: the verdict, what each statement rests on, and what was found."""

from __future__ import annotations

import html
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from cacc_platoon.analysis.age_margin import BASIS as AGE_BASIS
from cacc_platoon.analysis.age_margin import describe_age
from cacc_platoon.analysis.metrics import describe_growth
from cacc_platoon.notation import as_html
from cacc_platoon.report.tables import cell, text_table
from cacc_platoon.report.terminal import counted
from cacc_platoon.theory.worst_braking import SHARES

if TYPE_CHECKING:
    from cacc_platoon.analysis.analyse import Report
    from cacc_platoon.analysis.consistency import Consistency
    from cacc_platoon.analysis.follower_verdict import FollowerVerdict
    from cacc_platoon.analysis.verdict import Verdict


def verdict_section(report: Report, metrics: dict[str, Any]) -> str:
    """Return the verdict in a box, then the table of what it rests on."""
    verdict = report.verdict
    scenario = report.run.trajectory.scenario
    good = report.proven and not report.measured.collision
    kind, sign = ("good", "&#10003;") if good else ("bad", "&#10007;")
    lines = [f"<p>{as_html(_meaning(report))}</p>"]
    lines.append(f"<p><b>Data:</b> {as_html(report.standing.line)}.</p>")
    lines += [f"<p><b>Not checked:</b> {as_html(w)}.</p>" for w in report.standing.unchecked]
    if collided := report.measured.first_collision:
        lines.append(
            f"<p><b>Collision</b> of vehicle {collided[0]} with the one ahead at "
            f"{collided[1]:g} s.</p>"
        )
    lines += [f"<p><b>Void for this run:</b> {as_html(why)}.</p>" for why in verdict.void]
    if verdict.afterwards:
        lines.append(f"<p><b>Afterwards:</b> {as_html(verdict.afterwards)}.</p>")
    return (
        f'<header class="verdict {kind}"><h1>{sign} {as_html(report.headline.capitalize())}'
        f"</h1><p><b>{html.escape(scenario.name)}</b>: {counted(scenario.platoon.followers)}, "
        f"{report.measured.duration:g} s, seed {scenario.run.seed}</p>{''.join(lines)}</header>\n"
        f"{_guarantee_section(verdict)}"
        f"<h2>What the verdict rests on</h2>{_basis_table(report, metrics)}"
        "<p>The verdict follows from the run's parameters, by theorems where its basis names no "
        "number of lags. No ordering of errors in one noisy run, nor in a hundred, proves or "
        "disproves string stability.</p>\n"
        f"<h2>What happened</h2>{_outcome_table(metrics)}"
    )


def _guarantee_section(verdict: Verdict) -> str:
    """Return what is guaranteed in the mean, in the mean square, and whatever the noise does."""
    rows = verdict.guarantees
    if not rows:
        return ""
    weakest = f"; none is weaker than vehicle {verdict.weakest.follower}"
    whose = f"{weakest * (not verdict.equal_links)}{'; void for this run' * bool(verdict.void)}"
    lost = " and any packets lost" if verdict.bases.losses else ""
    heads = ("signal", "in the mean", "in the mean square", "whatever the noise does")
    note = (
        "For every lag up to tau0, in continuous time but for the mean square of noise that "
        "changes, which is of the sampled loop and of a leader whose acceleration is held between "
        "control instants; "
        "sampled, peaks grow a little more, as the table below says of a_i. "
        "In the mean: expectations, with every E[w] the SNR permits. In the mean "
        "square: the energy that the noise of this scenario adds, independent between links. "
        "Whatever the noise does: every run, with w anywhere within the SNR at every instant"
        f"{lost}{verdict.apart}. Where links have unequal E[w_i], one run's means over long "
        "holds of w included, spacing errors may grow even where accelerations do not."
    )
    return f"<h2>What is guaranteed{whose}</h2>{text_table(heads, rows)}<p>{as_html(note)}</p>\n"


def findings_section(report: Report) -> str:
    """Return the faults of the bag, or nothing."""
    found = report.run.findings
    if not found:
        return ""
    items = "".join(f"<li>{as_html(line)}</li>" for line in found)
    return (
        f'<div class="note"><b>Found in the bag ({len(found)}).</b> Samples that are missing or '
        f"not finite are left out of every number.<ul>{items}</ul></div>\n"
    )


def _meaning(report: Report) -> str:
    verdict = report.verdict
    weakest = verdict.weakest
    peaks = report.expected.max_abs_spacing_error
    course = (
        f"In the expectation run{report.left_out} the spacing error of the only follower is at "
        f"most {peaks[0]:.6f} m."
        if len(peaks) == 1
        else f"In the expectation run{report.left_out} the largest spacing error is "
        f"{describe_growth(peaks)} along the platoon, {peaks[0]:.6f} m at the first follower and "
        f"{peaks[-1]:.6f} m at the last."
    )
    if verdict.another_law:
        return (
            "Certificates are of the law of time headway and gains, which not every vehicle "
            f"follows: nothing is certified of this platoon. {course}"
        )
    mean = ", in the mean of all losses" if verdict.bases.losses else ""
    if verdict.string_stable:
        said = verdict.guarantee
        return f"{said[0].upper()}{said[1:]}: {weakest.gain}. {course}"
    if verdict.undecided:
        return f"The gains cannot be certified: {weakest.reason} {course}"
    who = "" if verdict.equal_links else f"vehicle {weakest.follower}, "
    grow = "The follower may amplify disturbances"
    if not verdict.alone:
        grow = "Disturbances may grow from vehicle to vehicle"
    return (
        f"{grow}{mean}: {who}{weakest.reason}; sup|H| = "
        f"{weakest.l2_gain:.9g} at {weakest.peak_frequency:.6g} rad/s{weakest.of_loop}. "
        f"{weakest.remedy}. {course}"
    )


def _basis_table(report: Report, metrics: dict[str, Any]) -> str:
    """Return each question, its answer and the definition and test the answer rests on."""
    of_law = report.verdict.of_law
    certified = [(asked, f"{said}{of_law}", why) for asked, said, why in _certificate_rows(report)]
    rows = [*certified, *_data_rows(report, metrics)]
    return text_table(("question", "answer", "basis"), rows)


def _certificate_rows(report: Report) -> Iterator[tuple[str, str, str]]:
    """Say what follows from the parameters alone."""
    verdict, bases = report.verdict, report.verdict.bases
    unknown = verdict.undecided
    yield "String stable, robustly (L2)", _answer(verdict.string_stable, unknown), bases.exact
    yield "Paper's own test", _answer(verdict.in_paper_region, unknown), bases.paper
    left = f", with what losses leave{bases.if_so}" if bases.losses else ""
    loops = f"the loop under zero-order hold{left}"
    yield (
        "Sampled at the control period",
        _answer(all(one.sampled for one in verdict.followers), unknown),
        f"exact test (L2) of {loops}, at {report.run.grid.step / 1e9:g} s, each vehicle behind one "
        "of the same lag; at 22 lags up to tau0, without lag, and at the worst lags between",
    )
    for loss in bases.losses:
        concerned = [one for one in verdict.followers if one.follower in loss.followers]
        fails = any(one.decided and not _with_loss(one) for one in concerned)
        open_ = not fails and not all(one.decided for one in concerned)
        void = "void: " if loss.if_so else ""
        answer = f"{void}{_answer(not fails, open_)}{loss.if_so}"
        yield f"With packet loss, in the mean{bases.apart}", answer, loss.text
    for packets in bases.packets:
        concerned = [one for one in verdict.followers if one.follower in packets.followers]
        grown = [one.certificate.v2v_growth for one in concerned if one.certificate]
        growth = max((one.growth for one in grown if one), default=math.nan)
        alike = not (verdict.equal_links or verdict.alone)
        yield (
            f"Growth per hop with these packets, in the mean{bases.apart}, at most",
            f"{_g(growth)}{', were all followers alike' * alike}{packets.if_so}",
            packets.text,
        )
    yield (
        f"Ratio of peaks of a_i per hop {verdict.hop}, in every run{verdict.apart}, at most",
        _g(verdict.sure_gain),
        bases.sure,
    )
    yield "The same in the mean, at most", _g(verdict.linf_gain), bases.linf
    if not verdict.equal_links:
        yield (
            "Unequal followers",
            f"none is weaker than vehicle {verdict.weakest.follower}",
            "certified link by link on a_i = H_i a_{i-1}; delta_i = H delta_{i-1} needs equal "
            "followers",
        )
    limited = any(one.limits() or one.stops for one in report.run.trajectory.scenario.followers)
    losses = any(one.holds for one in verdict.followers)
    parts = (("losses", losses), ("limits of actuators", limited))
    named = " and ".join(part for part, has in parts if has)
    kept = f" without {named}" if named else ""
    if braking := report.worst_braking:
        yield (
            f"Least gap over all brakings, up to {braking.deceleration:g} m/s^2 from "
            f"{braking.speed:g} m/s",
            f"{braking.gap:.2f} m" + (": collision" if braking.gap <= 0 else ""),
            f"in the mean{kept}{verdict.apart}, in continuous time, from the equilibrium spacing: "
            "the leader brakes whenever it hurts most, not only once; least of both ends of I, of "
            f"lags of {', '.join(f'{share:g}' for share in SHARES)} tau0, and of "
            + counted(braking.vehicles, "the first"),
        )


def _data_rows(report: Report, metrics: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Say whether the run kept what the certificate rests on."""
    verdict, links = report.verdict, report.measured.noise
    realised = [one.realised_stable for one in verdict.followers]
    yield (
        "With the mean noise of this run",
        "unknown" if None in realised else f"{_answer(all(realised))}{verdict.of_law}",
        "exact test (L2) with each link's realised mean of w and each follower's own tau; an "
        f"estimate from one run{_realised_with_loss(verdict)}. "
        f"End to end sup|H_1...H_N| = {_g(verdict.end_to_end_gain)}",
    )
    kept = "kept" if any(link.samples for link in links) else "no packet tells w"
    yield (
        "Channel assumption",
        "broken" if any(link.breaches for link in links) else kept,
        "1 - 1/rho <= w <= 1 + 1/rho, checked in the data: of every packet that arrived from a "
        "vehicle that accelerated, where nothing but w changes what it says",
    )
    if any(follower.counted for follower in report.run.trajectory.scenario.followers):
        yield "Age of information", describe_age(report.age_margins), f"the margin is {AGE_BASIS}"
    for (question, basis), found in zip(_RECOMPUTED, report.recomputed, strict=True):
        left_out = f"; not compared: {found.unknown}" if found.unknown else ""
        yield question, _obeyed(found), f"{basis}{left_out}"
    if ensemble := metrics["ensemble"]:
        yield "Mean of noisy runs", *_agreement(ensemble)


_OUTCOME_NOTE = (
    "At control instants, from the messages of the bag, where nothing else is said. A platoon is "
    "as long as its leader is ahead of the last vehicle. Between instants an acceleration lies "
    "between those of both, since commands are held, and a leader's is what its profile does: no "
    "gap falls below the parabola of the most unfavourable of them."
)

_RECOMPUTED = (
    (
        "The leader drives as its scenario says",
        "its position, velocity and acceleration of every sample against its profile",
    ),
    (
        "The links deliver what their channels give",
        "every packet, when it arrived and its value, against what the channel makes of the "
        "acceleration that was sent, for the run's seed",
    ),
    (
        "Followers obey their equations",
        "every recorded state against one step of plant and control law from the sample before",
    ),
)


def _obeyed(found: Consistency) -> str:
    if found.departures:
        vehicle, time, _ = min(found.departures, key=lambda one: one[1])
        return f"no, vehicle {vehicle} at {time:g} s"
    if not found.steps:
        return "unknown"
    return "to the last bit" if found.largest == 0.0 else f"within {found.largest:.2g}"


def _with_loss(one: FollowerVerdict) -> bool:
    """Return whether a follower passes the test of its mean system, sampled where it holds."""
    return one.string_stable and (one.sampled or not one.holds)


def _realised_with_loss(verdict: Verdict) -> str:
    """Say what the test with realised noise makes of lost packets."""
    if any(one.rare_or_late for one in verdict.followers):
        return "; unknown with packets that are rare or late, which no one gain describes"
    if any(one.holds for one in verdict.followers):
        return "; unknown with followers that hold lost packets, which no one gain describes"
    return ", losses in the mean" if verdict.bases.losses else ""


def _agreement(ensemble: dict[str, Any]) -> tuple[str, str]:
    """Say whether the mean of noisy runs is the expectation run, and by which test."""
    runs, apart = ensemble["runs"], ensemble["max_abs_mean_minus_expectation"]
    basis = f"the mean of delta_i over {runs} simulated runs against the expectation run"
    if apart is None:
        return "unknown, they overflow", basis
    basis += f", {apart:.3g} m apart at most"
    if (test := ensemble["agreement"]) is None:
        return "not tested", f"{basis}; there is no test with a stated level for this scenario"
    share = test["largest_share_of_bound"]
    if share is None:
        return "unknown, they overflow", basis
    basis += (
        f", at all {test['compared']} pairs of vehicle and sample at once, against a bound that "
        f"the mean of {runs} such runs leaves anywhere with a probability of at most "
        f"{test['level']:g}: "
        "Hoeffding's, for independent draws and w within the SNR, whatever their distribution"
    )
    reached = f"{100 * share:.3g} % of the bound reached"
    return f"agrees, {reached}" if share <= 1.0 else f"does not agree, {reached}", basis


def _outcome_table(metrics: dict[str, Any]) -> str:
    """Return the few numbers that sum a run up."""
    rows = [
        ("platoon length at first", "m", "platoon_length.initial", ".3f"),
        ("platoon length at most", "m", "platoon_length.max", ".3f"),
        ("platoon length at last", "m", "platoon_length.final", ".3f"),
        ("smallest gap", "m", "min_gap", ".3f"),
        ("no gap falls below, between samples either", "m", "sure_min_gap", ".3f"),
        ("mean of w over all links", "-", "noise.mean_w", ".6f"),
        ("smallest w", "-", "noise.min_w", ".6f"),
        ("largest w", "-", "noise.max_w", ".6f"),
        ("realised SNR", "dB", "noise.snr_db", ".3f"),
        ("share of packets lost, all links", "-", "loss", ".4f"),
        ("largest age of information", "s", "age.max", ".3f"),
    ]
    body = "".join(
        f'<tr><td class="text">{name} [{as_html(unit)}]</td>{cell(metrics, key, form)}</tr>'
        for name, unit, key, form in rows
    )
    collided = metrics["first_collision"]
    collision = f"vehicle {collided['follower']} at {collided['time']:g} s" if collided else "no"
    return (
        f'<div class="scroll"><table><tbody>{body}<tr><td class="text">collision</td>'
        f"<td>{collision}</td></tr></tbody></table></div><p>{as_html(_OUTCOME_NOTE)}</p>"
    )


def _answer(holds: bool, unknown: bool = False) -> str:
    return "undecided" if unknown else "yes" if holds else "no"


def _g(value: float | None) -> str:
    return "unknown" if value is None or math.isnan(value) else f"{value:.9g}"
