"""What others may publish on a platoon's topics: forged, malformed, too long, of other versions."""

from __future__ import annotations

import dataclasses
import json
import random
import shutil
import string
from collections.abc import Callable, Iterator
from pathlib import Path

from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.supervision.protocol import VERSION, HostPhase, HostState, RunPhase, RunStatus
from msg_adapters.topics import Graph

EVIL = "vehicle_9999/vehicle"
"""A node that no platoon of a campaign has."""


def forged_state(state: HostState, variant: str, elsewhere: Path) -> HostState:
    """Return a state as a host could have it, but for one thing that is none of its own.

    Parameters
    ----------
    state : HostState
        The last word of a host.
    variant : str
        What is changed.
    elsewhere : Path
        Where a forged part may be put.
    """
    changes: dict[str, Callable[[], HostState]] = {
        "part": lambda: dataclasses.replace(state, part=_spoiled_part(state, elsewhere)),
        "process": lambda: dataclasses.replace(state, pid=state.pid + 1),
        "stranger": lambda: dataclasses.replace(state, host="evil", nodes=(EVIL,)),
        "node": lambda: dataclasses.replace(state, nodes=(*state.nodes, EVIL)),
        "record": lambda: dataclasses.replace(state, records=(*state.records, "/elsewhere")),
        "event": lambda: dataclasses.replace(
            state, events=(RunEvent(EventKind.COLLISION, 5, EVIL),)
        ),
        "closed": lambda: dataclasses.replace(state, phase=HostPhase.CLOSED),
    }
    return changes[variant]()


def _spoiled_part(state: HostState, elsewhere: Path) -> str:
    """Return a copy of a host's part in which every message is zero."""
    copy = elsewhere / "evil"
    if state.part:
        shutil.copytree(state.part, copy)
        for file in copy.glob("*.cdr"):
            file.write_bytes(bytes(file.stat().st_size))
    return str(copy)


def forged_status(status: RunStatus, variant: str) -> RunStatus:
    """Return a status as a supervisor could send it, though not this one now."""
    changes: dict[str, Callable[[], RunStatus]] = {
        "finished": lambda: dataclasses.replace(status, phase=RunPhase.FINISHED),
        "failed": lambda: dataclasses.replace(status, phase=RunPhase.FAILED, message="forged"),
        "rival": lambda: dataclasses.replace(status, run="f00d"),
        "start": lambda: dataclasses.replace(status, start=status.start + 10**9),
    }
    return changes[variant]()


def of_another_version(text: str, ahead: int) -> str:
    """Return a message of ours as a later version might send it."""
    return json.dumps({**json.loads(text), "format": VERSION + ahead})


def oversized(text: str, megabytes: float) -> str:
    """Return a message of ours with a text in it that has no end."""
    return json.dumps({**json.loads(text), "message": "x" * int(megabytes * 1e6)})


def malformed(draw: random.Random, genuine: str, count: int) -> Iterator[str]:
    """Yield texts that no host and no supervisor of ours sends.

    Parameters
    ----------
    draw : random.Random
        Draws them.
    genuine : str
        A message of ours, to begin from.
    count : int
        How many.
    """
    fields = json.loads(genuine)
    fixed = ["", "{}", "null", "[" * 100_000, '{"format":' * 50_000, "9" * 5000, "NaN", '"\\ud800"']
    values: list[object] = [
        None,
        True,
        -1,
        10**300,
        float("nan"),
        [],
        {},
        [[]],
        "",
        "a b",
        "x/../y",
        "x" * 20_000,
    ]
    for _ in range(count):
        way = draw.random()
        if way < 0.3:
            yield draw.choice(fixed)
        elif way < 0.7:
            yield json.dumps({**fields, "format": draw.choice(values)})
        else:
            cut = [*genuine]
            for _ in range(draw.randint(1, 20)):
                cut[draw.randrange(len(cut))] = draw.choice(string.printable)
            yield "".join(cut)[: draw.randint(1, len(cut) - 1)]


def type_of(graph: Graph, topic: str) -> str:
    """Return the type of a platoon's topic, whichever it is.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> type_of(Graph.of(Scenario()), "/platoon/horizon")
    'std_msgs/msg/Int64'
    """
    for known in graph.recorded:
        if known.name == topic:
            return known.kind.type_name
    numbers = topic == graph.platoon.horizon or topic.endswith("/recorded")
    return "std_msgs/msg/Int64" if numbers else "std_msgs/msg/String"
