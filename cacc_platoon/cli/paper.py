"""Repeat the paper: its three cases on nodes, all its figures, and "paper says, we measured".

The folder then holds a run folder per case, figures/, paper.json and paper.html.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from cacc_platoon.cli.console import libraries_on_stderr, say
from cacc_platoon.cli.exit_codes import DONE, FAILED
from cacc_platoon.cli.progress import ProgressLine
from cacc_platoon.cli.ros import prepare_nodes, require_ros
from cacc_platoon.cli.simulate import simulate_run
from cacc_platoon.errors import UserError
from cacc_platoon.stop_signal import STOP_SIGNALS, StopSignal

if TYPE_CHECKING:
    from cacc_platoon.scenario import Scenario

EMPTY = "the paper's results would be mixed with what is there. Choose another folder with -o."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="where everything goes")
    parser.add_argument(
        "--simulate", action="store_true", help="without ROS: simulate the cases instead"
    )
    parser.add_argument("--seed", type=int, default=1, help="seed of the noise (default: 1)")
    parser.add_argument("--json", action="store_true", help="print paper.json and nothing else")


def run(options: argparse.Namespace) -> int:
    """Run the cases, draw, compare."""
    from cacc_platoon.report.write import report_run  # noqa: PLC0415
    from cacc_platoon.reproduction.cases import CASES, case_scenario  # noqa: PLC0415  (heavy)
    from cacc_platoon.reproduction.paper_page import (  # noqa: PLC0415  (heavy)
        document,
        summary,
        write_reproduction,
    )
    from cacc_platoon.reproduction.reproduce import reproduce  # noqa: PLC0415  (heavy)

    folder = options.output or Path("runs") / f"paper-{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UserError(f"{folder}: exists and is not empty, {EMPTY}")
    scenarios = {case.name: case_scenario(case, {"run.seed": options.seed}) for case in CASES}
    paths = {name: folder / f"case_{name.lower()}" for name in scenarios}
    if options.simulate:
        for name, scenario in scenarios.items():
            with ProgressLine() as progress:
                simulate_run(scenario, paths[name], progress)
    elif code := _run_on_nodes(scenarios, paths):
        return code
    reports = {}
    for name, path in paths.items():
        with ProgressLine() as progress:
            reports[name] = report_run(path, progress).report
    result = reproduce(reports)
    with ProgressLine() as progress:
        page = write_reproduction(result, folder, progress)
    if options.json:
        print(json.dumps(document(result), indent=1, allow_nan=False))
    else:
        print(f"{summary(result)}\n\n  page   {page}")
    return DONE if result.complete else FAILED


def _run_on_nodes(scenarios: Mapping[str, Scenario], paths: Mapping[str, Path]) -> int:
    """Run the cases as far as they finish; return the exit code of the one that did not."""
    with StopSignal(*STOP_SIGNALS) as stop:
        require_ros("paper", "platoon paper --simulate does")
        prepare_nodes()
        for name, scenario in scenarios.items():
            if not _run_case(scenario, paths[name], stop):
                return stop.exit_code or FAILED
    return DONE


def _run_case(scenario: Scenario, path: Path, stop: StopSignal) -> bool:
    """Run one case; say why when it did not finish."""
    from cacc_platoon.runs.info import EndStatus  # noqa: PLC0415
    from cacc_platoon.supervision.platoon_run import run_platoon  # noqa: PLC0415  (needs ROS)

    if stop.received():
        return False
    with libraries_on_stderr(), ProgressLine(scenario.run.step) as progress:
        outcome = run_platoon(scenario, path, progress, stop.received, stop.insisted)
    if outcome.status is not EndStatus.FINISHED:
        say(f"{scenario.name}: {outcome.status}: {outcome.message}")
    with libraries_on_stderr():
        outcome.leave(stop.exit_code or FAILED)
    return outcome.status is EndStatus.FINISHED
