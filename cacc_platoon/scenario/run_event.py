"""What happened in a run, and at which sample."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple


class EventKind(StrEnum):
    """What it was."""

    START = "start"
    CHANGE = "change"
    RECEPTION = "reception"
    COLLISION = "collision"
    END = "end"


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
        a reception, its state.
    """

    kind: EventKind
    sample: int
    node: str
    text: str = ""
