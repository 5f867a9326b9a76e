"""A run judged: read, measured, compared with the expectation run."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from cacc_platoon.analysis.age_margin import AgeMargin, age_margins
from cacc_platoon.analysis.braking import WorstBraking, worst_braking
from cacc_platoon.analysis.clocks import Distance, distance_from
from cacc_platoon.analysis.consistency import Consistency, check_consistency
from cacc_platoon.analysis.metrics import Metrics, compute_metrics
from cacc_platoon.analysis.premises import Conduct
from cacc_platoon.analysis.standing import Recomputation, Standing, recompute, standing_of
from cacc_platoon.analysis.verdict import Verdict, judge
from cacc_platoon.bags.raw import Progress
from cacc_platoon.errors import UserError
from cacc_platoon.runs.locate import locate
from cacc_platoon.runs.recorded_run import RecordedRun, read_run
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.simulation import (
    Agreement,
    Ensemble,
    Trajectory,
    mean_agreement,
    monte_carlo,
    simulate_mean,
)

AUTOMATIC_RUNS = ((20, 400_000), (10, 2_500_000))
"""Noisy runs simulated beside the recorded one, up to so many states (samples x vehicles)."""


@dataclass(frozen=True)
class Report:
    """All that is known about a run.

    Attributes
    ----------
    folder : Path
        Where metrics.json, report.html and figures/ belong.
    run : RecordedRun
        What the bag says.
    measured : Metrics
        Of the recorded run.
    expectation : Trajectory
        The mean system of the scenario: the mean of all its noisy, lossy runs, without the
        custom code that it may name.
    expected : Metrics
        Of the expectation run.
    consistency : Consistency
        Whether the followers of the recorded run obey the equations of its scenario.
    verdict : Verdict
        The judgement of the design.
    ensemble : Ensemble or None
        Many noisy runs of the scenario, when asked for.
    """

    folder: Path
    run: RecordedRun
    measured: Metrics
    expectation: Trajectory
    expected: Metrics
    consistency: Consistency
    verdict: Verdict
    ensemble: Ensemble | None = None

    @property
    def headline(self) -> str:
        """Whether vehicles collided, the verdict, and the standing of the data, in a few words."""
        collided = "COLLISION, " if self.measured.first_collision else ""
        return f"{collided}{self.verdict.headline}, {self.standing.headline}"

    @property
    def proven(self) -> bool:
        """Whether string stability is proven of a run whose data stand: what --check asks for."""
        return self.verdict.certified and self.standing.stands

    @cached_property
    def worst_braking(self) -> WorstBraking | None:
        """The least gap over all brakings of the leader, where theory knows it."""
        return worst_braking(self.run.trajectory.scenario, self.verdict)

    @cached_property
    def age_margins(self) -> list[AgeMargin]:
        """The age of information over every link beside the latency that its design bears."""
        return age_margins(self.run.trajectory, self.verdict.followers)

    @cached_property
    def agreement(self) -> Agreement | None:
        """Whether the mean of the noisy runs is the expectation run, where that can be tested."""
        if self.ensemble is None:
            return None
        return mean_agreement(self.run.trajectory.scenario, self.ensemble, self.expectation)

    @cached_property
    def recomputed(self) -> Recomputation:
        """Whether the recorded run is what its scenario gives."""
        return recompute(self.run.trajectory, self.consistency)

    @cached_property
    def standing(self) -> Standing:
        """How the data stand."""
        return standing_of(self.run, self.recomputed)

    @cached_property
    def distance(self) -> Distance:
        """How far vehicles were at most from where they are in the expectation run."""
        return distance_from(self.run.trajectory, self.expectation)

    @property
    def left_out(self) -> str:
        """Custom code that the expectation run lacks, for a sentence; empty when there is none."""
        named = self.run.trajectory.scenario.custom_code
        return f" without {' and '.join(named)}" if named else ""


def analyse(
    path: Path | str,
    *,
    output: Path | None = None,
    scenario: Scenario | None = None,
    namespace: str | None = None,
    runs: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Read and judge a run without writing anything, except that an unfinished run is finished.

    Parameters
    ----------
    path : Path or str
        A run folder, a bag's folder or a storage file.
    output : Path, optional
        Where the report will go; the run folder, or `<bag>_report` beside a lone bag.
    scenario : Scenario, optional
        Parameters to use instead of those in the bag.
    namespace : str, optional
        Which platoon to read when the bag holds several.
    runs : int, optional
        Size of a Monte Carlo of noisy runs beside the recorded one, 0 for none; by default some
        that take a few seconds, and none where nothing is left to chance.
    progress : callable, optional
        Called periodically with what is being done, how much is done and how much there is.

    Raises
    ------
    UserError
        When there is nothing to report on.
    """
    bag, folder = locate(Path(path))
    run = read_run(bag, folder, scenario=scenario, namespace=namespace, progress=progress)
    with np.errstate(all="ignore"):  # an unstable scenario overflows, and that is its result
        measured = compute_metrics(run.trajectory)
        consistency = check_consistency(run.trajectory)
        expectation = simulate_mean(run.trajectory.scenario)
        expected = compute_metrics(expectation)
        ensemble = _ensemble(run.trajectory.scenario, runs, progress)
    return Report(
        output or folder or bag.with_name(f"{bag.stem}_report"),
        run,
        measured,
        expectation,
        expected,
        consistency,
        judge(
            run.trajectory.scenario,
            measured.noise,
            consistency,
            measured.reception,
            Conduct(measured.fallback, measured.limits, measured.clocks),
        ),
        ensemble,
    )


def refuse_ensemble(scenario: Scenario, runs: int | None) -> None:
    """Refuse noisy runs of a scenario that names custom code, which a report never runs.

    Raises
    ------
    UserError
        When such runs are asked for.
    """
    if runs and scenario.custom_code:
        raise UserError(
            f"--runs {runs}: {', '.join(scenario.custom_code)} is custom code, which a report "
            "never runs, and the runs would be those of another platoon. Leave --runs out and "
            "simulate with several values of run.seed."
        )


def _left_to_chance(follower: Follower) -> bool:
    """Return whether runs with other seeds differ, were all packets sent at the same times."""
    v2v, sensors = follower.v2v, follower.sensors
    lost = v2v.loss or v2v.burst_begin
    wrong = v2v.noise == "bits" or v2v.noise_std or sensors.range_std or sensors.range_rate_std
    return bool(lost or v2v.jitter or wrong)


def _ensemble(scenario: Scenario, runs: int | None, progress: Progress | None) -> Ensemble | None:
    """Simulate noisy runs; `runs` as in `analyse`. Code that a scenario names is not run."""
    followers = scenario.followers
    refuse_ensemble(scenario, runs)
    if scenario.custom_code:
        return None
    if not any(map(_left_to_chance, followers)):
        return None
    states = scenario.samples * (scenario.platoon.followers + 1)
    if runs is None:
        runs = next((n for n, most in AUTOMATIC_RUNS if states <= most), 0)
    if not runs:
        return None
    report = (lambda done, total: progress("noisy runs", done, total)) if progress else None
    return monte_carlo(scenario, runs, report)
