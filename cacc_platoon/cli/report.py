"""Judge a recorded run: metrics, verdict, figures and one HTML page.

Reads a run folder, a bag of any ROS 2 tool or a single storage file; ROS is not needed.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from cacc_platoon.cli.judge import add_verdict_arguments, conclude
from cacc_platoon.cli.progress import ProgressLine
from cacc_platoon.dds import shared_memory


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("path", metavar="RUN|BAG", type=Path, help="run folder, bag or .mcap/.db3")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="where the report goes")
    parser.add_argument("--scenario", type=Path, metavar="FILE", help="parameters to judge by")
    parser.add_argument("--namespace", help="which platoon, when the bag holds several")
    add_verdict_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Write the report and print its summary."""
    from cacc_platoon.report import report_run  # noqa: PLC0415  (heavy)
    from cacc_platoon.scenario.file import load_scenario  # noqa: PLC0415  (heavy)

    shared_memory.sweep()  # of a run that was killed, DDS is as unfinished as the folder
    scenario = load_scenario(options.scenario) if options.scenario else None
    with ProgressLine() as progress:
        written = report_run(
            options.path,
            progress,
            output=options.output,
            scenario=scenario,
            namespace=options.namespace,
        )
    return conclude(written, options)
