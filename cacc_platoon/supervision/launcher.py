"""Starts and ends the host processes of a platoon."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Sequence
from itertools import groupby, pairwise
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from cacc_platoon.errors import UserError
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import host_name
from cacc_platoon.supervision.host import HostPlan, run_host

LOCALHOST_PARTICIPANTS = 32
"""DDS participants that find each other on one machine by unicast, the supervisor included."""


class Ended(NamedTuple):
    """A host process that is no longer there."""

    name: str
    pid: int
    how: str


def prepare() -> None:
    """Start loading what hosts need in the background, before anything else is done."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["cacc_platoon.supervision.host"])
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # a Ctrl-C is for the supervisor alone
    forkserver.ensure_running()
    signal.signal(signal.SIGINT, before)


def plan_hosts(scenario: Scenario, parts: Path, run: str) -> list[HostPlan]:
    """Divide the vehicles among hosts, neighbours together; a relay goes with its receiver.

    Raises
    ------
    UserError
        When the processes would not all find each other.
    """
    nodes = [node for node in scenario.nodes if str(node) not in scenario.run.manual_nodes]
    vehicles = [list(own) for _, own in groupby(nodes, key=attrgetter("vehicle"))]
    if not vehicles:
        return []
    if scenario.run.hosts == "per_node":
        groups = [[node] for vehicle in vehicles for node in vehicle]
    else:
        wanted = scenario.run.hosts
        hosts = len(os.sched_getaffinity(0)) if wanted == "auto" else int(wanted)
        hosts = min(hosts, len(vehicles))
        cuts = [round(h * len(vehicles) / hosts) for h in range(hosts + 1)]
        groups = [
            [node for vehicle in vehicles[begin:end] for node in vehicle]
            for begin, end in pairwise(cuts)
        ]
    local = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") == "LOCALHOST"
    if local and len(groups) >= LOCALHOST_PARTICIPANTS:
        raise UserError(
            f"run.hosts = {scenario.run.hosts} makes {len(groups)} processes, but DDS connects "
            f"fewer than {LOCALHOST_PARTICIPANTS} on one machine. Give run.hosts a smaller number."
        )
    return [
        HostPlan(run, f"{h}", tuple(group), scenario, parts / host_name(f"{h}"))
        for h, group in enumerate(groups)
    ]


class Plan(Protocol):
    """What a process is to do; it can be pickled."""

    @property
    def name(self) -> str:
        """Name of the host."""
        ...


class HostProcesses:
    """The hosts that this process has started."""

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("forkserver")
        self._running: dict[str, tuple[ForkServerProcess, Connection]] = {}

    def start(
        self, plans: Sequence[Plan], target: Callable[[Any, Connection], None] = run_host
    ) -> None:
        """Start a process for each plan, which runs it by `target`."""
        for plan in plans:
            reader, writer = self._context.Pipe(duplex=False)
            process = self._context.Process(
                target=target, args=(plan, reader), name=host_name(plan.name)
            )
            process.start()
            reader.close()
            self._running[plan.name] = (process, writer)

    def ended(self) -> list[Ended]:
        """Return the hosts that have ended."""
        found = []
        for name, (process, _) in self._running.items():
            code = process.exitcode
            if code is not None:
                how = (
                    f"was killed by {signal.Signals(-code).name}"
                    if code < 0
                    else f"ended with exit code {code}"
                )
                found.append(Ended(name, process.pid or 0, how))
        return found

    def stop(self, patience: float = 3.0) -> None:
        """Wait for the hosts to end by themselves, then end them."""
        processes = [process for process, _ in self._running.values()]
        self._join(processes, patience)
        for _, lifeline in self._running.values():
            lifeline.close()
        self._join(processes, 1.0)
        for process in processes:
            if process.is_alive() and process.pid:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process.pid, signal.SIGKILL)
        self._join(processes, 1.0)
        self._running.clear()

    @staticmethod
    def _join(processes: list[ForkServerProcess], patience: float) -> None:
        deadline = time.monotonic() + patience
        for process in processes:
            process.join(max(0.0, deadline - time.monotonic()))
