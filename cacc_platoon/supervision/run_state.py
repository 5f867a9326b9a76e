"""The state of a run, and what can be read off it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from enum import StrEnum
from types import MappingProxyType
from typing import Any, NamedTuple

from cacc_platoon.runs.info import ClockOffset, HostInfo
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.run_event import EventKind
from cacc_platoon.scenario.timeline import Change
from cacc_platoon.supervision.belief import FOREIGN
from cacc_platoon.supervision.protocol import HostPhase, HostState, RunPhase, RunStatus, sendable
from cacc_platoon.supervision.run_events import (
    Action,
    EndRun,
    ProcessEnded,
    PublishStatus,
    Tell,
    Warn,
)

OWN_HOST = "supervisor"
"""Name of the host in the supervisor's process."""
HEARTBEAT_PERIOD = 0.2
"""How often the supervisor says that it lives [s]."""
NAMED_FAILURES = 3
"""So many failures are named in the message; others follow from them."""
MOST_WARNINGS = 20
"""Whoever makes publishers without end is not reported without end."""

_NOTHING: Mapping[str, Any] = MappingProxyType({})


class Stage(StrEnum):
    """What a run is doing, in words for whoever watches it."""

    LOOKING = "looking around"
    STARTING = "starting nodes"
    RECORDING = "starting a recorder"
    MATCHING = "connecting nodes"
    CHECKING = "checking connections"
    RUNNING = "running"
    NAMING = "looking for another publisher"
    LEAVING = "ending nodes"
    OVER = "over"


class Run(NamedTuple):
    """The state of a run; a named tuple, since a new one is made for every sample.

    Attributes
    ----------
    id : str
        What tells this run from every other.
    stage : Stage
        What it is doing.
    since : float
        When that began, or went on last; the time limits count from here.
    phase : RunPhase
        The status to publish.
    hosts : mapping of str to HostState
        The last word of each host.
    recorded : mapping of str to int
        Sample that each recorder has reached.
    processes : mapping of str to int
        The processes that were started, by host.
    remaining : int, optional
        The least of nodes or connections that were missing so far in this stage.
    looks : int
        How often the graph was looked at.
    warned : frozenset of str
        What the user was warned of.
    rival_since : float, optional
        When another supervisor of the same name was heard first that has to give way.
    connected : frozenset of str
        Hosts whose progress arrives.
    progress : int
        Sample up to which everything is recorded, -1 before the first.
    reach : int
        Sample that a recorder can have reached at most, -1 before the first horizon.
    started, moved, ended : float, optional
        When the run began to run, made progress last, and had its last sample.
    allowed : int
        The last sample that the leader may publish, -1 before the first horizon.
    held : int, optional
        Where the run pauses, or is to pause.
    held_since : float, optional
        When the leader was allowed to go as far as that.
    pauses : int
        How often the run has paused.
    offsets : mapping of str to ClockOffset
        How far the clocks of hosts are from ours, where vehicles keep time by them.
    start : int
        When sample 0 is due by clocks [ns since 1970], 0 in lockstep.
    ended_processes : mapping of str to ProcessEnded
        Hosts whose process is gone.
    gone : tuple of int
        Processes that ended and were started again.
    restarts : mapping of str to int
        How often that was so, by host.
    refused : tuple of str
        Messages that are none of ours, the first few.
    foreign : int
        How many there were of another publisher.
    collided : int, optional
        Sample of the first collision that is to end the run.
    told : int
        Sample up to which everybody was told of planned changes.
    signal : str
        Who asked for the end, if anybody.
    late : tuple of str, optional
        Hosts that did not answer at once when the run had come to a stop, once that is known.
    end : EndRun, optional
        How it ended.
    """

    id: str
    stage: Stage
    since: float
    phase: RunPhase = RunPhase.WAITING
    hosts: Mapping[str, HostState] = _NOTHING
    recorded: Mapping[str, int] = _NOTHING
    processes: Mapping[str, int] = _NOTHING
    remaining: int | None = None
    looks: int = 0
    warned: frozenset[str] = frozenset()
    rival_since: float | None = None
    connected: frozenset[str] = frozenset()
    progress: int = -1
    reach: int = -1
    started: float | None = None
    allowed: int = -1
    held: int | None = None
    held_since: float | None = None
    pauses: int = 0
    offsets: Mapping[str, ClockOffset] = _NOTHING
    start: int = 0
    moved: float = 0.0
    ended: float | None = None
    ended_processes: Mapping[str, ProcessEnded] = _NOTHING
    gone: tuple[int, ...] = ()
    restarts: Mapping[str, int] = _NOTHING
    refused: tuple[str, ...] = ()
    foreign: int = 0
    collided: int | None = None
    told: int = -1
    signal: str = ""
    graph_checked: float = float("-inf")
    status_published: float = float("-inf")
    late: tuple[str, ...] | None = None
    end: EndRun | None = None

    @property
    def failures(self) -> list[str]:
        """What hosts have reported as failures, and what came from elsewhere."""
        failures = [host.failure for host in self.hosts.values() if host.failure]
        return [*failures, *_sent_away(self), *self.refused]


def _sent_away(run: Run) -> list[str]:
    """Return a line for each host that has left while nobody of ours has ended the run."""
    return [
        f"host {host.host} has left although the run goes on: {FOREIGN} told it that the run is "
        "over, or the supervisor was silent for too long"
        for host in run.hosts.values()
        if host.phase is HostPhase.CLOSED and not host.failure and run.end is None
    ]


