"""Hosts that somebody starts on other machines: which vehicles each has, and how it is started."""

from __future__ import annotations

import re
import shlex
from collections.abc import Container, Iterable
from typing import NamedTuple

from cacc_platoon.scenario.names import vehicle_name
from cacc_platoon.scenario.parameter import Parameter
from cacc_platoon.scenario.table import TABLE, Run

MOST_VEHICLES = 1000
_NAME = re.compile(r"(?=.{1,50}\Z)[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*", re.ASCII)
_RANGE = re.compile(r"(\d{1,4})(?:-(\d{1,4}))?", re.ASCII)
_TAKEN = ("supervisor", "recorder")
"""Names of hosts that every run may have."""


class RemoteHost(NamedTuple):
    """A host that is waited for by its name.

    Attributes
    ----------
    name : str
        Its name.
    vehicles : tuple of int
        Its vehicles, each with all of its nodes, in order.
    """

    name: str
    vehicles: tuple[int, ...]

    def __str__(self) -> str:
        return f"host {self.name} (vehicles {vehicles_text(self.vehicles)})"


def remote_hosts(run: Run) -> tuple[RemoteHost, ...]:
    """Return the hosts that others start, of a checked run."""
    pairs = (text.partition("=") for text in run.remote_hosts)
    return tuple(RemoteHost(name.strip(), read_vehicles(vehicles)) for name, _, vehicles in pairs)


def host_commands(run: Run) -> dict[str, list[str]]:
    """Return the words of the command prefix of each host that has one, of a checked run."""
    pairs = (text.partition("=") for text in run.host_commands)
    return {name.strip(): shlex.split(command) for name, _, command in pairs}


def is_host_name(name: str) -> bool:
    """Whether a host on another machine may have a name.

    Examples
    --------
    >>> is_host_name("east_2"), is_host_name("2"), is_host_name("supervisor")
    (True, False, False)
    """
    return bool(_NAME.fullmatch(name)) and name not in _TAKEN


def read_vehicles(text: str) -> tuple[int, ...]:
    """Return the vehicles that a text such as `1-3,6` names, in order and once.

    Raises
    ------
    ValueError
        When it is no such text.

    Examples
    --------
    >>> read_vehicles("4-6, 0")
    (0, 4, 5, 6)
    """
    found: list[int] = []
    for piece in text.split(","):
        match = _RANGE.fullmatch(piece.strip())
        if match is None:
            raise ValueError(f"{piece.strip()[:20]!r} is neither a vehicle nor a range of them")
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first or last - first >= MOST_VEHICLES:
            raise ValueError(f"{piece.strip()!r} is no range of vehicles")
        found += range(first, last + 1)
    if len(set(found)) < len(found):
        raise ValueError("a vehicle is named twice")
    return tuple(sorted(found))


def vehicles_text(vehicles: Iterable[int]) -> str:
    """Return vehicles in the form that `read_vehicles` takes.

    Examples
    --------
    >>> vehicles_text([0, 4, 5, 6, 9])
    '0,4-6,9'
    """
    runs: list[list[int]] = []
    for vehicle in vehicles:
        if runs and vehicle == runs[-1][-1] + 1:
            runs[-1].append(vehicle)
        else:
            runs.append([vehicle])
    return ",".join(f"{run[0]}-{run[-1]}" if run[1:] else f"{run[0]}" for run in runs)


def check_remote_hosts(run: Run, vehicles: Container[int], source: str) -> None:
    """Refuse hosts that cannot be: names, vehicles that are not there or are somebody else's."""
    row = TABLE["run.remote_hosts"]
    taken: dict[int, str] = {}
    names: set[str] = set()
    for text in run.remote_hosts:
        host = _read(text, row, source)
        if host.name in names:
            raise row.refusal(text, source, f"is the second of the name {host.name}")
        names.add(host.name)
        for vehicle in host.vehicles:
            if vehicle not in vehicles:
                raise row.refusal(text, source, f"has {vehicle_name(vehicle)}, which is not there")
            if vehicle in taken:
                rule = f"has {vehicle_name(vehicle)}, which host {taken[vehicle]} has already"
                raise row.refusal(text, source, rule)
            taken[vehicle] = host.name
    for node in run.manual_nodes:
        name = next((taken[v] for v in taken if node.startswith(f"{vehicle_name(v)}/")), "")
        if name:
            rule = f"is a node of host {name} in run.remote_hosts already"
            raise TABLE["run.manual_nodes"].refusal(node, source, rule)
    _check_commands(run, names, source)


def _read(text: str, row: Parameter, source: str) -> RemoteHost:
    """Return the host of a text, or raise ScenarioError."""
    name, equals, vehicles = text.partition("=")
    if not equals:
        raise row.refusal(text, source, "must be NAME=VEHICLES such as east=1-6")
    if not is_host_name(name.strip()):
        rule = (
            "must begin with a name of letters, digits and single underscores, a letter first, "
            f"which is none of {', '.join(_TAKEN)}"
        )
        raise row.refusal(text, source, rule)
    try:
        return RemoteHost(name.strip(), read_vehicles(vehicles))
    except ValueError as error:
        raise row.refusal(
            text, source, f"must be NAME=VEHICLES such as east=1-6: {error}"
        ) from None


def _check_commands(run: Run, names: Container[str], source: str) -> None:
    """Refuse commands of hosts that are not there, twice, or that are none."""
    row, seen = TABLE["run.host_commands"], set[str]()
    for text in run.host_commands:
        name = text.partition("=")[0].strip()
        try:
            words = shlex.split(text.partition("=")[2])
        except ValueError as error:
            raise row.refusal(text, source, f"cannot be split into words: {error}") from None
        if not words:
            raise row.refusal(text, source, 'must be NAME=COMMAND such as "east=ssh user@east"')
        if name not in names:
            raise row.refusal(text, source, f"is of a host {name} that run.remote_hosts has not")
        if name in seen:
            raise row.refusal(text, source, f"is the second of host {name}")
        seen.add(name)
