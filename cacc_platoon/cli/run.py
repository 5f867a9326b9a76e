"""Run a scenario on real ROS 2 nodes, record it and judge it.

The run folder holds the bag, the resolved scenario, run.json, metrics.json and report.html.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from pathlib import Path

from cacc_platoon.cli.progress import ProgressLine
from cacc_platoon.errors import UserError
from cacc_platoon.run_folder import default_run_folder
from cacc_platoon.scenario_file import load_scenario


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    add_scenario_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print metrics.json on stdout")
    parser.add_argument(
        "--check", action="store_true", help="exit with 3 when the platoon is not string stable"
    )


def add_scenario_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what `run` and `simulate` share."""
    parser.add_argument("scenario", type=Path, help="scenario file, for example config/paper_a.yaml")
    parser.add_argument(
        "-o", "--output", type=Path, help="run folder (default: runs/<scenario>-<UTC time>)"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="replace a parameter, for example controller.time_headway=0.9 or "
        "vehicle_5.controller.k_v=0.7; may be repeated",
    )


def run(options: argparse.Namespace) -> int:
    """Run, record, judge."""
    scenario = load_scenario(options.scenario, options.set)
    folder = options.output or default_run_folder(scenario)
    return 0
