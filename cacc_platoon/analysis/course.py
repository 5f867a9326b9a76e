"""What happened in the course of a run, as its record shows."""

from __future__ import annotations

from cacc_platoon.runs.events import events_of
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.simulation import Trajectory


def course_of(run: Trajectory) -> list[RunEvent]:
    """Return what events.jsonl tells of a run between its start and its end.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> from cacc_platoon.simulation import simulate
    >>> silent = {"v2v.reception": "fallback", "v2v.blackouts": (1.0, 2.0), "run.duration": 2.0}
    >>> one = Scenario.from_values({**silent, "platoon.followers": 1})
    >>> [(event.sample, event.text) for event in course_of(simulate(one))]
    [(149, 'degrading')]
    """
    frame = (EventKind.START, EventKind.END)
    return [event for event in events_of(run) if event.kind not in frame]
