"""events.jsonl: what happened in a run, one JSON object a line, written as it happens."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable
from pathlib import Path

from cacc_platoon.formats import Format
from cacc_platoon.runs.info import EndStatus
from cacc_platoon.scenario.names import NodeKind, NodeName
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.simulation import Trajectory
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
        return sorted(found for line in lines if (found := _sample_and_line(line, samples)))
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
    if run.ends_in_collision:
        happened += [
            RunEvent(EventKind.COLLISION, last, str(NodeName(NodeKind.VEHICLE, index)))
            for index, gap in zip(run.scenario.indices, run.gap[-1], strict=True)
            if gap <= 0.0
        ]
    return [
        RunEvent(EventKind.START, 0, SUPERVISOR),
        *happened,
        RunEvent(EventKind.END, last, SUPERVISOR, EndStatus.FINISHED),
    ]


def append_events(folder: Path, events: Iterable[RunEvent], step: float) -> None:
    """Append events to those of a run folder."""
    with (folder / EVENTS_FILE).open("a", encoding="utf-8") as file:
        file.writelines(f"{event_line(event, step)}\n" for event in events)
