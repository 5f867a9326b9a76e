"""What happened in the course of a run, as its record shows."""

from __future__ import annotations

import numpy as np

from cacc_platoon.analysis.fallback import reception_state
from cacc_platoon.model import ReceptionState
from cacc_platoon.runs.events import events_of
from cacc_platoon.scenario.names import NodeKind, NodeName
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.simulation import Trajectory


def course_of(run: Trajectory) -> list[RunEvent]:
    """Return changes of parameters and of receptions, and collisions, in order.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> from cacc_platoon.simulation import simulate
    >>> silent = {"v2v.reception": "fallback", "v2v.blackouts": (1.0, 2.0), "run.duration": 2.0}
    >>> one = Scenario.from_values({**silent, "platoon.followers": 1})
    >>> [(event.sample, event.text) for event in course_of(simulate(one))]
    [(149, 'degrading')]
    """
    told = (EventKind.CHANGE, EventKind.COLLISION)
    events = [event for event in events_of(run) if event.kind in told]
    return sorted([*events, *_turns(run)], key=lambda event: event.sample)


def _turns(run: Trajectory) -> list[RunEvent]:
    """Return when followers went from one state of reception to another."""
    if run.share is None:
        return []
    found = []
    for column, index in enumerate(run.scenario.indices):
        state = reception_state(run.share[:, column])
        node = str(NodeName(NodeKind.VEHICLE, index))
        for sample in (np.flatnonzero(np.diff(state)) + 1).tolist():
            name = ReceptionState(int(state[sample])).name.lower()
            found.append(RunEvent(EventKind.RECEPTION, sample, node, name))
    return found
