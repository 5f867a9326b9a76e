"""Replay a recorded vehicle on a live node and compare what it publishes with the bag, bit by bit.

With --set it answers what the vehicle would have done with other parameters.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cacc_platoon.cli.console import libraries_on_stderr, say
from cacc_platoon.cli.exit_codes import DONE, FAILED
from cacc_platoon.cli.progress import ProgressLine
from cacc_platoon.cli.ros import (
    add_verbose_argument,
    log_everything,
    prepare_nodes,
    require_ros,
)
from cacc_platoon.dds.domain import own_domain
from cacc_platoon.errors import UserError, printable
from cacc_platoon.scenario.names import vehicle_name
from cacc_platoon.stop_signal import STOP_SIGNALS, StopSignal

if TYPE_CHECKING:
    from cacc_platoon.replay import NodeRecord, WhatIf
    from cacc_platoon.scenario import Scenario

ANSWER_FILE, FIGURE_FILE = "replay.json", "spacing_error.svg"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("path", metavar="RUN|BAG", type=Path, help="run folder, bag or .mcap/.db3")
    parser.add_argument("--vehicle", type=int, required=True, metavar="I", help="which vehicle")
    parser.add_argument(
        "--node",
        choices=("vehicle", "noise_relay", "leader"),
        help="which of its nodes (default: the one that moves)",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="what would it have done with another parameter, e.g. controller.time_headway=0.8; "
        "may be repeated",
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help=f"write {ANSWER_FILE} and a figure there"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object and no text")
    add_verbose_argument(parser)
    parser.add_argument("--domain", type=int, help="DDS domain (default: one that nobody uses)")
    parser.add_argument("--scenario", type=Path, metavar="FILE", help="parameters of the recording")
    parser.add_argument("--namespace", help="which platoon, when the bag holds several")


def run(options: argparse.Namespace) -> int:
    """Replay, compare, answer."""
    from cacc_platoon.replay import changed_scenario, read_node  # noqa: PLC0415  (heavy)
    from cacc_platoon.scenario.file import load_scenario  # noqa: PLC0415  (heavy)

    if options.output and options.output.exists() and not options.output.is_dir():
        raise UserError(f"{options.output}: is a file. Choose another folder with -o.")
    given = load_scenario(options.scenario) if options.scenario else None
    with ProgressLine() as progress:
        record = read_node(
            options.path,
            options.vehicle,
            options.node,
            scenario=given,
            namespace=options.namespace,
            progress=progress,
        )
    scenario = changed_scenario(record, options.set) if options.set else record.scenario
    if given:
        scenario.check_own_code()
    else:
        _check_own_code(record, scenario, options.set)
    with StopSignal(*STOP_SIGNALS) as stop, _domain(options.domain):
        require_ros("replay", "platoon simulate runs a scenario")
        if options.verbose:
            log_everything()
        prepare_nodes()
        try:
            replayed = _replay(record, scenario, options, stop)
        except _FailedError as failure:
            say(str(failure))
            return stop.exit_code or FAILED
    document, lines, code = _answer(record, scenario, replayed, options)
    if options.json:
        print(json.dumps(document, indent=1, allow_nan=False))
    else:
        print(printable("\n".join(lines)))
    return code


def _check_own_code(record: NodeRecord, scenario: Scenario, settings: list[str]) -> None:
    """Refuse to run code that only a recording names, and try what a setting names."""
    from cacc_platoon.scenario.own_code import try_law  # noqa: PLC0415  (heavy)

    if record.index not in scenario.indices:
        return
    follower = scenario.follower(record.index)
    own = f"{vehicle_name(record.index)}."
    given = {setting.partition("=")[0].removeprefix(own) for setting in settings}
    for name, text in follower.own_code.items():
        if name not in given:
            raise UserError(
                f"{record.run.bag}: names {name} = {text}, code that the replay would run. If you "
                "trust it, give the parameters with --scenario FILE."
            )
    if follower.law_name:
        links = scenario.topology.links_to(record.index)
        try_law(follower, scenario.platoon.initial_speed, len(links))


class _FailedError(Exception):
    """The replay did not come to its end."""


def _replay(
    record: NodeRecord, scenario: Scenario, options: argparse.Namespace, stop: StopSignal
) -> Mapping[str, list[bytes]]:
    """Run the node and return its messages."""
    from cacc_platoon.model import State  # noqa: PLC0415
    from cacc_platoon.supervision.replay import (  # noqa: PLC0415
        ReplayFailedError,
        plan_replay,
        replay_node,
    )

    run = dataclasses.replace(scenario.run, real_time_factor=0.0)
    initial = None
    if options.set:
        initial = State(*(float(stream.values(1)[0]) for stream in record.outputs[:3]))
    plan = plan_replay(dataclasses.replace(scenario, run=run), record.node, record.index, initial)
    shown = not options.verbose
    with libraries_on_stderr(), ProgressLine(scenario.run.step, shown=shown) as progress:
        try:
            return replay_node(
                plan,
                record.feed(),
                record.expected(),
                record.samples,
                observe=progress,
                stopped=stop.received,
            )
        except ReplayFailedError as failure:
            raise _FailedError(failure) from failure


@contextlib.contextmanager
def _domain(number: int | None) -> Iterator[None]:
    """Use a DDS domain on this machine only, one that no other process of ours uses by default."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    chosen = contextlib.nullcontext(number) if number is not None else own_domain()
    with chosen as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        yield


