"""Spins, feeds the run machine with what happens, and carries out what it decides."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from rclpy.executors import Executor
from rclpy.node import Node

from cacc_platoon.dds import shared_memory
from cacc_platoon.nodes.executor import spin_for
from cacc_platoon.scenario.run_event import RunEvent
from cacc_platoon.supervision.launcher import HostProcesses
from cacc_platoon.supervision.log import LOG, logs_to_stderr
from cacc_platoon.supervision.pacing import AwakeClock
from cacc_platoon.supervision.pause_services import Heeded
from cacc_platoon.supervision.pausing import Asked
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
    RestartHost,
    SignalReceived,
    StartHosts,
    Tell,
    Tick,
    Warn,
)
from cacc_platoon.supervision.run_machine import RunMachine
from cacc_platoon.supervision.run_state import Run, Stage, shown_sample, some
from cacc_platoon.supervision.supervisor_node import SupervisorNode, end_supervisor
from cacc_platoon.time_limit import time_limit

TICK = 0.02
CLOCK_PERIOD = 0.2
"""How often the simulated time is published at least, where it is [s]."""
CLOCKS_PERIOD = 1.0
"""How often hosts are asked for the time, where vehicles keep it by clocks [s]."""
VIEW_PERIOD, VIEW_PERIOD_OF_VEHICLE = 0.2, 0.004
"""How often viewers are shown what vehicles do [s], at least, and for each vehicle."""
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

    def restart(self, host: str) -> None:
        """Start the process of a host again."""

    def record_the_rest(self, topics: Sequence[str]) -> None:
        """Start a host in this process that records topics."""

    def note(self, event: RunEvent) -> None:
        """Write down what happened."""

    def close_own_host(self) -> None:
        """Close the host in this process, if there is one."""

    def poll(self) -> None:
        """Do what has to be done periodically."""

    def ended(self) -> list[ProcessEnded]:
        """Return the hosts whose processes have ended."""
        return self.processes.ended()

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
        steady = time.monotonic
        self._now = steady if machine.asks_clocks else AwakeClock(steady)
        self.run = machine.begin(run_id, self._now())
        self.start_time: float | None = None
        self._shown, self._shown_at, self._asked = -1, float("-inf"), float("-inf")
        node.feed, node.ask = self.feed, self.ask
        self._view_asked = 0.0
        self._view_period = max(VIEW_PERIOD, VIEW_PERIOD_OF_VEHICLE * len(node.graph.vehicles))

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
            doing = self._machine.doing(self.run)
            self._observe(doing, self.run.progress + 1, self._machine.samples)
            spin_for(self._executor, TICK)
            self._look_around()
            self.feed(Tick())
            self._show_time()
        return self.run.end

    def ask(self, asked: Asked) -> Heeded:
        """Do what a user asks for, if that can be; say what comes of it."""
        if why := self._machine.refuses(self.run, asked):
            return Heeded(False, why)
        self.feed(asked)
        held = self.run.held
        return Heeded(True, "goes on" if held is None else f"pauses at sample {held}")

    def _show_time(self) -> None:
        """Publish the simulated time, and again now and then for latecomers; it never goes back."""
        if not self._node.shows_time or self.run.started is None:
            return
        now = self._now()
        shown = max(self._shown, self._machine.simulated(self.run, now))
        if shown > self._shown or now - self._shown_at > CLOCK_PERIOD:
            self._shown, self._shown_at = shown, now
            self._node.publish_clock(shown)

    def feed(self, event: Event) -> None:
        """Let the machine decide about an event, and carry out what follows."""
        _log_event(event, self.run)
        before = self.run.stage
        self.run, actions = self._machine.step(self.run, event, self._now())
        if self.run.stage is not before:
            LOG.info("%s, sample %d", self.run.stage, self.run.progress)
        for action in actions:
            self._carry_out(action)

    def _ask_for_view(self) -> None:
        """Let viewers, if there are any, see how far the vehicles are."""
        now, sample = time.monotonic(), shown_sample(self.run, self._node.scenario)
        if sample >= 0 and now - self._view_asked >= self._view_period:
            self._view_asked = now
            self._node.ask_for_view(sample)

    def _look_around(self) -> None:
        """Feed what nobody reports."""
        self._ask_for_view()
        self._crew.poll()
        if (name := self._stopped()) and not self.run.signal:
            self.feed(SignalReceived(name))
        if (started := self._crew.processes.started()) != self.run.processes:
            self.feed(HostsStarted(started))
        for ended in self._crew.ended():
            if ended.host not in self.run.ended_processes:
                self.feed(ended)
        if (trouble := self._crew.trouble()) and trouble not in self.run.refused:
            self.feed(MeansLost(trouble))
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
                publishers, gone = self._machine.publishers(self.run), self.run.gone
                self.feed(self._node.look(publishers, processes, gone))
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
            case RestartHost(host):
                self._crew.restart(host)
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
        status = self._machine.status(run, outside)
        if self._machine.asks_clocks and time.monotonic() - self._asked > CLOCKS_PERIOD:
            self._asked = time.monotonic()
            status = replace(status, sent=time.time_ns())
        self._node.publish_status(status)


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
