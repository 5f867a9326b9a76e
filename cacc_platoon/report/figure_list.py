"""The pictures of a report, drawn one after the other."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from cacc_platoon.figures import channel, motion, propagation
from cacc_platoon.figures.frequency_response import plot_response
from cacc_platoon.figures.gain_region import plot_regions
from cacc_platoon.figures.picture import Picture
from cacc_platoon.model import Link
from cacc_platoon.simulation.mean_links import nominal
from cacc_platoon.theory import exact_region, k_a_max, paper_region
from cacc_platoon.theory.response_band import response_band

if TYPE_CHECKING:
    from cacc_platoon.analysis.analyse import Report
    from cacc_platoon.analysis.follower_verdict import FollowerVerdict
    from cacc_platoon.scenario import Scenario


def pictures(report: Report) -> Iterator[Picture]:
    """Yield the pictures of a report in the order of its page."""
    yield from _error_pictures(report)
    yield from _motion_pictures(report)
    yield from _channel_pictures(report)
    yield from _design_pictures(report)


def _error_pictures(report: Report) -> Iterator[Picture]:
    run, expectation, ensemble = report.run.trajectory, report.expectation, report.ensemble
    yield Picture(
        "peaks",
        "How errors travel",
        "Largest spacing error of every vehicle. The certificate is about the expectation run; "
        "single noisy runs scatter around it in any order.",
        lambda axes: propagation.plot_peaks(axes, report.measured, report.expected, ensemble),
    )
    yield Picture(
        "spacing_errors",
        "Spacing errors, this run",
        "Positive: closer to the vehicle ahead than the time headway policy asks for."
        + (" Dashed: parameters change (run.timeline)." if run.scenario.changes else ""),
        lambda axes: motion.plot_spacing_errors(axes, run),
    )
    yield Picture(
        "spacing_errors_expected",
        "Spacing errors, expectation run",
        f"The mean system of the scenario{report.left_out}, w = E[w] and losses in the mean on "
        f"every link: {_mean_of_what(run.scenario)}.",
        lambda axes: motion.plot_spacing_errors(axes, expectation),
    )
    if ensemble is not None:
        yield Picture(
            "ensemble",
            "Many noisy runs",
            "Distance from the expectation run, first and last follower: the band from the "
            "smallest to the largest of the noisy runs, and their mean.",
            lambda first, last: propagation.plot_ensemble(first, last, ensemble, expectation, run),
            rows=2,
            height=4.4,
        )
    yield Picture(
        "waterfall",
        "Waterfall",
        "The same errors, one vehicle below the other: a disturbance is seen to travel.",
        lambda axes: motion.plot_waterfall(axes, run),
        height=4.4,
    )


def _mean_of_what(scenario: Scenario) -> str:
    """Say of what the expectation run is the mean."""
    if not (assumed := nominal(scenario)):
        return "the mean of all its random runs"
    return f"not quite the mean of all its random runs, since in it {'; '.join(assumed)}"


def _motion_pictures(report: Report) -> Iterator[Picture]:
    run = report.run.trajectory
    yield Picture(
        "platoon_length",
        "Platoon length",
        "From the leader to the last follower.",
        lambda axes: motion.plot_platoon_length(
            axes, {"this run": run, "expectation run": report.expectation}
        ),
    )
    yield Picture("speeds", "Speeds", "Every vehicle.", lambda axes: motion.plot_speeds(axes, run))
    yield Picture(
        "gaps",
        "Gaps",
        "From the front of a vehicle to the rear of the one ahead; zero is a collision."
        if any(run.scenario.lengths)
        else "Point to point: d and the gap include the vehicle ahead, since vehicle.length is 0.",
        lambda axes: motion.plot_gaps(axes, run),
    )
    yield Picture(
        "accelerations",
        "Accelerations",
        "Every vehicle.",
        lambda axes: motion.plot_accelerations(axes, run),
    )
    yield Picture(
        "space_time",
        "Space and time",
        "Every vehicle's path, seen from a frame that keeps the initial speed.",
        lambda axes: motion.plot_space_time(axes, run),
    )


def _channel_pictures(report: Report) -> Iterator[Picture]:
    run = report.run.trajectory
    follower = run.scenario.indices[:2][-1]
    yield Picture(
        "noise",
        f"Noise and communicated acceleration, vehicle {follower - 1} to {follower}",
        "The noise factor w, and what it makes of the acceleration that was sent.",
        lambda noise, signal: channel.plot_noise(noise, signal, run, follower),
        rows=2,
        height=4.4,
    )
    yield Picture(
        "noise_links",
        "Noise on every link",
        "Range and mean of w that this run had.",
        lambda axes: channel.plot_link_noise(axes, report.measured.noise),
    )
    if run.arrivals is not None:
        links = len(run.scenario.topology.links)
        yield Picture(
            "packets",
            "Packets sent, lost and late",
            "Of every link, by when they were sent; lost in blackouts, too. Late: from sending to "
            "delivery, of those that arrived.",
            lambda sent, lost, late: channel.plot_packets(sent, lost, late, run),
            rows=3,
            height=min(9.0, 4.4 + 0.1 * max(0, links - 12)),
        )
        oldest, margin = _oldest(report)
        yield Picture(
            "age",
            f"Age of information, vehicle {oldest.sender} to {oldest.receiver}",
            "How long ago the newest packet that had arrived was sent, over the link where that "
            "was longest. The latency margin is of a constant latency.",
            lambda axes: channel.plot_age(axes, run, oldest, margin),
        )
    if run.timing is not None:
        yield Picture(
            "lateness",
            "Lateness of samples",
            "How long after they were due followers took their samples, by their clocks. Dashed: "
            "a control period, from which on the command before is kept.",
            lambda axes: motion.plot_lateness(axes, run),
        )
    if run.share is not None:
        yield Picture(
            "reception",
            "States of reception",
            "Who drives by the control law, and who falls back to one without V2V.",
            lambda axes: channel.plot_reception(axes, run),
        )
    if watched := report.measured.monitor:
        yield Picture(
            "monitor",
            "Alarms of the assumption monitors",
            "When no w within rho and jerk within v2v.monitor_jerk explains what a follower "
            "receives and measures.",
            lambda axes: channel.plot_alarms(axes, run, watched),
        )


def _oldest(report: Report) -> tuple[Link, float]:
    """Return the link over which information was oldest, and the latency margin of its design."""
    links = report.measured.reception
    ages = [-1.0 if math.isnan(link.age_max) else link.age_max for link in links]
    worst = report.age_margins[ages.index(max(ages))]
    return Link(worst.sender, worst.follower), worst.margin


def _design_pictures(report: Report) -> Iterator[Picture]:
    weakest = report.verdict.weakest
    if weakest.certificate is None:
        return
    share = weakest.certificate.reception
    whose = "" if report.verdict.equal_links else f" Vehicle {weakest.follower}."
    note = f"{whose}{_lost(weakest)}"
    follower = report.run.trajectory.scenario.follower(weakest.follower)
    gains, rho, tau_max = follower.gains, follower.v2v.rho, follower.tau_max
    place = report.run.trajectory.scenario.topology.links.index(follower.link)
    mean = report.measured.noise[place].expected_mean
    if weakest.internally_stable and gains.k_a > 0:
        k = share * gains.k_a * mean
        band = response_band(gains, rho, tau_max, k_effective=k, reception=share)
        yield Picture(
            "response",
            "Propagation |H(jw)|",
            "From one vehicle to the next, and close to 1. String stable (L2) means that the "
            f"whole band stays at or below 1.{note}",
            lambda far, close: plot_response(far, close, band),
            rows=2,
            height=5.6,
        )
    if 0 < gains.k_a < k_a_max(rho):
        question = gains.k_a, gains.time_headway, rho, tau_max
        paper = paper_region(*question, reception=share)
        exact = exact_region(*question, reception=share)
        yield Picture(
            "region",
            "Feasible gains",
            "Gains that are string stable for this headway, SNR and lag: exactly, and by the "
            f"paper's sufficient conditions.{note}",
            lambda axes: plot_regions(axes, paper, exact, gains),
            height=3.8,
        )


def _lost(one: FollowerVerdict) -> str:
    """Say what packet loss is to a picture of a follower's design."""
    if one.certificate is not None and one.certificate.reception < 1.0:
        return " Lost packets count as zero, I reaches down to p m k_a."
    if not one.of_loop:
        return ""
    own = " and ".join(
        what
        for what, has in (
            ("the one that holds lost packets", one.holds),
            ("the one with the run's packets", one.rare_or_late),
        )
        if has
    )
    return f" The loop {one.loop}; {own} is judged too."
