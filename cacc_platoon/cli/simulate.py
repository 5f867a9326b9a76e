"""Run a scenario in arrays, without ROS: the same run folder and the same digest as `run`.

A Monte Carlo beside it (--runs N) shows the spread of noisy runs and that their mean is E[X].
"""

from __future__ import annotations

import argparse
import dataclasses
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from cacc_platoon.cli.judge import add_verdict_arguments, conclude, warn_before
from cacc_platoon.cli.progress import ProgressLine
from cacc_platoon.cli.run import add_scenario_arguments, load_asked
from cacc_platoon.errors import UserError
from cacc_platoon.runs.folder import RunFolder, default_run_folder
from cacc_platoon.runs.info import EndStatus

if TYPE_CHECKING:
    from cacc_platoon.scenario import Scenario

MOST_RUNS = 100_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    add_scenario_arguments(parser)
    parser.add_argument(
        "--runs", type=int, metavar="N", help="size of the Monte Carlo beside it, 0 for none"
    )
    add_verdict_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Simulate, record, judge."""
    from cacc_platoon.analysis.analyse import refuse_ensemble  # noqa: PLC0415  (heavy)
    from cacc_platoon.report import report_run  # noqa: PLC0415
    from cacc_platoon.runs.recorded_leader import with_recorded_leader  # noqa: PLC0415  (heavy)

    if options.runs is not None and (not 0 <= options.runs <= MOST_RUNS or options.runs == 1):
        raise UserError(
            f"--runs {options.runs}: must be 0 or 2 to {MOST_RUNS}; one run has no spread. "
            "Leave it out for the run of the scenario's seed alone."
        )
    scenario = with_recorded_leader(load_asked(options))
    refuse_ensemble(scenario, options.runs)
    scenario.check_own_code()
    directory = scenario.record.directory
    given = options.output or (Path(directory) if directory else None)
    warn_before(scenario)
    with ProgressLine() as progress:
        folder = simulate_run(scenario, given or default_run_folder(scenario), progress)
        written = report_run(folder.path, progress, runs=options.runs)
    return conclude(written, options)


def simulate_run(scenario: Scenario, path: Path, progress: ProgressLine | None = None) -> RunFolder:
    """Simulate a scenario into a new run folder and return the folder.

    Raises
    ------
    UserError
        When the folder exists or cannot be written.
    """
    from cacc_platoon.runs.events import append_events, events_of  # noqa: PLC0415
    from cacc_platoon.runs.recording import recording_of  # noqa: PLC0415
    from cacc_platoon.simulation import simulate  # noqa: PLC0415

    begun = time.monotonic()
    folder = RunFolder.create(path, scenario)
    try:
        trajectory = simulate(scenario, progress=_named("simulating", progress))
        wall = time.monotonic() - begun
        info = dataclasses.replace(
            folder.begun,
            status=EndStatus.FINISHED,
            samples=len(trajectory.position),
            wall_time=wall,
            real_time_factor=float(trajectory.time[-1]) / wall if wall else None,
            start_time=0.0,
        )
        append_events(path, events_of(trajectory), scenario.run.step)
        writing = _named("writing the bag", progress)
        folder.finish(scenario, recording_of(trajectory), info, writing)
    except BaseException as error:  # there is nothing that a report could be made of
        shutil.rmtree(path, ignore_errors=True)
        if isinstance(error, OSError):
            raise UserError(f"{path}: cannot be written ({error.strerror}). Make room.") from error
        raise
    return folder


def _named(what: str, progress: ProgressLine | None) -> Callable[[int, int], None] | None:
    """Return a progress function of two arguments that says what is being done."""
    return (lambda done, total: progress(what, done, total)) if progress else None
