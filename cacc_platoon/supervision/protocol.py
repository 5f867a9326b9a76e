"""What hosts and the supervisor tell each other: typed records and their JSON texts.

A host publishes its `HostState` on <prefix>/host_state, the supervisor its `RunStatus` on
<prefix>/status. Anybody may publish on these topics, so a text is checked field by field before
anything is done with it: `from_json` returns a record or raises ProtocolError, nothing else. Keys
that are not known are ignored; whatever changes the meaning of a known one is a new VERSION.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TypeAlias

from cacc_platoon.runs.info import HostInfo
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.supervision.json_fields import (
    VERSION,
    Fields,
    OtherVersionError,
    ProtocolError,
    Value,
    sendable,
)

__all__ = [
    "VERSION",
    "HostPhase",
    "HostState",
    "OtherVersionError",
    "ProtocolError",
    "RunPhase",
    "RunStatus",
    "sendable",
    "text_digest",
]

Parameters: TypeAlias = Mapping[str, Mapping[str, Value]]
"""Values by parameter name, by node."""


def text_digest(text: str) -> str:
    """Return what tells a scenario's text from every other."""
    return hashlib.sha256(text.encode()).hexdigest()


class HostPhase(StrEnum):
    """How far a host is."""

    UP = "up"
    MATCHED = "matched"
    FAILED = "failed"
    CLOSED = "closed"


class RunPhase(StrEnum):
    """How far a run is."""

    WAITING = "waiting"
    MATCHING = "matching"
    RUNNING = "running"
    FINISHED = "finished"
    FAILED = "failed"

    @property
    def ended(self) -> bool:
        """Whether nothing more is published in this phase."""
        return self in (RunPhase.FINISHED, RunPhase.FAILED)


@dataclass(frozen=True)
class HostState:
    """What a host reports of itself.

    Attributes
    ----------
    run : str
        The run it belongs to; empty as long as it has not met one.
    host : str
        Its name, letters, digits and underscores, since it is part of topic names.
    pid : int
        Its process.
    nodes : tuple of str
        Its nodes, relative to the platoon's namespace.
    publishes, subscribes : tuple of str
        Topics of the platoon, one for each endpoint.
    records : tuple of str
        Topics that it records.
    part : str
        Folder in which it records, empty when it does not.
    phase : HostPhase
        How far it is.
    missing : tuple of str
        Connections that are not there yet, while the run is matching.
    failure : str
        Why the run has to end; empty when all is well.
    parameters : mapping
        Parameters of manually started nodes, which have to be those of the run.
    events : tuple of RunEvent
        What happened in its nodes so far.
    answers, answered : int
        When the supervisor sent the status that is answered, by its clock, and when that came, by
        the host's [ns since 1970]; 0 where no answer was asked for.
    machine : str
        Name of the machine that it runs on.
    """

    run: str
    host: str
    pid: int
    nodes: tuple[str, ...]
    publishes: tuple[str, ...] = ()
    subscribes: tuple[str, ...] = ()
    records: tuple[str, ...] = ()
    part: str = ""
    phase: HostPhase = HostPhase.UP
    missing: tuple[str, ...] = ()
    failure: str = ""
    parameters: Parameters = field(default_factory=dict)
    events: tuple[RunEvent, ...] = ()
    answers: int = 0
    answered: int = 0
    machine: str = ""

    def to_json(self) -> str:
        """Return the text of this record."""
        return json.dumps(
            {
                "format": VERSION,
                "run": self.run,
                "host": self.host,
                "pid": self.pid,
                "nodes": self.nodes,
                "publishes": self.publishes,
                "subscribes": self.subscribes,
                "records": self.records,
                "part": self.part,
                "phase": self.phase,
                "missing": self.missing,
                "failure": self.failure,
                "parameters": self.parameters,
                "events": [event._asdict() for event in self.events],
                "answers": self.answers,
                "answered": self.answered,
                "machine": self.machine,
            }
        )

    @classmethod
    def from_json(cls, text: str) -> HostState:
        """Return the record of a text.

        Raises
        ------
        ProtocolError
            When it is not the text of such a record.
        """
        fields = Fields.of_message(text)
        return cls(
            run=fields.text("run"),
            host=fields.host("host"),
            pid=fields.integer("pid", at_least=1),
            nodes=fields.texts("nodes"),
            publishes=fields.texts("publishes"),
            subscribes=fields.texts("subscribes"),
            records=fields.texts("records"),
            part=fields.text("part"),
            phase=fields.choice("phase", HostPhase),
            missing=fields.texts("missing"),
            failure=fields.text("failure"),
            parameters=fields.parameters("parameters"),
            events=tuple(_run_event(event) for event in fields.items("events")),
            answers=fields.integer("answers", at_least=0),
            answered=fields.integer("answered", at_least=0),
            machine=fields.text("machine"),
        )


