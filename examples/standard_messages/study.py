"""Compare designs with standard messages: python examples/standard_messages/study.py.

Prints tables; writes study.json, study.svg and blackout.yaml, and puts the tables
into the README.md of their folder, if it has one.
"""

from __future__ import annotations

import argparse
import json
import re
import signal
import sys
from collections.abc import Sequence
from concurrent.futures import BrokenExecutor
from pathlib import Path
from typing import Any

from compute import Size, compute, runnable
from show import figure, tables, with_tables

from cacc_platoon.cli.progress import ProgressLine
from cacc_platoon.errors import UserError
from cacc_platoon.scenario.file import format_scenario
from cacc_platoon.stop_signal import EndedError, ended_by

HERE = Path(__file__).parent
DATA, FIGURE, SCENARIO, PAGE = "study.json", "study.svg", "blackout.yaml", "README.md"


def main(
    arguments: Sequence[str] | None = None, size: Size | None = None, *, workers: int = 0
) -> int:
    """Make the study and return an exit code; without workers every core has one."""
    parser = argparse.ArgumentParser(description=__doc__.partition(":")[0])
    parser.add_argument(
        "-o", "--output", type=Path, default=HERE, metavar="DIR", help="where files go"
    )
    parser.add_argument("--json", action="store_true", help="print study.json, not the tables")
    options = parser.parse_args(arguments)
    try:
        with ended_by(signal.SIGTERM, signal.SIGHUP), ProgressLine() as progress:
            options.output.mkdir(parents=True, exist_ok=True)
            study = compute(size or Size(), progress, workers)
            write(study, options.output)
    except (UserError, OSError) as error:
        return _said(str(error), 2)
    except BrokenExecutor:
        return _said("a process that computed was ended from outside, nothing is written", 1)
    except KeyboardInterrupt:
        return _said("interrupted", 130)
    except EndedError as error:
        return _said(f"stopped by {error.signal.name}", 128 + error.signal)
    print(as_json(study) if options.json else tables(study))
    return 0


def _said(text: str, code: int) -> int:
    print(f"study: {text}", file=sys.stderr)
    return code


def write(study: dict[str, Any], folder: Path) -> None:
    """Write data, figure and scenario, and the tables of the page."""
    (folder / DATA).write_text(as_json(study) + "\n", encoding="utf-8")
    (folder / FIGURE).write_text(figure(study), encoding="utf-8")
    (folder / SCENARIO).write_text(format_scenario(runnable(study)), encoding="utf-8")
    page = folder / PAGE
    if page.is_file():
        text = with_tables(page.read_text(encoding="utf-8"), study)
        page.write_text(text, encoding="utf-8")


def as_json(study: dict[str, Any]) -> str:
    """Return the study as JSON, a list of numbers in one line."""
    text = json.dumps(study, indent=1, allow_nan=False)
    return re.sub(r"\[[-\d.,e\s]+\]", lambda found: " ".join(found[0].split()), text)


if __name__ == "__main__":
    sys.exit(main())
