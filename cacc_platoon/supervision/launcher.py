"""Starts and ends the host processes of a platoon."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Any, Protocol

from cacc_platoon.dds.shared_memory import own_temporary_files
from cacc_platoon.scenario.names import host_name
from cacc_platoon.stop_signal import STOP_SIGNALS
from cacc_platoon.supervision.host import run_host
from cacc_platoon.supervision.run_events import ProcessEnded

START_LIMIT = 10.0
"""How long the forkserver may take to start one process [s]."""
UNKNOWN_CODE = 255
"""What multiprocessing reports of a process when the forkserver is gone."""


def prepare() -> None:
    """Start loading what hosts need in the background, before anything else is done."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["cacc_platoon.supervision.host"])
    resource_tracker.ensure_running()  # unblocks signals, so before they are blocked
    with _signals_blocked(), own_temporary_files():
        forkserver.ensure_running()


@contextlib.contextmanager
def _signals_blocked() -> Iterator[None]:
    """Within, new processes begin deaf to stop signals, which are for the supervisor alone.

    What comes here meanwhile is delivered afterwards.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Plan(Protocol):
    """What a process is to do; it can be pickled."""

    @property
    def name(self) -> str:
        """Name of the host."""
        ...


class HostProcesses:
    """The hosts that this process has started.

    The forkserver starts them and tells how they end. It may be stopped or killed like any other
    process, so nobody waits for it without a limit: they are started in a thread, and whether they
    live is seen in /proc.
    """

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("forkserver")
        self._running: dict[str, tuple[ForkServerProcess, Connection]] = {}
        self._starter: threading.Thread | None = None
        self._began = 0.0
        self._stopping = False

    def start(
        self, plans: Sequence[Plan], target: Callable[[Any, Connection], None] = run_host
    ) -> None:
        """Start a process for each plan, which runs it by `target`; again, where one has ended."""
        for plan in plans:
            self._running.pop(plan.name, None)
        self._began = time.monotonic()
        arguments = plans, target, self._starter
        self._starter = threading.Thread(target=self._start, args=arguments, daemon=True)
        self._starter.start()

    def _start(
        self,
        plans: Sequence[Plan],
        target: Callable[[Any, Connection], None],
        before: threading.Thread | None,
    ) -> None:
        if before:
            before.join()
        with _signals_blocked():
            for plan in plans:
                if self._stopping:
                    return
                reader, writer = self._context.Pipe(duplex=False)
                process = self._context.Process(
                    target=target, args=(plan, reader), name=host_name(plan.name)
                )
                try:
                    process.start()
                except (OSError, EOFError):
                    return  # the forkserver is gone, which `trouble` tells
                reader.close()
                self._running[plan.name] = (process, writer)
                self._began = time.monotonic()

    def started(self) -> dict[str, int]:
        """Return the process of each host that has been started so far."""
        running = [*self._running.items()]
        return {name: process.pid for name, (process, _) in running if process.pid}

    def ended(self) -> list[ProcessEnded]:
        """Return the hosts that have ended, as far as there is somebody who knows."""
        found = []
        for name, (process, _) in [*self._running.items()]:
            code = process.exitcode
            if code is None or (code == UNKNOWN_CODE and _has_ended(_forkserver_pid())):
                continue
            how = (
                f"was killed by {signal.Signals(-code).name}"
                if code < 0
                else f"ended with exit code {code}"
            )
            found.append(ProcessEnded(name, process.pid or 0, how))
        return found

    def trouble(self) -> str:
        """Say why hosts can no longer be started or watched; empty as long as they can."""
        if self._starter is None:
            return ""
        pid = _forkserver_pid()
        who = f"the forkserver (process {pid}), which starts the hosts and knows how they end,"
        if _has_ended(pid):
            return f"{who} {_how_it_ended(pid)}"
        if self._starter.is_alive() and time.monotonic() - self._began > START_LIMIT:
            return f"{who} has not answered for {START_LIMIT:g} s"
        return ""

    def stop(self, patience: float = 3.0) -> None:
        """Wait for the hosts to end by themselves, then end them."""
        self._stop_starting()
        self._await(patience)
        for _, lifeline in self._running.values():
            lifeline.close()
        self._await(1.0)
        for pid in self._living():
            _kill(pid)
        self._await(1.0)
        deadline = time.monotonic() + 1.0
        for process, _ in self._running.values():
            process.join(max(0.0, deadline - time.monotonic()))
        if any(process.is_alive() for process, _ in self._running.values()):
            _kill_forkserver()
        self._running.clear()

    def _stop_starting(self) -> None:
        """Start no more hosts; without the forkserver, when that does not answer."""
        self._stopping = True
        if self._starter:
            self._starter.join(1.0)
            if self._starter.is_alive():
                _kill_forkserver()
                self._starter.join(1.0)

    def _living(self) -> list[int]:
        pids = [process.pid for process, _ in [*self._running.values()]]
        return [pid for pid in pids if pid and not _has_ended(pid)]

    def _await(self, patience: float) -> None:
        deadline = time.monotonic() + patience
        while self._living() and time.monotonic() < deadline:
            time.sleep(0.01)


def _forkserver_pid() -> int:
    """Return the forkserver's process, which multiprocessing keeps to itself."""
    return int(getattr(forkserver._forkserver, "_forkserver_pid", None) or 0)


def _kill(pid: int) -> None:
    if pid:  # 0 would be everybody
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def _kill_forkserver() -> None:
    """End it with what it has started, of which one may not have told its number yet."""
    server = _forkserver_pid()
    for pid in (*_children(server), server):
        _kill(pid)


def _children(pid: int) -> list[int]:
    with contextlib.suppress(OSError):
        return [*map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split())]
    return []


def _stat(pid: int) -> Sequence[str]:
    """Return what /proc says of a process, from its state on; nothing when it is gone."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ()


def _has_ended(pid: int) -> bool:
    stat = _stat(pid)
    return not stat or stat[0] in "ZX"


def _how_it_ended(pid: int) -> str:
    """Say how a child of ours ended that nobody has waited for."""
    stat = _stat(pid)
    code = int(stat[49]) if len(stat) > 49 else 0
    if number := code & 0x7F:
        return f"was killed by {signal.Signals(number).name}"
    return "is gone"
