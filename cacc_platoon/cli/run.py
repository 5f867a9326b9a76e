"""Run a scenario on real ROS 2 nodes, record it and judge it.

The run folder then holds the bag, the resolved scenario, run.json, metrics.json and report.html.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from cacc_platoon.cli.console import libraries_on_stderr, say
from cacc_platoon.cli.exit_codes import DONE, FAILED
from cacc_platoon.cli.judge import add_verdict_arguments, conclude, warn_before
from cacc_platoon.cli.progress import Progress, ProgressLine
from cacc_platoon.cli.ros import (
    add_verbose_argument,
    log_everything,
    prepare_nodes,
    require_ros,
)
from cacc_platoon.dds.environment import RANGE, is_local
from cacc_platoon.live.screen import is_screen
from cacc_platoon.runs.folder import default_run_folder
from cacc_platoon.runs.recorded_leader import with_recorded_leader
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.channel_presets import channel_names, channel_settings
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.stop_signal import STOP_SIGNALS, StopSignal

if TYPE_CHECKING:
    from cacc_platoon.supervision.platoon_run import Outcome


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    add_scenario_arguments(parser)
    parser.add_argument(
        "--no-report", action="store_true", help="only record; platoon report judges later"
    )
    parser.add_argument(
        "--no-view",
        action="store_true",
        help="on a terminal, show one line of progress and no vehicles",
    )
    add_verdict_arguments(parser)
    add_verbose_argument(parser)


def add_scenario_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what `run` and `simulate` share."""
    parser.add_argument("scenario", type=Path, help="scenario file, e.g. config/paper_a.yaml")
    parser.add_argument(
        "-o", "--output", type=Path, help="run folder (default: runs/<scenario>-<UTC time>)"
    )
    parser.add_argument(
        "--channel",
        metavar="NAME",
        help=f"the V2V channel, one of {', '.join(channel_names())}; --set changes parts of it",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="replace a parameter, e.g. controller.time_headway=0.9 or "
        "vehicle_5.controller.k_v=0.7; may be repeated",
    )


def load_asked(options: argparse.Namespace) -> Scenario:
    """Read the scenario with the channel and the values that the command line replaces."""
    channel = [] if options.channel is None else channel_settings(options.channel)
    return load_scenario(options.scenario, [*channel, *options.set])


def run(options: argparse.Namespace) -> int:
    """Run, record, judge."""
    with StopSignal(*STOP_SIGNALS) as stop:
        scenario = load_asked(options)
        return run_and_judge(scenario, options.output, options, stop)


def run_and_judge(
    scenario: Scenario,
    output: Path | None,
    options: argparse.Namespace,
    stop: StopSignal,
    progress_of: Callable[..., Progress] = ProgressLine,
) -> int:
    """Run a scenario on nodes and print the verdict; return the exit code.

    DDS is ended last, because it may hang: by then everything is written and said. `progress_of`
    makes what shows the progress, see `ProgressLine`.

    Raises
    ------
    UserError
        When ROS is not there or the run cannot start.
    """
    scenario = with_recorded_leader(scenario)
    scenario.check_own_code()
    given = output or (Path(scenario.record.directory) if scenario.record.directory else None)
    folder = given or default_run_folder(scenario)
    require_ros("run", "platoon simulate runs the same scenario")
    from cacc_platoon.supervision.host_plan import divide  # noqa: PLC0415  (needs ROS)

    prepare_nodes(len(divide(scenario, cores=len(os.sched_getaffinity(0)))))
    with libraries_on_stderr():
        from cacc_platoon.supervision.platoon_run import run_platoon  # noqa: PLC0415

        warn_before(scenario)
        if scenario.run.remote_hosts and is_local(os.environ):
            say(f"warning: hosts are met on this machine alone. Set {RANGE}=SUBNET for others.")
        if options.verbose:
            log_everything()
        if stop.received():
            say("interrupted")
            return stop.exit_code
        with _progress(scenario, options, progress_of) as progress:
            outcome = run_platoon(
                scenario, folder, progress, stop.received, stop.insisted, beside=progress.nodes
            )
    code = FAILED
    try:
        code = _judge(outcome, folder, stop, options, progress_of)
    except KeyboardInterrupt:
        code = stop.exit_code
        say("interrupted; the run is complete, platoon report judges it")
    finally:
        with libraries_on_stderr():
            outcome.leave(code)
    return code


def _progress(
    scenario: Scenario, options: argparse.Namespace, progress_of: Callable[..., Progress]
) -> Progress:
    """Return what shows the progress of a run: its vehicles, where there is a terminal."""
    shown = not options.verbose
    live = shown and progress_of is ProgressLine and not options.no_view
    if live and is_screen(sys.stderr, os.environ):
        from cacc_platoon.cli.live_progress import LiveProgress  # noqa: PLC0415  (needs ROS)

        return LiveProgress(scenario)
    return progress_of(scenario.run.step, shown=shown)


def _judge(
    outcome: Outcome,
    folder: Path,
    stop: StopSignal,
    options: argparse.Namespace,
    progress_of: Callable[..., Progress],
) -> int:
    """Say how a run ended, judge it if it is complete, and return the exit code."""
    from cacc_platoon.report import report_run  # noqa: PLC0415  (heavy)
    from cacc_platoon.runs.info import EndStatus  # noqa: PLC0415

    if outcome.status is not EndStatus.FINISHED:
        say(f"{outcome.status}: {outcome.message}")
        if folder.exists():
            say(f"what was recorded until then is in {folder}")
        return stop.exit_code or FAILED
    if stop.received():
        say(f"the run is complete in {folder}; not judged")
        return stop.exit_code
    if options.no_report:
        return DONE
    stop.release()
    with libraries_on_stderr(), progress_of() as progress:
        written = report_run(folder, progress)
    return conclude(written, options)
