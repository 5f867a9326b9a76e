"""How every verb that ends in a verdict ends: what is printed, and the exit code."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING

from cacc_platoon.cli.console import say
from cacc_platoon.cli.exit_codes import DONE, NOT_STRING_STABLE
from cacc_platoon.errors import printable

if TYPE_CHECKING:
    from cacc_platoon.report import WrittenReport
    from cacc_platoon.scenario import Scenario


def add_verdict_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what these verbs share."""
    parser.add_argument("--json", action="store_true", help="print metrics.json and nothing else")
    parser.add_argument(
        "--check",
        action="store_true",
        help="exit 3 unless proven string stable, from data that are complete and intact",
    )


def conclude(written: WrittenReport, options: argparse.Namespace) -> int:
    """Print a report as asked for and return the exit code."""
    from cacc_platoon.report import summary  # noqa: PLC0415  (heavy)

    report, metrics = written
    if options.json:
        json.dump(metrics, sys.stdout, indent=1, allow_nan=False)
        print()
    else:
        print(printable(summary(report, metrics)))
        print(printable(f"  page   {report.folder / 'report.html'}"))
    return NOT_STRING_STABLE if options.check and not report.proven else DONE


def warn_before(scenario: Scenario) -> None:
    """Say before a run that its gains are not string stable."""
    from cacc_platoon.analysis import warn_if_not_string_stable  # noqa: PLC0415  (heavy)

    if warning := warn_if_not_string_stable(scenario):
        say(f"warning: {warning}")
