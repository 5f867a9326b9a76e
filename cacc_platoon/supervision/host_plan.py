"""Which host gets which nodes, where it records and where it logs."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby, pairwise
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING

from cacc_platoon.errors import UserError
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import NodeName, host_name
from cacc_platoon.scenario.remote_hosts import RemoteHost

if TYPE_CHECKING:
    from cacc_platoon.runs.folder import RunFolder  # heavy, and hosts need it not

LOCALHOST_PARTICIPANTS = 100
"""DDS participants that find each other on one machine by unicast, the supervisor included; Fast
DDS tries no more ports for one, and `loopback.xml` announces it to so many."""


@dataclass(frozen=True)
class HostPlan:
    """What one host runs, where it records and where it logs.

    Attributes
    ----------
    run : str
        The run it belongs to.
    name : str
        Its name.
    nodes : tuple of NodeName
        Its nodes.
    scenario : Scenario
        What is run.
    part, log : Path
        Folder of its part, file of its log.
    verbose : bool
        Whether it logs to standard error too.
    ended : Path, optional
        Where the part is of its process that ended, to go on from.
    """

    run: str
    name: str
    nodes: tuple[NodeName, ...]
    scenario: Scenario
    part: Path
    log: Path
    verbose: bool = False
    ended: Path | None = None


def divide(scenario: Scenario, cores: int) -> list[list[NodeName]]:
    """Return the nodes of each host that a run starts, neighbours together.

    A relay goes with its receiver. Nodes that others start, singly or by host, are left out.

    Parameters
    ----------
    scenario : Scenario
        What is run.
    cores : int
        How many hosts there are when the scenario leaves it open.
    """
    elsewhere = {vehicle for host in scenario.remote_hosts for vehicle in host.vehicles}
    nodes = [
        node
        for node in scenario.nodes
        if str(node) not in scenario.run.manual_nodes and node.vehicle not in elsewhere
    ]
    vehicles = [list(own) for _, own in groupby(nodes, key=attrgetter("vehicle"))]
    if scenario.run.hosts == "per_node":
        return [[node] for vehicle in vehicles for node in vehicle]
    wanted = cores if scenario.run.hosts == "auto" else int(scenario.run.hosts)
    hosts = min(wanted, len(vehicles))
    cuts = [round(h * len(vehicles) / hosts) for h in range(hosts + 1)] if hosts else []
    return [
        [node for vehicle in vehicles[begin:end] for node in vehicle]
        for begin, end in pairwise(cuts)
    ]


def nodes_of(scenario: Scenario, host: RemoteHost) -> tuple[NodeName, ...]:
    """Return the nodes of a host that others start, from front to rear."""
    return tuple(node for node in scenario.nodes if node.vehicle in host.vehicles)


def plan_hosts(
    scenario: Scenario,
    folder: RunFolder,
    run: str,
    *,
    cores: int,
    local: bool = False,
    verbose: bool = False,
) -> list[HostPlan]:
    """Divide the nodes of a run among hosts.

    Parameters
    ----------
    scenario : Scenario
        What is run.
    folder : RunFolder
        Where they record and log.
    run : str
        What tells this run from every other.
    cores : int
        How many hosts there are when the scenario leaves it open.
    local : bool, optional
        Whether DDS stays on this machine, where it connects a limited number of processes.
    verbose : bool, optional
        Whether hosts log to standard error too.

    Raises
    ------
    UserError
        When the processes would not all find each other.
    """
    groups = divide(scenario, cores)
    if local and len(groups) >= LOCALHOST_PARTICIPANTS:
        raise UserError(
            f"run.hosts = {scenario.run.hosts} makes {len(groups)} processes, but DDS connects "
            f"fewer than {LOCALHOST_PARTICIPANTS} on one machine. Give run.hosts a smaller number."
        )
    return [
        HostPlan(
            run,
            f"{h}",
            tuple(group),
            scenario,
            part=folder.parts / host_name(f"{h}"),
            log=folder.logs / f"{host_name(str(h))}.log",
            verbose=verbose,
        )
        for h, group in enumerate(groups)
    ]
