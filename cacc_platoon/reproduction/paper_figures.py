"""The paper's figures, and some beyond it, from the runs of its three cases."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from cacc_platoon.figures import admissible_noise, channel, motion, propagation
from cacc_platoon.figures.frequency_response import plot_response
from cacc_platoon.figures.gain_region import plot_regions
from cacc_platoon.figures.headway_bounds import plot_slope
from cacc_platoon.figures.picture import Picture
from cacc_platoon.figures.style import Axes
from cacc_platoon.figures.topology import plot_topology
from cacc_platoon.model import Gains
from cacc_platoon.reproduction.cases import CASES, FOLLOWERS, RHO, TAU_0, Case
from cacc_platoon.simulation import Trajectory
from cacc_platoon.theory import exact_region, paper_region
from cacc_platoon.theory.headway_curves import slope_curve
from cacc_platoon.theory.response_band import response_band

if TYPE_CHECKING:
    from cacc_platoon.analysis.analyse import Report


def paper_pictures(reports: Mapping[str, Report]) -> Iterator[Picture]:
    """Yield the figures in the order of the paper, then those beyond it."""
    a, b, c = CASES
    run_a = reports["A"].run.trajectory
    yield Picture(
        "topology",
        "Fig. 1: platoon with V2V communication",
        "Every vehicle measures distance and velocity of the one ahead, and hears its acceleration "
        "over a link with noise of its own.",
        lambda axes: plot_topology(axes, FOLLOWERS),
        height=2.1,
    )
    yield Picture(
        "noise_cone",
        "Fig. 2: admissible noise in the communicated acceleration",
        f"At most |a|/rho, rho = {RHO:g}; dots: link 0 to 1 of the recorded run A.",
        lambda axes: admissible_noise.plot_noise_cone(axes, run_a, 0),
    )
    yield Picture(
        "noise_received",
        "Fig. 3: admissible communicated acceleration over the actual one",
        f"Between (1 - 1/rho) a and (1 + 1/rho) a, rho = {RHO:g}; dots as before.",
        lambda axes: admissible_noise.plot_received(axes, run_a, 0),
    )
    yield Picture(
        "headway_slope",
        "f(k_a)",
        "Its smaller root is k_a*, where the headway bound is least.",
        lambda axes: plot_slope(axes, slope_curve(RHO)),
    )
    yield _region(a)
    yield _response(a, reports["A"])
    yield _errors(a, reports["A"])
    yield Picture(
        "noise_link_1_2",
        "Noise and communicated acceleration, vehicle 1 to 2, case A",
        "From the recorded run.",
        lambda noise, signal: channel.plot_noise(noise, signal, run_a, 2),
        rows=2,
        height=4.4,
    )
    yield _response(b, reports["B"])
    yield _errors(b, reports["B"])
    yield _region(c)
    yield _errors(c, reports["C"])
    runs = {
        rf"$h_w$ = {case.time_headway:g} s": reports[case.name].run.trajectory for case in (a, c)
    }
    yield Picture(
        "platoon_length",
        "Platoon length, cases A and C",
        "The shorter headway makes the shorter platoon.",
        lambda axes: motion.plot_platoon_length(axes, runs),
    )
    yield from _beyond(reports)


def _beyond(reports: Mapping[str, Report]) -> Iterator[Picture]:
    for case in CASES:
        report = reports[case.name]
        yield Picture(
            f"peaks_{case.name.lower()}",
            f"Beyond the paper: how errors travel in case {case.name}",
            "Single noisy runs scatter; the expectation run, the mean of them all, shows the rule.",
            lambda axes, report=report: propagation.plot_peaks(
                axes, report.measured, report.expected, report.ensemble
            ),
        )
    yield Picture(
        "space_time",
        "Beyond the paper: space and time, case A",
        "Paths as seen from a frame that keeps the initial speed.",
        lambda axes: motion.plot_space_time(axes, reports["A"].run.trajectory),
    )


def _gains(case: Case) -> Gains:
    return Gains(case.time_headway, case.k_a, case.k_v, case.k_p)


def _region(case: Case) -> Picture:
    gains = _gains(case)
    paper = paper_region(case.k_a, case.time_headway, RHO, TAU_0)
    exact = exact_region(case.k_a, case.time_headway, RHO, TAU_0)
    return Picture(
        f"region_{case.name.lower()}",
        f"Feasible region of k_p and k_v, case {case.name}",
        "The paper's S and, around it, everything that is robustly string stable.",
        lambda axes: plot_regions(axes, paper, exact, gains),
        height=3.8,
    )


def _response(case: Case, report: Report) -> Picture:
    mean = report.measured.noise[0].expected_mean
    band = response_band(_gains(case), RHO, TAU_0, k_effective=case.k_a * mean)
    return Picture(
        f"response_{case.name.lower()}",
        f"|H(jw)| at h_w = {case.time_headway:g} s, case {case.name}",
        "The paper draws the line; the band is every lag and mean noise it allows. Below: close "
        "to 1.",
        lambda far, close: plot_response(far, close, band),
        rows=2,
        height=5.6,
    )


def _errors(case: Case, report: Report) -> Picture:
    run, expectation = report.run.trajectory, report.expectation
    return Picture(
        f"spacing_errors_{case.name.lower()}",
        f"Spacing errors, case {case.name}",
        "Above: the recorded noisy run; below: the expectation run.",
        lambda noisy, mean: _plot_errors(noisy, mean, run, expectation),
        rows=2,
        height=5.2,
    )


def _plot_errors(noisy: Axes, mean: Axes, run: Trajectory, expectation: Trajectory) -> None:
    motion.plot_spacing_errors(noisy, run)
    motion.plot_spacing_errors(mean, expectation)
