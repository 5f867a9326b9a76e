"""Spins, feeds the run machine with what happens, and carries out what it decides."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from rclpy.executors import Executor
from rclpy.node import Node

from cacc_platoon.dds import shared_memory
from cacc_platoon.nodes.executor import spin_for
from cacc_platoon.scenario.run_event import RunEvent
from cacc_platoon.supervision.launcher import HostProcesses
from cacc_platoon.supervision.log import LOG, logs_to_stderr
from cacc_platoon.supervision.protocol import RunPhase
from cacc_platoon.supervision.run_events import (
    Action,
    Announce,
    CloseOwnHost,
    EndRun,
    Event,
    FollowRecorder,
    GraphObserved,
    HostReported,
    HostsStarted,
    MeansLost,
    ObserveGraph,
    ProcessEnded,
    PublishHorizon,
    PublishStatus,
    RecordersConnected,
    RecordTheRest,
    SignalReceived,
    StartHosts,
    Tell,
    Tick,
    Warn,
)
from cacc_platoon.supervision.run_machine import RunMachine
from cacc_platoon.supervision.run_state import Run, Stage, some
from cacc_platoon.supervision.supervisor_node import SupervisorNode, end_supervisor
from cacc_platoon.time_limit import time_limit

TICK = 0.02
DDS_LIMIT = 10.0
"""How long nodes may take to end [s]; a mutex of a killed process would hold them for ever."""

Observer = Callable[[str, int, int], None]
"""Called with what is going on, the sample reached and the number of samples."""


class Crew:
    """The hosts of a run: processes of their own, and perhaps one in this process.

    Attributes
    ----------
    processes : HostProcesses
        The processes.
    nodes : list of Node
        The nodes of the host in this process.
    """

    def __init__(self) -> None:
        self.processes = HostProcesses()
        self.nodes: list[Node] = []

    def start_hosts(self) -> None:
        """Start the processes."""

    def record_the_rest(self, topics: Sequence[str]) -> None:
        """Start a host in this process that records topics."""

    def note(self, event: RunEvent) -> None:
        """Write down what happened."""

    def close_own_host(self) -> None:
        """Close the host in this process, if there is one."""

    def poll(self) -> None:
        """Do what has to be done periodically."""

    def trouble(self) -> str:
        """Say what the run cannot do without and has lost; empty as long as all is there."""
        return self.processes.trouble()

    def close(self) -> None:
        """End what is left of the hosts."""
        self.processes.stop()


class Conductor:
    """Conducts a run with a node, a machine that decides, and a crew.

    Parameters
    ----------
    node : SupervisorNode
        The node of the supervisor.
    executor : Executor
        Spins it.
    machine : RunMachine
        Decides.
    crew : Crew
        The hosts.
    run_id : str
        What tells this run from every other.
    observe : callable
        Receives the progress.
    stopped : callable
        Returns the name of a signal that asks for the end of the run, or None.

    Attributes
    ----------
    run : Run
        The state of the run.
    start_time : float, optional
        How long this process had been there when the run began to run [s].
    """

    def __init__(
        self,
        node: SupervisorNode,
        executor: Executor,
        machine: RunMachine,
        crew: Crew,
        *,
        run_id: str,
        observe: Observer,
        stopped: Callable[[], str | None],
    ) -> None:
        self._node, self._executor = node, executor
        self._machine, self._crew = machine, crew
        self._observe, self._stopped = observe, stopped
        self.run = machine.begin(run_id, time.monotonic())
        self.start_time: float | None = None
        node.feed = self.feed

    @property
    def samples(self) -> int:
        """How many samples the run has when it is complete."""
        return self._machine.last_sample(self.run) + 1

    def conduct(self) -> EndRun:
        """Bring the run to its end, and end every process; return how it ended.

        The nodes of this process stay until `leave`: what must not be lost is saved before.
        """
        LOG.info("run %s: %s", self.run.id, self.run.stage)
        try:
            end = self._conduct()
        except BaseException:
            self._crew.processes.stop(patience=0.0)
            raise
        self._crew.close()
        return end

    def leave(self, exit_code: int) -> None:
        """End the nodes of this process; where that takes too long, the process, with a code."""
        with time_limit(DDS_LIMIT, exit_code):
            self._executor.shutdown()
            for node in self._crew.nodes:
                node.destroy_node()
            end_supervisor(self._node)
            shared_memory.sweep()

    def _conduct(self) -> EndRun:
        while self.run.end is None or self.run.stage is not Stage.OVER:
            self._observe(self.run.stage, self.run.progress + 1, self._machine.samples)
            spin_for(self._executor, TICK)
            self._look_around()
            self.feed(Tick())
        return self.run.end

    def feed(self, event: Event) -> None:
        """Let the machine decide about an event, and carry out what follows."""
        _log_event(event, self.run)
        before = self.run.stage
        self.run, actions = self._machine.step(self.run, event, time.monotonic())
        if self.run.stage is not before:
            LOG.info("%s, sample %d", self.run.stage, self.run.progress)
        for action in actions:
            self._carry_out(action)

    def _look_around(self) -> None:
        """Feed what nobody reports."""
        self._crew.poll()
        if (name := self._stopped()) and not self.run.signal:
            self.feed(SignalReceived(name))
        for ended in self._crew.processes.ended():
            if ended.host not in self.run.ended_processes:
                self.feed(ended)
        if (trouble := self._crew.trouble()) and trouble not in self.run.refused:
            self.feed(MeansLost(trouble))
        if (started := self._crew.processes.started()) != self.run.processes:
            self.feed(HostsStarted(started))
        if self.run.stage is Stage.MATCHING:
            connected = self._node.connected_recorders(self.run.recorded)
            if connected != self.run.connected:
                self.feed(RecordersConnected(connected))

    def _carry_out(self, action: Action) -> None:
        match action:
            case PublishHorizon(sample):
                self._node.publish_horizon(sample)
            case PublishStatus():
                self._publish_status()
            case ObserveGraph():
                processes = [host.pid for host in self.run.hosts.values()]
                processes += self.run.processes.values()
                self.feed(self._node.look(self._machine.publishers(self.run), processes))
            case Warn(line):
                _warn(line)
            case _:
                self._carry_out_once(action)

    def _carry_out_once(self, action: Action) -> None:
        """Carry out what is done a few times in a run at most."""
        match action:
            case Announce():
                self._node.announce()
            case FollowRecorder(host):
                self._node.follow_recorder(host)
            case StartHosts():
                self._crew.start_hosts()
            case RecordTheRest(topics):
                self._crew.record_the_rest(topics)
            case Tell(event):
                self._node.publish_event(event)
                self._crew.note(event)
            case CloseOwnHost():
                self._crew.close_own_host()
            case EndRun() if action.message:
                LOG.info("%s", "; ".join(filter(None, [action.message, *action.silent])))

    def _publish_status(self) -> None:
        run = self.run
        outside = None
        if run.phase is RunPhase.MATCHING:
            nodes = {node for host in run.hosts.values() for node in host.nodes}
            outside = self._node.outside_subscribers(nodes)
        if run.phase is RunPhase.RUNNING and self.start_time is None:
            self.start_time = process_age()
        self._node.publish_status(self._machine.status(run, outside))


def _log_event(event: Event, run: Run) -> None:
    """Log what a person who looks for a fault wants to know; nothing that comes every sample."""
    match event:
        case HostReported(state):
            known = run.hosts.get(state.host)
            if state.run == run.id and (known is None or known.phase is not state.phase):
                detail = state.failure or (some(state.nodes) if known is None else "")
                LOG.info("host %s: %s", state.host, " ".join([state.phase, detail]).strip())
        case GraphObserved(foreign) if foreign:
            LOG.info("%s", "; ".join(foreign))
        case ProcessEnded(host, pid, how):
            LOG.info("host %s (process %d) %s", host, pid, how)
        case MeansLost(reason):
            LOG.info("%s", reason)
        case SignalReceived(name):
            LOG.info("stopped by %s", name)


def _warn(line: str) -> None:
    LOG.warning("%s", line)
    if not logs_to_stderr():
        print(f"platoon: warning: {line}", file=sys.stderr)


def process_age() -> float:
    """Return for how long this process has been there [s]: the wait from command to now."""
    started = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
    return time.clock_gettime(time.CLOCK_BOOTTIME) - started / os.sysconf("SC_CLK_TCK")
