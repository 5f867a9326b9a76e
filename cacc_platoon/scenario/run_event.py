"""What happened in a run, and at which sample."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple


class EventKind(StrEnum):
    """What it was."""

    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    CHANGE = "change"
    RECEPTION = "reception"
    LIMIT = "limit"
    LATE = "late"
    COLLISION = "collision"
    FAULT = "fault"
    RESTART = "restart"
    END = "end"


ACTS, RESTS = "acts", "rests"
"""Of a limit: an actuator cannot carry out its command, or the vehicle stands; and no longer."""

NOTICED = 0.2
"""How long the samples of a vehicle have to be late, by clocks, before that is told [s]."""

MOST_TURNS = 50
"""So many turns of one reception, or of the limits of one vehicle, are told in a run."""


class RunEvent(NamedTuple):
    """Something that happened in a run.

    Attributes
    ----------
    kind : EventKind
        What.
    sample : int
        At which sample; a change takes effect there.
    node : str
        Where, relative to the platoon's namespace.
    text : str
        What more there is to say: of a change, parameter and value as `run.timeline` takes them; of
        a reception, its state; of limits, that they act or rest; of late samples, how many; of a
        fault, what went wrong.
    """

    kind: EventKind
    sample: int
    node: str
    text: str = ""

    @classmethod
    def late(cls, first: int, samples: int, latest: float, node: str) -> RunEvent:
        """Return that so many samples were late, the latest by so many control periods."""
        return cls(EventKind.LATE, first, node, f"{samples} samples, by up to {latest:.6g} periods")

    @property
    def order(self) -> tuple[int, int, int, str]:
        """What sorts the events of a run, however they came: by sample, kind, and front to rear."""
        return self.sample, [*EventKind].index(self.kind), len(self.node), self.node
