"""What a host makes of the status it receives and of what it sees, without a clock or a message.

Every method returns the next record; when its `state` differs, it has to be published.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from cacc_platoon.scenario.run_event import RunEvent
from cacc_platoon.supervision.protocol import HostPhase, HostState, RunPhase, RunStatus, sendable


@dataclass(frozen=True)
class Endpoint:
    """A publisher or a subscription of a node, and how many of the other kind it has found."""

    node: str
    topic: str
    publishes: bool
    found: int


def missing_connections(
    endpoints: Iterable[Endpoint], subscribers: Mapping[str, int]
) -> tuple[str, ...]:
    """Return a line for each connection that is not there yet.

    Parameters
    ----------
    endpoints : iterable of Endpoint
        Those of a host.
    subscribers : mapping of str to int
        How many subscribers each data topic has to have; other topics are not waited for.
    """
    missing = []
    for end in endpoints:
        if end.publishes and end.found < (expected := subscribers.get(end.topic, 0)):
            missing.append(f"{end.node}: {end.found} of {expected} subscribers of {end.topic}")
        elif not end.publishes and end.topic in subscribers and not end.found:
            missing.append(f"{end.node}: no publisher of {end.topic}")
    return tuple(missing)


@dataclass(frozen=True)
class HostMachine:
    """One host's part in a run.

    Attributes
    ----------
    state : HostState
        What it tells everybody.
    silence_limit : float
        How long the supervisor may be silent before it counts as gone [s].
    status : RunStatus, optional
        The last word of the supervisor of its run.
    received_at : float, optional
        When that came [s].
    """

    state: HostState
    silence_limit: float
    status: RunStatus | None = None
    received_at: float | None = None

    @property
    def awaits_connections(self) -> bool:
        """Whether the supervisor waits for connections of this host."""
        return self._in(RunPhase.MATCHING) and self.state.phase is HostPhase.UP

    @property
    def finished(self) -> bool:
        """Whether the supervisor has ended the run cleanly."""
        return self._in(RunPhase.FINISHED)

    @property
    def ended(self) -> bool:
        """Whether the supervisor has ended the run."""
        return self.status is not None and self.status.phase.ended

    @property
    def samples(self) -> int:
        """How many samples the run takes, as far as the supervisor has said; 0 before."""
        return self.status.samples if self.status else 0

    @property
    def start(self) -> int:
        """When sample 0 is due by clocks [ns since 1970]; 0 as long as that is not known."""
        return self.status.start if self.status and self._in(RunPhase.RUNNING) else 0

    def abandoned(self, now: float) -> bool:
        """Whether the supervisor was there once and has fallen silent."""
        return self.received_at is not None and now - self.received_at > self.silence_limit

    def take_status(self, status: RunStatus, now: float, received: int = 0) -> HostMachine:
        """Take note of a supervisor's status; without a run, its run is the one to belong to.

        A run that is over, whose last word is still there, is none to belong to. Where an answer is
        asked for, it says when the status was received [ns since 1970].
        """
        if not self.state.run and status.phase.ended:
            return self
        state = self.state if self.state.run else replace(self.state, run=status.run)
        if status.run != state.run:
            return self
        if status.sent:
            state = replace(state, answers=status.sent, answered=received)
        return replace(self, state=state, status=status, received_at=now)

    def take_connections(self, endpoints: Iterable[Endpoint]) -> HostMachine:
        """Take note of the connections that are there, when they are waited for."""
        if self.status is None or not self.awaits_connections:
            return self
        missing = missing_connections(endpoints, self.status.subscribers)
        phase = HostPhase.UP if missing else HostPhase.MATCHED
        return replace(self, state=replace(self.state, phase=phase, missing=missing))

    def fail(self, reason: str) -> HostMachine:
        """Report a failure that ends the run; the first one counts."""
        if self.state.failure:
            return self
        state = replace(self.state, phase=HostPhase.FAILED, failure=sendable(reason))
        return replace(self, state=state)

    def take_events(self, events: Iterable[RunEvent]) -> HostMachine:
        """Take note of what more has happened in the nodes."""
        return replace(self, state=replace(self.state, events=(*self.state.events, *events)))

    def close(self) -> HostMachine:
        """Report that the host is done and its part is closed."""
        return replace(self, state=replace(self.state, phase=HostPhase.CLOSED))

    def _in(self, phase: RunPhase) -> bool:
        return self.status is not None and self.status.phase is phase
