"""Add what hosts on other machines have recorded to the bag of a run.

A run fetches it by itself at its end; this is for parts that it could not get.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from cacc_platoon.cli.console import say
from cacc_platoon.cli.exit_codes import DONE, FAILED
from cacc_platoon.cli.progress import ProgressLine


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("path", metavar="RUN", type=Path, help="run folder")
    parser.add_argument(
        "parts", metavar="PART", nargs="+", type=Path, help="folder that a host has recorded in"
    )


def run(options: argparse.Namespace) -> int:
    """Write the bag anew and say how complete it is."""
    from cacc_platoon.runs.info import EndStatus  # noqa: PLC0415  (heavy)
    from cacc_platoon.runs.merge import merge_parts  # noqa: PLC0415  (heavy)

    with ProgressLine() as progress:
        info = merge_parts(
            options.path, options.parts, lambda k, n: progress("writing the bag", k, n)
        )
    print(f"{info.status}: digest {info.digest}")
    if info.message:
        say(info.message)
    return DONE if info.status is EndStatus.FINISHED else FAILED
