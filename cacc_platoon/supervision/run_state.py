"""The state of a run, and what can be read off it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum
from types import MappingProxyType
from typing import Any, NamedTuple

from cacc_platoon.runs.info import HostInfo
from cacc_platoon.supervision.protocol import HostPhase, HostState, RunPhase
from cacc_platoon.supervision.run_events import EndRun, ProcessEnded

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
        When that began; the time limits count from here.
    phase : RunPhase
        The status to publish.
    hosts : mapping of str to HostState
        The last word of each host.
    recorded : mapping of str to int
        Sample that each recorder has reached.
    connected : frozenset of str
        Hosts whose progress arrives.
    progress : int
        Sample up to which everything is recorded, -1 before the first.
    reach : int
        Sample that a recorder can have reached at most, -1 before the first horizon.
    started, moved, ended : float, optional
        When the run began to run, made progress last, and had its last sample.
    ended_processes : mapping of str to ProcessEnded
        Hosts whose process is gone.
    refused : tuple of str
        Messages that are none of ours.
    signal : str
        Who asked for the end, if anybody.
    end : EndRun, optional
        How it ended.
    """

    id: str
    stage: Stage
    since: float
    phase: RunPhase = RunPhase.WAITING
    hosts: Mapping[str, HostState] = _NOTHING
    recorded: Mapping[str, int] = _NOTHING
    connected: frozenset[str] = frozenset()
    progress: int = -1
    reach: int = -1
    started: float | None = None
    moved: float = 0.0
    ended: float | None = None
    ended_processes: Mapping[str, ProcessEnded] = _NOTHING
    refused: tuple[str, ...] = ()
    signal: str = ""
    graph_checked: float = float("-inf")
    status_published: float = float("-inf")
    end: EndRun | None = None

    @property
    def failures(self) -> list[str]:
        """What hosts have reported as failures, and what came from elsewhere."""
        return [host.failure for host in self.hosts.values() if host.failure] + [*self.refused]


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


def silent_hosts(run: Run) -> list[str]:
    """Return a line for each host that lives, as far as is known, and has not closed."""
    return [
        f"host {name} (process {host.pid}: {some(host.nodes)}) does not answer"
        for name, host in run.hosts.items()
        if host.phase is not HostPhase.CLOSED and name not in run.ended_processes
    ]


def summaries(run: Run) -> tuple[HostInfo, ...]:
    """Return name, process and nodes of every host, by name."""
    return tuple(HostInfo(name, h.pid, h.nodes) for name, h in sorted(run.hosts.items()))


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