def _answer(
    record: NodeRecord,
    scenario: Scenario,
    replayed: Mapping[str, list[bytes]],
    options: argparse.Namespace,
) -> tuple[dict[str, Any], list[str], int]:
    """Return the JSON document, the lines to print and the exit code; write what was asked for."""
    from cacc_platoon.replay import (  # noqa: PLC0415  (heavy)
        comparison_document,
        first_difference,
        possible_causes,
        what_if,
        what_if_document,
        what_if_figure,
    )

    figure, code = "", DONE
    if options.set:
        answer = what_if(record, scenario, replayed)
        figure = what_if_figure(answer, record.index, options.set)
        document = what_if_document(record, options.set, answer)
        lines = _what_if_lines(record, answer, options.set)
    elif difference := first_difference(record, replayed):
        causes, code = possible_causes(record), FAILED
        document = comparison_document(record, difference, causes)
        lines = [f"{difference}. Possible causes: {'; '.join(causes)}."]
    else:
        document = comparison_document(record)
        lines = [f"{document['messages']} messages identical{_until(record)}"]
    if code == DONE and not record.standing.stands:  # no good news without it
        lines.append(f"{record.standing.headline}: {record.standing.line}")
    if options.output:
        _write(options.output, document, figure)
    return document, lines, code


def _until(record: NodeRecord) -> str:
    return f", up to sample {record.samples - 1}: {record.notes[0]}" if record.notes else ""


def _what_if_lines(record: NodeRecord, answer: WhatIf, settings: list[str]) -> list[str]:
    before, after = answer.recorded, answer.replayed
    rows = [
        ("max |spacing error| [m]", before.max_abs_spacing_error, after.max_abs_spacing_error),
        ("smallest gap [m]", before.min_gap, after.min_gap),
        ("peak |acceleration| [m/s^2]", before.max_abs_acceleration, after.max_abs_acceleration),
    ]
    return [
        f"{vehicle_name(record.index)} with {', '.join(settings)}, given what it was given"
        f"{_until(record)}",
        f"  {'':27} {'recorded':>12} {'replayed':>12}",
        *(f"  {name:27} {old:12.6f} {new:12.6f}" for name, old, new in rows),
    ]


def _write(folder: Path, document: dict[str, Any], figure: str) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(document, indent=1, allow_nan=False)
        (folder / ANSWER_FILE).write_text(text + "\n", encoding="utf-8")
        if figure:
            (folder / FIGURE_FILE).write_text(figure, encoding="utf-8")
    except OSError as error:
        raise UserError(
            f"{folder}: cannot be written ({error.strerror}). Choose another folder with -o."
        ) from error
