"""Puts together what is heard of a platoon, without ROS and without a clock."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Mapping

from cacc_platoon.errors import UserError
from cacc_platoon.live.pace import Pace
from cacc_platoon.live.picture import PAUSED, RUNNING, Picture, VehicleNow
from cacc_platoon.live.vehicles import Spacing, vehicles_now
from cacc_platoon.runs.events import read_event
from cacc_platoon.runs.sample_reader import Reading, shown_topics
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import parse_scenario
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.scenario.timeline import change_of
from cacc_platoon.supervision.protocol import ProtocolError, RunStatus
from cacc_platoon.supervision.view_message import Heard, HostView
from msg_adapters.text import decode_string
from msg_adapters.topics import Graph

EVENTS_KEPT = 8
SAMPLES_KEPT = 4
"""Hosts answer at different times; so many samples are kept until all have answered."""
MOST_CHANGES = 1000

Readings = dict[str, Reading]


class Watch:
    """What is known of one platoon, from what was heard of it.

    What is no message of ours is passed over: it can be no more than missing in the picture.

    Parameters
    ----------
    prefix : str
        The platoon's namespace.
    scenario : Scenario, optional
        What it runs, where that is known; otherwise it is heard.

    Attributes
    ----------
    scenario : Scenario, optional
        What it runs, with the changes that were not planned.
    """

    def __init__(self, prefix: str, scenario: Scenario | None = None) -> None:
        self._prefix, self._told = prefix, scenario is not None
        self.scenario: Scenario | None = None
        self._status: RunStatus | None = None
        self._heard_at: float | None = None
        self._begin_run()
        if scenario:
            self._take_scenario(scenario)

    def _begin_run(self) -> None:
        self._pace, self._changes = Pace(), 0
        self._events: deque[RunEvent] = deque(maxlen=EVENTS_KEPT)
        self._paused = False
        self._known: Readings = {}
        self._answers: dict[int, Readings] = {}

    def _take_scenario(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self._names = {topic.name for topic in shown_topics(Graph.of(scenario))}
        self._spacing = Spacing(scenario)

    @property
    def ended(self) -> bool:
        """Whether the run has ended."""
        return self._status is not None and self._status.phase.ended

    @property
    def failed(self) -> bool:
        """Whether it has ended and is not complete."""
        return self._status is not None and self._status.phase == "failed"

    def hear(self, heard: Heard, now: float) -> None:
        """Take note of what was heard by a time [s]."""
        if heard.scenario is not None and not self._told:
            with contextlib.suppress(UserError):
                self._take_scenario(parse_scenario(decode_string(heard.scenario), self._prefix))
        if heard.status is not None:
            with contextlib.suppress(ProtocolError):
                self._take_status(RunStatus.from_json(decode_string(heard.status)), now)
        for line in heard.events:
            if event := read_event(decode_string(line)):
                self._take_event(event)
        for text in heard.views:
            with contextlib.suppress(ProtocolError):
                self._take_view(HostView.from_json(decode_string(text)), now)

    def _take_status(self, status: RunStatus, now: float) -> None:
        if self._status and self._status.run != status.run:
            self._begin_run()
        self._status, self._heard_at = status, now
        if status.sample >= 0:
            self._pace.note(status.sample, now)

    def _take_event(self, event: RunEvent) -> None:
        self._events.append(event)
        if event.kind in (EventKind.PAUSE, EventKind.RESUME):
            self._paused = event.kind is EventKind.PAUSE
        if event.kind is not EventKind.CHANGE or self.scenario is None:
            return
        if event in [change.event for change in self.scenario.changes]:
            return
        with contextlib.suppress(ValueError, UserError):
            change = change_of(event)
            self._changes += 1
            if self._changes <= MOST_CHANGES:
                self._take_scenario(self.scenario.with_changes([change]))

    def _take_view(self, view: HostView, now: float) -> None:
        if self.scenario is None or (self._status and self._status.run != view.run):
            return
        last = self.scenario.samples - 1
        readings = {
            name: reading
            for name, reading in view.readings.items()
            if name in self._names and reading.sample <= last
        }
        if not readings or view.sample > last:
            return
        self._known |= readings
        self._answers.setdefault(view.sample, {}).update(readings)
        for sample in sorted(self._answers)[:-SAMPLES_KEPT]:
            del self._answers[sample]
        self._pace.note(view.sample, now)
        self._heard_at = now

    def _readings(self) -> tuple[int, Mapping[str, Reading]]:
        """Return what is known of the newest sample of which most is known, and that sample."""
        if not self._answers:
            return -1, self._known
        sample = max(self._answers, key=lambda k: (len(self._answers[k]), k))
        return sample, self._known | self._answers[sample]

    def picture(self, now: float) -> Picture:
        """Return what the platoon looks like at a time [s]."""
        sample, readings = self._readings()
        status, rate = self._status, self._pace.rate
        samples, step = 0, 0.0
        vehicles: tuple[VehicleNow, ...] = ()
        if self.scenario:
            samples, step = self.scenario.samples, self.scenario.run.step
            vehicles = vehicles_now(self._spacing, readings)
        if status:
            samples, sample = status.samples or samples, max(sample, status.sample)
        phase = str(status.phase) if status else ""
        if phase == RUNNING and self._paused:
            phase = PAUSED
        rate = rate if phase == RUNNING else None
        return Picture(
            namespace=self._prefix,
            phase=phase,
            sample=sample,
            samples=samples,
            step=step,
            factor=rate * step if rate and step else None,
            left=max(0.0, (samples - 1 - sample) / rate) if rate else None,
            silence=0.0 if self._heard_at is None else now - self._heard_at,
            message=status.message if status else "",
            events=tuple(self._events),
            vehicles=vehicles,
        )
