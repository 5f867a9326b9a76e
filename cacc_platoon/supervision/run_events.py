"""What the run machine takes in, and what it asks for: one record for each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from cacc_platoon.runs.info import EndStatus
from cacc_platoon.scenario.run_event import RunEvent
from cacc_platoon.supervision.protocol import HostState, RunPhase


@dataclass(frozen=True)
class Tick:
    """Time has passed; what happened since the last one is judged now."""


@dataclass(frozen=True)
class HostReported:
    """A host says how it is.

    Attributes
    ----------
    state : HostState
        What it says.
    returned : int
        When that came [ns since 1970].
    """

    state: HostState
    returned: int = 0


@dataclass(frozen=True)
class MessageRefused:
    """A message has come that is none of ours; the line says which and why."""

    reason: str


@dataclass(frozen=True)
class Recorded:
    """A host's recorder holds everything up to and including a sample."""

    host: str
    sample: int


@dataclass(frozen=True)
class RecordersConnected:
    """The progress of these hosts' recorders arrives here."""

    hosts: frozenset[str]


@dataclass(frozen=True)
class GraphObserved:
    """Somebody has looked who publishes the platoon's topics.

    Attributes
    ----------
    foreign : tuple of str
        A line, which begins with the topic, for each that others publish.
    harmless : tuple of str
        A line for each publisher whose messages nobody of ours can receive.
    settled : bool
        Whether the graph tells the node of every publisher.
    """

    foreign: tuple[str, ...] = ()
    harmless: tuple[str, ...] = ()
    settled: bool = True


@dataclass(frozen=True)
class RivalHeard:
    """A supervisor of another run says how far that is, on the topic of this platoon's status."""

    run: str
    phase: RunPhase


@dataclass(frozen=True)
class HostsStarted:
    """These processes have been started so far, by host."""

    processes: Mapping[str, int]


@dataclass(frozen=True)
class ProcessEnded:
    """A host's process, one that this run has started, is no longer there."""

    host: str
    pid: int
    how: str


@dataclass(frozen=True)
class MeansLost:
    """Something that the run cannot do without is gone; the line says what."""

    reason: str


@dataclass(frozen=True)
class PauseAsked:
    """The user asks the run to wait."""


@dataclass(frozen=True)
class ResumeAsked:
    """The user asks a run that waits to go on."""


@dataclass(frozen=True)
class StepAsked:
    """The user asks a run that waits to go on by some samples, and to wait again."""

    samples: int


@dataclass(frozen=True)
class SignalReceived:
    """A signal asks for the end of the run."""

    name: str


Event: TypeAlias = (
    Tick
    | HostReported
    | MessageRefused
    | Recorded
    | RecordersConnected
    | GraphObserved
    | RivalHeard
    | HostsStarted
    | ProcessEnded
    | MeansLost
    | PauseAsked
    | ResumeAsked
    | StepAsked
    | SignalReceived
)


@dataclass(frozen=True)
class ObserveGraph:
    """Look who publishes the platoon's topics and answer with GraphObserved."""


@dataclass(frozen=True)
class Announce:
    """Show yourself in the graph: until then, nothing was published in the platoon's namespace."""


@dataclass(frozen=True)
class Warn:
    """Warn the user of something that ends no run."""

    line: str


@dataclass(frozen=True)
class StartHosts:
    """Start the processes of the hosts."""


@dataclass(frozen=True)
class RestartHost:
    """Start the process of a host again, which has ended."""

    host: str


@dataclass(frozen=True)
class FollowRecorder:
    """Listen to the progress of a host's recorder; each message is a Recorded."""

    host: str


@dataclass(frozen=True)
class RecordTheRest:
    """Record in the supervisor's process what no host records, as the host OWN_HOST."""

    topics: tuple[str, ...]


@dataclass(frozen=True)
class PublishStatus:
    """Tell everybody how far the run is."""


@dataclass(frozen=True)
class PublishHorizon:
    """Let the leader go as far as a sample."""

    sample: int


@dataclass(frozen=True)
class Tell:
    """Write down, and tell everybody, what happened."""

    event: RunEvent


@dataclass(frozen=True)
class CloseOwnHost:
    """Close the host in the supervisor's process, if there is one."""


@dataclass(frozen=True)
class EndRun:
    """Stop what is left of the hosts: the run is over.

    Attributes
    ----------
    status : EndStatus
        How it ended.
    message : str
        Why it did not finish; empty otherwise.
    silent : tuple of str
        A line for each host that did not take leave.
    stalled : bool
        Whether somebody stopped and nobody has said who; what was recorded tells.
    """

    status: EndStatus
    message: str = ""
    silent: tuple[str, ...] = ()
    stalled: bool = False


Action: TypeAlias = (
    ObserveGraph
    | Announce
    | Warn
    | StartHosts
    | RestartHost
    | FollowRecorder
    | RecordTheRest
    | PublishStatus
    | PublishHorizon
    | Tell
    | CloseOwnHost
    | EndRun
)
