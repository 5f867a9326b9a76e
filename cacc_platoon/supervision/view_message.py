"""What hosts tell viewers of their vehicles, and what a viewer has heard, without ROS.

A host publishes its `HostView` on <prefix>/view when the supervisor asks for one, which it does
while somebody looks. Nothing of a run depends on these messages: what is forged spoils a picture.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from cacc_platoon.runs.sample_reader import Reading
from cacc_platoon.supervision.json_fields import MAX_INTEGER, VERSION, Fields, ProtocolError

MAX_READINGS = 10_000
"""Of a view; the largest host there can be, of 501 vehicles, has a third of it."""


@dataclass(frozen=True)
class HostView:
    """What a host knows of its vehicles at a sample.

    Attributes
    ----------
    run : str
        The run it belongs to.
    host : str
        Its name.
    sample : int
        The sample that was asked for.
    readings : mapping of str to Reading
        By topic, the last message at that sample.
    """

    run: str
    host: str
    sample: int
    readings: Mapping[str, Reading] = field(default_factory=dict)

    def to_json(self) -> str:
        """Return the text of this record; what is no number is left out."""
        readings = {
            name: reading
            for name, reading in self.readings.items()
            if math.isfinite(reading.x) and math.isfinite(reading.y)
        }
        return json.dumps(
            {
                "format": VERSION,
                "run": self.run,
                "host": self.host,
                "sample": self.sample,
                "readings": readings,
            }
        )

    @classmethod
    def from_json(cls, text: str) -> HostView:
        """Return the record of a text.

        Raises
        ------
        ProtocolError
            When it is not the text of such a record.
        """
        fields = Fields.of_message(text)
        readings = fields.object_at("readings")
        names = readings.names()
        if len(names) > MAX_READINGS:
            raise ProtocolError(f"readings are {len(names)}, over {MAX_READINGS}")
        return cls(
            run=fields.name("run"),
            host=fields.host("host"),
            sample=fields.integer("sample", at_least=0),
            readings={name: _reading(readings.items(name), name) for name in names},
        )


class Heard(NamedTuple):
    """What a viewer has heard since it was asked last, as it came.

    Attributes
    ----------
    scenario, status : bytes, optional
        The last messages on these topics, std_msgs/String as CDR.
    events, views : tuple of bytes
        Those on events, and on view, in the order in which they came.
    """

    scenario: bytes | None = None
    status: bytes | None = None
    events: tuple[bytes, ...] = ()
    views: tuple[bytes, ...] = ()


def _reading(values: list[object], name: str) -> Reading:
    """Return the reading of a list of a sample and two numbers, or raise ProtocolError."""
    match values:
        case [int() as sample, int() | float() as x, int() | float() as y]:
            if all(map(_is_usual, (sample, x, y))) and sample >= 0:
                return Reading(sample, float(x), float(y))
    raise ProtocolError(f"the reading of {name[:30]!r} is no sample with two numbers")


def _is_usual(number: float) -> bool:
    """Whether a number is one that anybody calculates with, and no flag."""
    return not isinstance(number, bool) and math.isfinite(number) and abs(number) <= MAX_INTEGER
