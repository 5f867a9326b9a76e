"""run.json: what a run folder says of its run beside the bag and the scenario."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeVar

from cacc_platoon.errors import one_line
from cacc_platoon.formats import Format
from cacc_platoon.texts import TextError, read_json

INFO_FILE = "run.json"
FORMAT = Format(INFO_FILE, 1)
ROOM = 2**16
"""Disk that is set aside for the next run.json [bytes], so that a run can say that it is full."""
NO_BAG = "the bag is not written yet, `platoon report` writes it"
"""In the message of a run that has ended, as long as that is so."""
ELSEWHERE = "the bag lacks what was recorded elsewhere, `platoon merge` adds it"
"""In the message of a run that has ended, as long as parts of it are on other machines."""
_MOST = 2**63

Number = TypeVar("Number", int, float)


class EndStatus(StrEnum):
    """How a run ended, or that it has not."""

    RUNNING = "running"
    FINISHED = "finished"
    FAILED = "failed"
    INTERRUPTED = "interrupted"


class InfoError(ValueError):
    """A document that is no run.json, or a damaged one."""


@dataclass(frozen=True)
class HostInfo:
    """A process that ran nodes and recorded what they published.

    Attributes
    ----------
    name : str
        Its name; its recorder is <prefix>/host_<name>/recorder.
    pid : int
        Process id on its machine.
    nodes : tuple of str
        Its nodes, relative to the platoon's namespace.
    machine : str
        Name of its machine; empty when unknown.
    part : str
        Folder on that machine where what it recorded still is, and not in the bag; empty otherwise.
    """

    name: str
    pid: int
    nodes: tuple[str, ...]
    machine: str = ""
    part: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the host as run.json has it."""
        return {
            "name": self.name,
            "pid": self.pid,
            "nodes": list(self.nodes),
            "machine": self.machine,
            "part": self.part,
        }

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Self:
        """Return the host that a part of run.json describes."""
        return cls(
            _text(document["name"]),
            _count(document["pid"]),
            _texts(document["nodes"]),
            _text(document.get("machine", "")),
            _text(document.get("part", "")),
        )


class ClockOffset(NamedTuple):
    """How far the clock of a host is from the supervisor's, by one round trip.

    Attributes
    ----------
    offset : float
        By how much it is ahead [s].
    uncertainty : float
        How wrong that may be, half of the round trip [s].

    Examples
    --------
    >>> ClockOffset.measured(1_000_000, 4_000_000, 3_000_000)
    ClockOffset(offset=0.002, uncertainty=0.001)
    """

    offset: float
    uncertainty: float

    @classmethod
    def measured(cls, sent: int, answered: int, returned: int) -> ClockOffset:
        """Return it from three times [ns].

        A message was sent and its answer returned by the supervisor's clock; the host answered by
        its own.
        """
        return cls((2 * answered - sent - returned) / 2e9, (returned - sent) / 2e9)

    @property
    def least(self) -> float:
        """How far the clocks are apart at least [s]."""
        return max(0.0, abs(self.offset) - self.uncertainty)

    def to_json(self) -> dict[str, float]:
        """Return it as run.json has it."""
        return {"offset": self.offset, "uncertainty": self.uncertainty}

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Self:
        """Return what a part of run.json says."""
        return cls(_number(document["offset"]), _seconds(document["uncertainty"]))