@dataclass(frozen=True)
class RunStatus:
    """What the supervisor says of the run.

    Attributes
    ----------
    run : str
        What tells this run from every other.
    phase : RunPhase
        How far it is.
    sample, samples : int
        Sample up to which everything is recorded, -1 before the first, and how many there will be.
    message : str
        Why the run has failed; empty otherwise.
    hosts : tuple of HostInfo
        Hosts that have appeared.
    subscribers : mapping of str to int
        While matching: how many subscribers each data topic has to have before the run may start.
    start : int
        Where nodes keep time by clocks: when sample 0 is due [ns since 1970]; 0 before that is set.
    sent : int
        When this was sent [ns since 1970], where hosts are to answer; 0 otherwise.
    scenario : str
        SHA-256 of the text on <prefix>/scenario that the run has.
    """

    run: str
    phase: RunPhase = RunPhase.WAITING
    sample: int = -1
    samples: int = 0
    message: str = ""
    hosts: tuple[HostInfo, ...] = ()
    subscribers: Mapping[str, int] = field(default_factory=dict)
    start: int = 0
    sent: int = 0
    scenario: str = ""

    def to_json(self) -> str:
        """Return the text of this record."""
        return json.dumps(
            {
                "format": VERSION,
                "run": self.run,
                "phase": self.phase,
                "sample": self.sample,
                "samples": self.samples,
                "message": self.message,
                "hosts": [host.to_json() for host in self.hosts],
                "subscribers": self.subscribers,
                "start": self.start,
                "sent": self.sent,
                "scenario": self.scenario,
            }
        )

    @classmethod
    def from_json(cls, text: str) -> RunStatus:
        """Return the record of a text.

        Raises
        ------
        ProtocolError
            When it is not the text of such a record.
        """
        fields = Fields.of_message(text)
        return cls(
            run=fields.name("run"),
            phase=fields.choice("phase", RunPhase),
            sample=fields.integer("sample", at_least=-1),
            samples=fields.integer("samples", at_least=0),
            message=fields.text("message"),
            hosts=tuple(_host_info(host) for host in fields.items("hosts")),
            subscribers=fields.counts("subscribers"),
            start=fields.integer("start", at_least=0),
            sent=fields.integer("sent", at_least=0),
            scenario=fields.text("scenario"),
        )


def _run_event(value: object) -> RunEvent:
    """Return the event of a JSON value, or raise ProtocolError."""
    fields = Fields(value, "an event")
    return RunEvent(
        kind=fields.choice("kind", EventKind),
        sample=fields.integer("sample", at_least=0),
        node=fields.name("node"),
        text=fields.text("text"),
    )


def _host_info(value: object) -> HostInfo:
    """Return the host of a JSON value, or raise ProtocolError."""
    fields = Fields(value, "a host")
    return HostInfo(
        name=fields.host("name"),
        pid=fields.integer("pid", at_least=1),
        nodes=fields.texts("nodes"),
        machine=fields.text("machine"),
        part=fields.text("part"),
    )
