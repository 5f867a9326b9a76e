"""Changes while a run goes on, as texts such as "20 link_3 v2v.loss=1"."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from cacc_platoon.scenario.names import NodeKind, NodeName, vehicle_index
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.scenario.table import TABLE

CHANGEABLE = {
    "link": ("v2v.loss", "v2v.latency", "v2v.bias", "v2v.noise_std"),
    "vehicle": ("controller.time_headway",),
}
"""What may change: of the links to a follower, and of the follower itself."""
ADJUSTABLE = ("v2v.loss", "controller.time_headway")
"""What ros2 param set may change, where run.adjustable lets it."""
RULE = (
    'must be "TIME TARGET KEY=VALUE", such as "20 link_3 v2v.loss=1" or '
    '"40 vehicle_5 controller.time_headway=1.2": a time in seconds, the links to a follower or the '
    f"follower, and of a link {', '.join(CHANGEABLE['link'])}, of a vehicle "
    f"{', '.join(CHANGEABLE['vehicle'])}"
)
_TARGET = re.compile(r"(link|vehicle)_([1-9]\d{0,8})")
_MOST_TIME = 1e7


class Change(NamedTuple):
    """A parameter that takes another value at a sample.

    Attributes
    ----------
    sample : int
        From which sample on.
    vehicle : int
        The follower, or the receiver of the links, that it is a parameter of.
    name : str
        The parameter.
    value : float
        What it is from then on.
    """

    sample: int
    vehicle: int
    name: str
    value: float

    @property
    def kind(self) -> str:
        """Of what it is a parameter, a link or a vehicle."""
        return next(kind for kind, names in CHANGEABLE.items() if self.name in names)

    @property
    def event(self) -> RunEvent:
        """What happens then."""
        kind = NodeKind.NOISE_RELAY if self.kind == "link" else NodeKind.VEHICLE
        node = str(NodeName(kind, self.vehicle))
        return RunEvent(EventKind.CHANGE, self.sample, node, f"{self.name}={self.value!r}")

    def text(self, step: float) -> str:
        """Return the text of a timeline.

        Examples
        --------
        >>> Change(2013, 3, "v2v.loss", 1.0).text(step=0.01)
        '20.13 link_3 v2v.loss=1.0'
        """
        time = round(self.sample * step, 9)
        return f"{time:.12g} {self.kind}_{self.vehicle} {self.name}={self.value!r}"


def read_change(text: str, step: float, source: str) -> Change:
    """Return the change that a text says, in samples of `step` [s].

    Raises
    ------
    ScenarioError
        When it does not keep the rule, or the value is none of the parameter's.

    Examples
    --------
    >>> read_change("20 link_3 v2v.loss=1", 0.01, "scenario")
    Change(sample=2000, vehicle=3, name='v2v.loss', value=1.0)
    """
    try:
        when, target, what = text.split()
        if not text.isascii() or "_" in when + what.partition("=")[2]:
            raise ValueError(RULE)
        time = float(when)
        kind, index = _TARGET.fullmatch(target).groups()  # type: ignore[union-attr]
        name, value = what.split("=")
        number = float(value)
    except (ValueError, AttributeError):
        raise TABLE["run.timeline"].refusal(text, source, RULE) from None
    if not 0.0 <= time <= _MOST_TIME or name not in CHANGEABLE[kind]:
        raise TABLE["run.timeline"].refusal(text, source, RULE)
    checked = TABLE[name].check(number, f"{source}: run.timeline: {text}")
    samples = time / step
    return Change(math.ceil(samples - 1e-9 - 1e-12 * samples), int(index), name, checked)


def change_of(event: RunEvent) -> Change:
    """Return the change that an event of its kind tells of.

    Raises
    ------
    ValueError
        When it tells of none.

    Examples
    --------
    >>> change_of(Change(2013, 3, "v2v.loss", 1.0).event)
    Change(sample=2013, vehicle=3, name='v2v.loss', value=1.0)
    """
    vehicle, _, _ = event.node.partition("/")
    name, _, value = event.text.partition("=")
    change = Change(event.sample, vehicle_index(vehicle) or 0, name, float(value))
    if name not in ADJUSTABLE or change.event != event:
        raise ValueError(f"{event.text} of {event.node} is no change")
    TABLE[name].check(change.value, event.node)
    return change


def timeline(texts: tuple[str, ...], step: float) -> list[Change]:
    """Return the changes of a checked timeline, in their order."""
    changes = [read_change(text, step, "run.timeline") for text in texts]
    return sorted(changes, key=lambda change: change.sample)