@dataclass(frozen=True)
class RunInfo:
    """What is known of a run; `RunFolder.finish` fills in what the bag tells.

    Attributes
    ----------
    status : EndStatus
        How it ended. A process that is killed leaves "running" behind.
    message : str
        Why it did not finish, and that its bag is not written yet; empty otherwise.
    samples : int or None
        Samples that every recorder has; None when nobody counted them.
    wall_time, real_time_factor : float or None
        From the first to the last sample [s], and simulated time over it [-]; None when unknown.
    start_time : float or None
        From the command to the first sample [s]; 0 for a simulation, None when unknown.
    hosts : tuple of HostInfo
        The processes; empty for a simulation.
    digest : str
        Of the recorded messages.
    messages : mapping of str to int
        Messages in the bag, by topic.
    seed : int or None
        Of all noise.
    versions, fingerprint : mapping of str to str
        Of the software and of the machine that recorded it.
    pid : int or None
        The process that runs it, or did; None when unknown.
    began : str
        When that began, UTC; empty when unknown.
    clock_offsets : mapping of str to ClockOffset
        How far the clocks of hosts are from the supervisor's, where vehicles keep time by them.
    run : str
        What tells it from every other run; empty when unknown.
    """

    status: EndStatus = EndStatus.FINISHED
    message: str = ""
    samples: int | None = None
    wall_time: float | None = None
    real_time_factor: float | None = None
    start_time: float | None = None
    hosts: tuple[HostInfo, ...] = ()
    digest: str = ""
    messages: Mapping[str, int] = dataclasses.field(default_factory=dict)
    seed: int | None = None
    versions: Mapping[str, str] = dataclasses.field(default_factory=dict)
    fingerprint: Mapping[str, str] = dataclasses.field(default_factory=dict)
    pid: int | None = None
    began: str = ""
    clock_offsets: Mapping[str, ClockOffset] = dataclasses.field(default_factory=dict)
    run: str = ""

    def without_bag(self, status: EndStatus | None = None, why: str = "") -> Self:
        """Return what to say as long as the bag is not there, and why that is so."""
        missing = f"{NO_BAG} ({why})" if why else NO_BAG
        status = status if status and self.status is EndStatus.FINISHED else self.status
        message = "; ".join(filter(None, [self.message.removesuffix("."), missing]))
        return dataclasses.replace(self, status=status, message=message)

    def with_bag(self) -> Self:
        """Return what to say once the bag is there: only what stood in the way of the run."""
        return self._without(NO_BAG)

    @property
    def lacks_parts(self) -> bool:
        """Whether some of what was recorded is not in the bag, but on other machines."""
        return any(host.part for host in self.hosts)

    def without_parts(self, parts: Mapping[str, str]) -> Self:
        """Return what to say as long as the parts of some hosts are elsewhere, in these folders."""
        if not parts:
            return self
        hosts = tuple(dataclasses.replace(h, part=parts.get(h.name, "")) for h in self.hosts)
        where = [
            f"host {host.name}, {host.part} on {host.machine or 'its machine'}"
            for host in hosts
            if host.part
        ]
        missing = f"{ELSEWHERE}: {'; '.join(where)}"
        message = "; ".join(filter(None, [self.message.removesuffix("."), missing]))
        status = EndStatus.FAILED if self.status is EndStatus.FINISHED else self.status
        return dataclasses.replace(self, status=status, message=message, hosts=hosts)

    def with_parts(self) -> Self:
        """Return what to say once everything is in the bag."""
        hosts = tuple(dataclasses.replace(host, part="") for host in self.hosts)
        return dataclasses.replace(self._without(ELSEWHERE), hosts=hosts)

    def _without(self, line: str) -> Self:
        """Return what to say when a line of the message, and what follows it, holds no longer."""
        reason, found, _ = self.message.partition(line)
        if not found:
            return self
        status = self.status if reason else EndStatus.FINISHED
        return dataclasses.replace(self, status=status, message=reason.removesuffix("; "))

    def to_json(self) -> dict[str, Any]:
        """Return what run.json holds."""
        return {
            "format": FORMAT.version,
            "status": str(self.status),
            "message": self.message,
            "samples": self.samples,
            "wall_time": self.wall_time,
            "real_time_factor": self.real_time_factor,
            "start_time": self.start_time,
            "hosts": [host.to_json() for host in self.hosts],
            "digest": self.digest,
            "messages": dict(self.messages),
            "seed": self.seed,
            "versions": dict(self.versions),
            "fingerprint": dict(self.fingerprint),
            "pid": self.pid,
            "began": self.began,
            "clock_offsets": {name: one.to_json() for name, one in self.clock_offsets.items()},
            "run": self.run,
        }

    @classmethod
    def from_json(cls, document: object, source: str = INFO_FILE) -> Self:
        """Return what a document says, of this format or an older one.

        Parameters
        ----------
        document : object
            What a JSON reader made of the file.
        source : str, optional
            The file, for the error line.

        Raises
        ------
        InfoError
            When it is no run.json, or a damaged one.
        UserError
            When its format is newer than ours.
        """
        if not isinstance(document, Mapping):
            raise InfoError(f"{source}: is no JSON object")
        FORMAT.check(document.get("format"), source)
        try:
            return cls(
                EndStatus(document["status"]),
                _text(document.get("message", "")),
                _optional(document.get("samples"), _count),
                _optional(document.get("wall_time"), _seconds),
                _optional(document.get("real_time_factor"), _seconds),
                _optional(document.get("start_time"), _seconds),
                tuple(HostInfo.from_json(host) for host in _list(document.get("hosts", []))),
                _text(document.get("digest", "")),
                {
                    _text(name): _count(count)
                    for name, count in document.get("messages", {}).items()
                },
                _optional(document.get("seed"), _count),
                _named_texts(document.get("versions", {})),
                _named_texts(document.get("fingerprint", {})),
                _optional(document.get("pid"), _count),
                _text(document.get("began", "")),
                {
                    _text(name): ClockOffset.from_json(one)
                    for name, one in document.get("clock_offsets", {}).items()
                },
                _text(document.get("run", "")),
            )
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise InfoError(f"{source}: is damaged ({error})") from error

    def write(self, folder: Path) -> None:
        """Write run.json into a run folder, all of it or nothing.

        It is written where room was set aside for it. As long as the run goes on, or has no bag,
        room is set aside for the next one.
        """
        text = json.dumps(self.to_json(), indent=1, allow_nan=False) + "\n"
        room = folder / f"{INFO_FILE}.new"
        room.touch()
        with room.open("r+b") as file:
            file.write(text.encode())
            file.truncate()
        room.replace(folder / INFO_FILE)
        if self.status is EndStatus.RUNNING:
            with room.open("wb") as file:
                os.posix_fallocate(file.fileno(), 0, ROOM)

    @classmethod
    def read(cls, folder: Path) -> Self | None:
        """Return what the run.json of a run folder says, None where there is none.

        Raises
        ------
        InfoError
            When it cannot be read, or is damaged.
        UserError
            When its format is newer than ours.
        """
        file = folder / INFO_FILE
        if not file.is_file():
            return None
        try:
            document = read_json(file)
        except TextError as error:
            raise InfoError(f"{file}: {error}") from error
        return cls.from_json(document, str(file))


def _optional(value: Any, read: Callable[[Any], Number]) -> Number | None:
    return None if value is None else read(value)


def _count(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < _MOST:
        raise TypeError("a value is no whole number where one is due")
    return value


def _number(value: Any) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) < _MOST:
        raise TypeError("a value is no number where one is due")
    return float(value)


def _seconds(value: Any) -> float:
    if _number(value) < 0:
        raise TypeError("a value is negative where none may be")
    return float(value)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError("a value is no text where one is due")
    return one_line(value)


def _list(values: Any) -> list[Any]:
    if not isinstance(values, list):
        raise TypeError("a value is no list where one is due")
    return values


def _texts(values: Any) -> tuple[str, ...]:
    return tuple(_text(value) for value in _list(values))


def _named_texts(values: Any) -> dict[str, str]:
    return {_text(name): _text(value) for name, value in values.items()}
