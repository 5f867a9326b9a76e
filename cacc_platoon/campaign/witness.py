"""What a campaign sees of a platoon: who is who among its processes, and how far it is."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable
from pathlib import Path

from std_msgs.msg import String

from cacc_platoon.campaign.plan import Fault, Moment
from cacc_platoon.dds.shared_memory import used_segments
from cacc_platoon.nodes import qos
from cacc_platoon.runs.info import NO_BAG, InfoError, RunInfo
from cacc_platoon.supervision.protocol import HostState, ProtocolError, RunPhase, RunStatus
from cacc_platoon.testing import Platoon
from msg_adapters.topics import PlatoonTopics

LIMIT = 120.0
"""How long anything may take to come or to end [s]."""
MANY = 1000
IN_TIME = 0.6
"""A fault of a running platoon comes within this share of its samples."""
SOON = 0.25
"""One that lasts for seconds, within this share."""
LASTING = ("freeze_long", "freeze_supervisor", "cut", "cut_long")
_LOOK_PERIOD = 0.2


class Witness:
    """Watches one platoon.

    Parameters
    ----------
    run : Platoon
        The platoon, already started.

    Attributes
    ----------
    states : dict of str to HostState
        The last word of every host.
    status : RunStatus, optional
        The last word of the supervisor.
    segments : set of str
        Everything that its processes have used in shared memory so far.
    """

    def __init__(self, run: Platoon) -> None:
        self.run = run
        self.states: dict[str, HostState] = {}
        self.status: RunStatus | None = None
        self.segments: set[str] = set()
        self._looked = 0.0
        topics = PlatoonTopics(run.scenario.platoon.namespace)
        run.subscribe(String, topics.host_state, self._on_state, qos.latched(MANY))
        run.subscribe(String, topics.status, self._on_status, qos.latched())

    def _on_state(self, message: String) -> None:
        with contextlib.suppress(ProtocolError):
            state = HostState.from_json(message.data)
            self.states[state.host] = state

    def _on_status(self, message: String) -> None:
        with contextlib.suppress(ProtocolError):
            self.status = RunStatus.from_json(message.data)

    def wait(self, condition: Callable[[], bool], limit: float, what: str) -> None:
        """Wait for a condition, or for the end of the command; shared memory is watched meanwhile.

        Raises
        ------
        TimeoutError
            When neither comes in time.
        """
        self.run.wait(lambda: self._look() or condition() or self.ended, limit, what)

    def let_pass(self, seconds: float) -> None:
        """Let some time pass, or the rest of the run."""
        end = time.monotonic() + seconds
        self.wait(lambda: time.monotonic() >= end, seconds + LIMIT, f"{seconds:g} s")

    def _look(self) -> bool:
        if time.monotonic() - self._looked > _LOOK_PERIOD:
            self.note_segments()
        return False

    def note_segments(self) -> None:
        """Take note of what the processes use in shared memory."""
        self._looked = time.monotonic()
        for pid in self.run.living():
            with contextlib.suppress(OSError):
                self.segments |= used_segments(pid)

    @property
    def ended(self) -> bool:
        """Whether the command has ended."""
        return not Path(f"/proc/{self.run.pid('supervisor')}/exe").exists()

    @property
    def over(self) -> bool:
        """Whether nothing more is published by the run."""
        return self.ended or (self.status is not None and self.status.phase.ended)

    @property
    def sample(self) -> int:
        """The sample up to which everything is recorded."""
        return self.status.sample if self.status else -1

    def forkserver(self) -> int:
        """Return the process that starts the hosts; 0 when there is none."""
        supervisor = self.run.pid("supervisor")
        found = [p for p in self.run.living() if _parent(p) == supervisor and _starts_hosts(p)]
        return found[0] if found else 0

    def hosts(self) -> list[int]:
        """Return the processes of the hosts."""
        server = self.forkserver()
        return [pid for pid in self.run.living() if server and _parent(pid) == server]

    def process(self, fault: Fault) -> int:
        """Return the process that a fault happens to; 0 when it is not there."""
        if fault.process != "host":
            there = self.forkserver() if fault.process == "forkserver" else 0
            return self.run.pid("supervisor") if fault.process == "supervisor" else there
        living = self.hosts()
        for state in self.states.values():
            if fault.target in state.nodes:
                return state.pid if state.pid in living else 0
        return living[0] if living and not self.states else 0

    def names(self, pid: int) -> tuple[str, ...]:
        """Return what a process may be called in a message."""
        if pid == self.forkserver():
            return ("forkserver",)
        if pid == self.run.pid("supervisor"):
            return ("supervisor",)
        nodes = [node for one in self.states.values() if one.pid == pid for node in one.nodes]
        return (f"process {pid}", *nodes)

    def reach(self, fault: Fault) -> None:
        """Wait until the moment of a fault has come."""
        {
            Moment.START: self._reach_start,
            Moment.MATCH: self._reach_matching,
            Moment.RUN: self._reach_sample,
            Moment.MERGE: self._reach_merge,
            Moment.REPORT: self._reach_report,
        }[fault.moment](fault)
        self.note_segments()

    def _reach_start(self, fault: Fault) -> None:
        if fault.process in ("host", "forkserver"):
            self.wait(lambda: self.process(fault) > 0, LIMIT, f"the process of {fault.target}")
        self.let_pass(0.05 + fault.fraction)

    def _reach_matching(self, fault: Fault) -> None:
        self.wait(lambda: self.status is not None, LIMIT, "a status")
        self.let_pass(0.3 * fault.fraction)

    def _reach_sample(self, fault: Fault) -> None:
        share = SOON if fault.kind in LASTING else IN_TIME
        wanted = int(fault.fraction * share * (self.run.scenario.samples - 1))
        self.wait(lambda: self.sample >= wanted, LIMIT, f"sample {wanted}")

    def _reach_merge(self, fault: Fault) -> None:
        self.wait(lambda: self.over or NO_BAG in self._info().message, LIMIT, "the last sample")
        self.let_pass(0.2 * fault.fraction)

    def _reach_report(self, fault: Fault) -> None:
        self.wait(lambda: self._info().digest != "", LIMIT, "the bag")
        self.let_pass(fault.fraction)

    def _info(self) -> RunInfo:
        """Return what run.json says, which may not be there yet."""
        with contextlib.suppress(InfoError, OSError):
            return RunInfo.read(self.run.folder.path) or RunInfo()
        return RunInfo()

    @property
    def running(self) -> bool:
        """Whether the run goes on."""
        return self.status is not None and self.status.phase is RunPhase.RUNNING


def _parent(pid: int) -> int:
    with contextlib.suppress(OSError, IndexError, ValueError):
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    return 0


def _starts_hosts(pid: int) -> bool:
    with contextlib.suppress(OSError):
        return "forkserver" in Path(f"/proc/{pid}/cmdline").read_text()
    return False


def signal_to(pid: int, number: int) -> None:
    """Send a signal to a process that may be gone."""
    if pid > 0:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)