def shown_sample(run: Run, scenario: Scenario) -> int:
    """Return the sample that viewers are shown, -1 while there is none.

    In lockstep it is one that every host has; by clocks nobody is shown later because of others.
    """
    if run.stage is not Stage.RUNNING:
        return -1
    return max(run.recorded.values(), default=-1) if scenario.clocked else run.progress


def connections_left(run: Run) -> int:
    """Return how many connections may still be missing; it grows less as they are made."""
    left = len(run.recorded.keys() - run.connected)
    for host in run.hosts.values():
        if host.phase is HostPhase.UP:
            left += len(host.missing) or len(host.publishes) + len(host.subscribes) + 1
    return left


def unmatched(run: Run) -> list[str]:
    """Return the connections that are still missing."""
    missing = [
        f"recorder of host {name}: its progress does not arrive"
        for name in run.recorded
        if name not in run.connected
    ]
    for name, host in run.hosts.items():
        if host.phase is HostPhase.UP:
            missing += host.missing or [f"host {name} has not reported its connections"]
    return missing


def wanted_subscribers(run: Run, outside: Mapping[str, int]) -> dict[str, int]:
    """Return how many subscribers each topic has to have, given those outside of the platoon."""
    own = Counter(topic for host in run.hosts.values() for topic in host.subscribes)
    return {topic: own[topic] + more for topic, more in outside.items()}


def status(run: Run, samples: int, outside: Mapping[str, int]) -> RunStatus:
    """Return what the supervisor says of a run that takes so many samples."""
    return RunStatus(
        run=run.id,
        phase=run.phase,
        sample=run.progress,
        samples=samples,
        message=sendable(run.end.message) if run.end else "",
        hosts=summaries(run),
        subscribers=wanted_subscribers(run, outside) if outside else {},
        start=run.start,
    )


def refuse(run: Run, *reasons: str) -> Run:
    """Return the run with messages that are none of ours counted, and the first few taken down."""
    foreign = run.foreign + sum(FOREIGN in reason for reason in reasons)
    return run._replace(refused=(*run.refused, *reasons)[:NAMED_FAILURES], foreign=foreign)


def named_failures(run: Run) -> list[str]:
    """Return the failures that are named in the message, and how many messages were refused."""
    named = run.failures[:NAMED_FAILURES]
    if run.foreign <= NAMED_FAILURES:
        return named
    return [*named, f"{run.foreign} messages of {FOREIGN} were refused"]


def warn(run: Run, lines: Sequence[str]) -> tuple[Run, list[Warn]]:
    """Return the run, and the warnings that the user has not had; after some, there are no more."""
    new = [line for line in lines if line not in run.warned][: MOST_WARNINGS - len(run.warned)]
    return run._replace(warned=run.warned.union(new)), [Warn(line) for line in new]


def with_news(run: Run, state: HostState, *, stops: bool) -> tuple[Run, list[Action]]:
    """Return the run after what is new in a host's nodes, and how everybody learns of it.

    Where a collision `stops` the run, the first one is its end.
    """
    known = run.hosts.get(state.host)
    news = state.events[len(known.events) if known else 0 :]
    told: list[Action] = [Tell(event) for event in news]
    collisions = [event.sample for event in news if event.kind is EventKind.COLLISION]
    if not (stops and collisions):
        return run, told
    first = min(collisions if run.collided is None else [run.collided, *collisions])
    return run._replace(collided=first), [*told, PublishStatus()]


def with_heartbeat(run: Run, actions: list[Action], now: float) -> tuple[Run, list[Action]]:
    """Return the run and the actions, and the status too when that is due."""
    silent = run.stage in (Stage.LOOKING, Stage.OVER)
    due = now - run.status_published > HEARTBEAT_PERIOD and not silent
    if due and PublishStatus() not in actions:
        actions = [PublishStatus(), *actions]
    if PublishStatus() in actions:
        run = run._replace(status_published=now)
    return run, actions


def with_changes(run: Run, changes: Iterable[Change]) -> tuple[Run, list[Action]]:
    """Return the run after everybody is told of planned changes at which all have arrived."""
    due = [change for change in changes if run.told < change.sample <= run.progress]
    return run._replace(told=run.progress), [Tell(change.event) for change in due]


def not_in_time(run: Run, missing: Sequence[str], limit: float) -> str:
    """Say what has not come although it was waited for."""
    matching = run.stage is Stage.MATCHING
    what = "these connections are missing" if matching else "these nodes have not appeared"
    return (
        f"for {limit:g} s nothing has come, and {what}: {some(missing)}. Start what is missing, or "
        "raise run.start_timeout."
    )


def whose_process(run: Run, ended: ProcessEnded) -> str:
    """Say which host's process is gone."""
    host = run.hosts.get(ended.host)
    nodes = some(host.nodes if host else ["before it appeared"])
    return f"host {ended.host} (process {ended.pid}: {nodes}) {ended.how}"


def summaries(run: Run) -> tuple[HostInfo, ...]:
    """Return name, process, nodes and machine of every host, by name."""
    return tuple(HostInfo(name, h.pid, h.nodes, h.machine) for name, h in sorted(run.hosts.items()))


def joined(reasons: Sequence[str]) -> str:
    """Return reasons as one line, whether or not they end as sentences.

    Examples
    --------
    >>> joined(["it is late. Start it.", "the last complete sample is 7"])
    'it is late. Start it; the last complete sample is 7'
    """
    return "; ".join(reason.removesuffix(".") for reason in reasons)


def some(items: Sequence[str], limit: int = 6) -> str:
    """Return the first items in a line, and how many there are more."""
    more = f" and {len(items) - limit} more" if len(items) > limit else ""
    return ", ".join(items[:limit]) + more
