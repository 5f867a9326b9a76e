"""Starts and ends the host processes of a platoon."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Sequence
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess
from typing import Any, Protocol

from cacc_platoon.dds.shared_memory import own_temporary_files
from cacc_platoon.scenario.names import host_name
from cacc_platoon.supervision.host import run_host
from cacc_platoon.supervision.run_events import ProcessEnded


def prepare() -> None:
    """Start loading what hosts need in the background, before anything else is done."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["cacc_platoon.supervision.host"])
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # a Ctrl-C is for the supervisor alone
    with own_temporary_files():
        forkserver.ensure_running()
    signal.signal(signal.SIGINT, before)


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

    def started(self) -> dict[str, int]:
        """Return the process of each host that has been started so far."""
        running = [*self._running.items()]
        return {name: process.pid for name, (process, _) in running if process.pid}

    def ended(self) -> list[ProcessEnded]:
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
                found.append(ProcessEnded(name, process.pid or 0, how))
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
