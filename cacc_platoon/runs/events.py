"""events.jsonl: what happened in a run, one JSON object a line, written as it happens."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from cacc_platoon.formats import Format
from cacc_platoon.model import ReceptionState
from cacc_platoon.model.packets import Integers
from cacc_platoon.runs.info import EndStatus
from cacc_platoon.scenario.names import NodeKind, NodeName
from cacc_platoon.scenario.run_event import ACTS, MOST_TURNS, RESTS, EventKind, RunEvent
from cacc_platoon.simulation import Trajectory
from cacc_platoon.simulation.course import limits_act, reception_state
from cacc_platoon.stepping.wall import LateSamples
from cacc_platoon.texts import TextError, read_text

EVENTS_FILE = "events.jsonl"
SUPERVISOR = "supervisor"
"""Who says that a run begins and ends."""
MOST = 10_000
"""So many events go into a bag."""
FORMAT = Format(EVENTS_FILE, 1)


def event_line(event: RunEvent, step: float) -> str:
    """Return an event as a line of events.jsonl, which is also what is said on <prefix>/events.

    Examples
    --------
    >>> event_line(RunEvent(EventKind.START, 0, "supervisor"), step=0.01)
    '{"format": 1, "time": 0.0, "sample": 0, "node": "supervisor", "kind": "start", "text": ""}'
    """
    return json.dumps(
        {
            "format": FORMAT.version,
            "time": round(event.sample * step, 9),
            "sample": event.sample,
            "node": event.node,
            "kind": event.kind,
            "text": event.text,
        }
    )


def bag_events(folder: Path, samples: int) -> list[tuple[int, str]]:
    """Return sample and line of the events of a run folder, in order; none where there are none.

    Parameters
    ----------
    folder : Path
        The run folder.
    samples : int
        How many samples the run has; what happened at others is left out.
    """
    with contextlib.suppress(TextError):
        lines = read_text(folder / EVENTS_FILE).splitlines()[:MOST]
        found = [one for line in lines if (one := _sample_and_line(line, samples))]
        return sorted(found, key=lambda one: one[0])
    return []


def _sample_and_line(line: str, samples: int) -> tuple[int, str] | None:
    """Return the sample of a line, and the line; None for one that a killed run has left half."""
    with contextlib.suppress(ValueError, TypeError, KeyError, RecursionError):
        sample = json.loads(line)["sample"]
        if type(sample) is int and 0 <= sample < samples:
            return sample, line
    return None


def events_of(run: Trajectory) -> list[RunEvent]:
    """Return what happened in a run, as the nodes of it would have said."""
    last = len(run.position) - 1
    happened = [change.event for change in run.scenario.changes if change.sample <= last]
    happened += _collisions(run, last)
    return [
        RunEvent(EventKind.START, 0, SUPERVISOR),
        *sorted([*happened, *_turns(run), *_late(run)], key=lambda event: event.order),
        RunEvent(EventKind.END, last, SUPERVISOR, EndStatus.FINISHED),
    ]


def _collisions(run: Trajectory, last: int) -> list[RunEvent]:
    """Return who touched the vehicle ahead: at the last sample or, by clocks, at which first."""
    nodes = [str(NodeName(NodeKind.VEHICLE, index)) for index in run.scenario.indices]
    stops = run.scenario.run.stop_on_collision
    if run.timing is None:
        touching = run.gap[-1] <= 0.0 if run.ends_in_collision else [False] * len(nodes)
        at = [last if touches else None for touches in touching]
    else:
        step, (ahead, own) = run.scenario.run.step, (run.position[:, :-1], run.position[:, 1:])
        seen, _ = run.timing.ahead(ahead, run.velocity[:, :-1], step)
        near = seen - own <= np.array(run.scenario.lengths[:-1])
        at = [int(np.argmax(one)) if stops and one.any() else None for one in near.T]
    return [
        RunEvent(EventKind.COLLISION, sample, node)
        for sample, node in zip(at, nodes, strict=True)
        if sample is not None
    ]


def _turns(run: Trajectory) -> list[RunEvent]:
    """Return when receptions went to another state, and limits began and ceased to act."""
    found: list[RunEvent] = []
    acts = limits_act(run)
    for column, follower in enumerate(run.scenario.followers):
        node = str(NodeName(NodeKind.VEHICLE, follower.index))
        if run.share is not None:
            names = [state.name.lower() for state in ReceptionState]
            states = reception_state(run.share[:, column])
            found += _turns_of(EventKind.RECEPTION, node, states, names)
        states = acts[:, column].astype(np.int64)
        found += _turns_of(EventKind.LIMIT, node, states, [RESTS, ACTS])
    return found


def _late(run: Trajectory) -> list[RunEvent]:
    """Return when the samples of vehicles by clocks were late for long."""
    found: list[RunEvent] = []
    if run.timing is None:
        return found
    for index, lateness in zip(run.scenario.indices, run.timing.lateness.T.tolist(), strict=True):
        node = str(NodeName(NodeKind.VEHICLE, index))
        late = LateSamples(run.scenario.run.step, node, found.append)
        for sample, one in enumerate(lateness):
            late.take(sample, one)
    return found


def _turns_of(kind: EventKind, node: str, states: Integers, names: Sequence[str]) -> list[RunEvent]:
    samples = np.flatnonzero(np.diff(states, prepend=0))[:MOST_TURNS]
    return [RunEvent(kind, k, node, names[states[k]]) for k in samples.tolist()]


def settle_events(folder: Path, samples: int) -> None:
    """Put the events of a run folder in order, and leave out what is not of the run.

    Hosts tell what happens when they are asked, and vehicles ahead may have gone on while those
    behind ran into each other. What is no event of this format is left as it is, at the end.

    Parameters
    ----------
    folder : Path
        The run folder.
    samples : int
        How many samples the run has.
    """
    with contextlib.suppress(TextError, OSError):
        lines = read_text(folder / EVENTS_FILE).splitlines()
        known = [(event, line) for line in lines if (event := read_event(line))]
        other = [line for line in lines if not read_event(line)]
        known = [one for one in known if one[0].sample < samples]
        ordered = [line for _, line in sorted(known, key=lambda one: one[0].order)]
        written = folder / f"{EVENTS_FILE}.new"
        written.write_text("".join(f"{line}\n" for line in (*ordered, *other)), encoding="utf-8")
        written.replace(folder / EVENTS_FILE)


def read_event(line: str) -> RunEvent | None:
    """Return the event of a line; None for what is none."""
    with contextlib.suppress(ValueError, TypeError, KeyError, RecursionError):
        found = json.loads(line)
        kind, sample = EventKind(found["kind"]), found["sample"]
        if type(sample) is int and sample >= 0:
            return RunEvent(kind, sample, str(found["node"]), str(found["text"]))
    return None


def append_events(folder: Path, events: Iterable[RunEvent], step: float) -> None:
    """Append events to those of a run folder."""
    with (folder / EVENTS_FILE).open("a", encoding="utf-8") as file:
        file.writelines(f"{event_line(event, step)}\n" for event in events)
