"""Let seeded faults happen to real platoons, and check that each ends as it may.

Processes are killed and frozen, signals sent, messages forged, disks filled, at random moments of
the start, the run and what follows it. Each platoon is a `platoon run` of its own in a DDS domain
of its own. The exit code is 0 when every one of them ended in a state of the table of faults, with
a bag that can be read and nothing left behind; where not, its folder stays.
"""

from __future__ import annotations

import argparse
import json
import shlex
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from cacc_platoon.cli.console import libraries_on_stderr, say
from cacc_platoon.cli.exit_codes import DONE, FAILED
from cacc_platoon.cli.progress import ProgressLine
from cacc_platoon.cli.ros import require_ros
from cacc_platoon.errors import UserError, printable

if TYPE_CHECKING:
    from cacc_platoon.campaign.trials import Trial


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument(
        "scenario",
        nargs="?",
        type=Path,
        help="whose platoon it is, shortened (default: a leader and three followers)",
    )
    parser.add_argument("--faults", type=int, default=20, metavar="N", help="how many (default 20)")
    parser.add_argument("--seed", type=int, default=1, help="of all of them (default 1)")
    parser.add_argument("--first", type=int, default=0, metavar="I", help="begin with this one")
    parser.add_argument("--only", default="", metavar="KIND", help="one kind of fault alone")
    parser.add_argument("--only-index", type=int, metavar="I", help="one fault alone, as it was")
    parser.add_argument("--sync", choices=("lockstep", "wall"), default="", help="such runs alone")
    parser.add_argument(
        "--jobs", type=int, default=1, metavar="N", help="platoons at once (default 1)"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help="where runs go that did not end as they may (default: runs/campaign-<UTC time>)",
    )
    parser.add_argument("--list", action="store_true", help="print the faults and do nothing")
    parser.add_argument("--json", action="store_true", help="print one JSON object and no text")


def run(options: argparse.Namespace) -> int:
    """Plan, try, print the table."""
    from cacc_platoon.campaign.answer import document, table  # noqa: PLC0415  (heavy)
    from cacc_platoon.campaign.plan import KINDS, NEEDS_NAMESPACE, plan  # noqa: PLC0415
    from cacc_platoon.campaign.trials import namespaces_work, try_all  # noqa: PLC0415
    from cacc_platoon.scenario.file import load_scenario  # noqa: PLC0415

    _check(options)
    given = load_scenario(options.scenario) if options.scenario else None
    make = partial(
        plan,
        options.seed,
        only=options.only,
        sync=options.sync,
        given=given,
        namespaces=namespaces_work(),
    )
    one = options.only_index
    numbers = range(options.first, options.first + options.faults) if one is None else [one]
    faults = [make(index) for index in numbers]
    if options.list:
        print(
            printable("\n".join(f"{f.index} {f.kind}: {KINDS[f.kind].what}, {f}" for f in faults))
        )
        return DONE
    require_ros("campaign", "platoon simulate runs a scenario")
    if not namespaces_work():
        say(f"left out, since `unshare -r -n` fails here: {', '.join(NEEDS_NAMESPACE)}")
    folder = options.output or Path("runs") / f"campaign-{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
    count = 0
    with libraries_on_stderr(), ProgressLine() as progress:

        def tell(trial: Trial) -> None:
            nonlocal count
            count += 1
            progress("faults", count, len(faults))
            if trial.findings:
                say(f"{trial.fault.index} {trial.fault.kind}: {trial.findings[0]}")

        progress("faults", 0, len(faults))
        trials = try_all(faults, folder, scenario=options.scenario, jobs=options.jobs, tell=tell)
    if options.json:
        print(json.dumps(document(options.seed, trials), indent=1, allow_nan=False))
    else:
        print(printable("\n".join(table(trials, _arguments(options)))))
    if any(trial.findings for trial in trials):
        return FAILED
    folder.rmdir()
    return DONE


def _check(options: argparse.Namespace) -> None:
    """Refuse numbers that make no campaign, and a folder in which one was."""
    for name in ("faults", "jobs"):
        if getattr(options, name) < 1:
            raise UserError(f"--{name} {getattr(options, name)} is below 1: nothing would happen.")
    if min(options.seed, options.first, options.only_index or 0) < 0:
        raise UserError("--seed, --first and --only-index are numbers from 0 on.")
    if options.output and options.output.exists():
        raise UserError(f"{options.output}: exists already. Choose another folder with -o.")


def _arguments(options: argparse.Namespace) -> str:
    """Return what decides the faults besides seed and index, as it was given."""
    given = [str(options.scenario)] if options.scenario else []
    given += ["--only", options.only] if options.only else []
    given += ["--sync", options.sync] if options.sync else []
    return "".join(f" {shlex.quote(word)}" for word in given)
