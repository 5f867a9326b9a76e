"""A whole run from start to finish: hosts, barrier, progress, watch, end, run folder."""

from __future__ import annotations

import os
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import Executor
from rclpy.signals import SignalHandlerOptions

from cacc_platoon.bags.rows import Recording
from cacc_platoon.dds import shared_memory
from cacc_platoon.errors import UserError
from cacc_platoon.nodes.executor import create_executor, spin_for
from cacc_platoon.nodes.recorder import RecorderNode
from cacc_platoon.runs.folder import RunFolder
from cacc_platoon.runs.parts import read_parts
from cacc_platoon.scenario import Scenario
from cacc_platoon.supervision.host import FLUSH_PERIOD
from cacc_platoon.supervision.host_session import FAILED, FINISHED, HostSession
from cacc_platoon.supervision.launcher import HostProcesses, plan_hosts
from cacc_platoon.supervision.stall_diagnosis import diagnose
from cacc_platoon.supervision.supervisor_node import GRAPH_PERIOD, SupervisorNode
from msg_adapters.topics import Graph

TICK = 0.02
NEWCOMER_WAIT = 0.4
GOODBYE_TIMEOUT = 3.0
INTERRUPTED = "interrupted"
ADVICE = (
    "Another platoon or publisher uses these names; give one of them another platoon.namespace "
    "or ROS_DOMAIN_ID"
)

Observer = Callable[[str, int, int], None]
"""Called with what is going on, the sample reached and the number of samples."""


class RunFailedError(Exception):
    """The run cannot go on; the line names the node, its last sample and what was missing."""


@dataclass(frozen=True)
class Outcome:
    """How a run ended.

    Attributes
    ----------
    status : str
        "finished", "failed" or "interrupted".
    message : str
        Why it did not finish; empty otherwise.
    info : dict
        What run.json says.
    """

    status: str
    message: str
    info: dict[str, Any]


def run_platoon(
    scenario: Scenario,
    path: Path,
    observe: Observer = lambda *_: None,
    stopped: Callable[[], str | None] = lambda: None,
) -> Outcome:
    """Run a scenario on real nodes and leave a finished run folder.

    Parameters
    ----------
    scenario : Scenario
        What to run.
    path : Path
        The run folder, made here.
    observe : callable, optional
        Hears about progress.
    stopped : callable, optional
        Returns the name of a signal that asks for the end of the run, or None.

    Raises
    ------
    UserError
        When the run cannot start; nothing is left behind then.
    """
    shared_memory.sweep()
    run = uuid.uuid4().hex
    plans = plan_hosts(scenario, path / "parts", run) if scenario.run.spawn else []
    node = _start_node(scenario, run)
    try:
        folder = RunFolder.create(path, scenario)
    except BaseException:
        _end_node(node)
        raise
    supervision = Supervision(node, folder, observe, stopped)
    processes = HostProcesses()
    status, message = FINISHED, ""
    try:
        try:
            supervision.refuse_second_platoon()
            processes.start(plans)
            supervision.conduct(processes)
        except RunFailedError as failure:
            status, message = INTERRUPTED if stopped() else FAILED, str(failure)
        silent = supervision.end(status, message, processes)
    except BaseException:
        processes.stop(patience=0.0)
        raise
    recording = {**folder.recording(), **supervision.parts_elsewhere()}
    if status == FINISHED and (short := incomplete(scenario, recording)):
        status, message = FAILED, short
    if status == FAILED:
        samples = {name: len(record.messages) for name, record in recording.items()}
        message = "; ".join([message, *silent, diagnose(scenario, samples)])
    info = {"status": status, "message": message, **supervision.measured()}
    try:
        info = folder.finish(
            scenario, recording, info, lambda k, n: observe("writing the bag", k, n)
        )
    except OSError as error:
        unwritten = f"the bag could not be written ({error.strerror}); `platoon report` tries again"
        return Outcome(FAILED, "; ".join(filter(None, [message, unwritten])), info)
    return Outcome(status, message, info)


def incomplete(scenario: Scenario, recording: Recording) -> str:
    """Say which topic lacks samples; empty when every topic has all of them."""
    for topic in Graph.of(scenario).recorded:
        count = len(recording[topic.name].messages) if topic.name in recording else 0
        if count != scenario.samples:
            return f"{topic.name}: only {count} of {scenario.samples} samples were recorded"
    return ""


def _start_node(scenario: Scenario, run: str) -> SupervisorNode:
    """Start rclpy and the supervisor's node, or say in one line why that cannot be."""
    try:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        return SupervisorNode(scenario, run)
    except (RuntimeError, ValueError, NameValidationException, ParameterException) as error:
        rclpy.try_shutdown()
        raise UserError(
            f"ROS does not start: {' '.join(str(error).split())}. Look at ROS_DOMAIN_ID and at "
            "platoon doctor."
        ) from error


def _end_node(node: SupervisorNode) -> None:
    with shared_memory.cleared_segments():
        node.destroy_node()
        rclpy.try_shutdown()


class Supervision:
    """The steps of a run, in the supervisor's process."""

    def __init__(
        self,
        node: SupervisorNode,
        folder: RunFolder,
        observe: Observer,
        stopped: Callable[[], str | None],
    ) -> None:
        self._node, self._scenario, self._folder = node, node.scenario, folder
        self._observe, self._stopped = observe, stopped
        self._executor: Executor = create_executor()
        self._executor.add_node(self._node)
        self._recorder: RecorderNode | None = None
        self._session: HostSession | None = None
        self._begun = time.monotonic()
        self._first_sample = self._last_sample = self._flushed = self._graph_checked = 0.0
        self._start_time: float | None = None
        shared_memory.note_segments()

    def refuse_second_platoon(self) -> None:
        """Give way when the namespace is taken, before any host is started."""

        def looked_around() -> bool:
            self._check_graph()
            return self._elapsed(self._begun) > NEWCOMER_WAIT

        self._wait(looked_around, "looking around")

    def conduct(self, processes: HostProcesses) -> None:
        """Bring the run from waiting to its last sample.

        Raises
        ------
        RunFailedError
            When a node does not appear, dies, stalls or reports a failure, or on a signal.
        """
        node, limit = self._node, self._scenario.run.start_timeout
        began = time.monotonic()

        def started(missing: list[str], what: str) -> bool:
            self._check_graph_now_and_then()
            if missing and self._elapsed(began) > limit:
                raise RunFailedError(
                    f"after {limit:g} s {what}: {_some(missing)}. Start what is missing, or raise "
                    "run.start_timeout."
                )
            return not missing

        self._wait(
            lambda: started(node.absent_nodes(), "these nodes have not appeared"),
            "starting nodes",
            processes,
        )
        if disagreements := node.disagreements():
            raise RunFailedError(f"{_some(disagreements)}. Start it with the run's parameters")
        self._record_the_rest()
        node.begin_matching()
        self._wait(
            lambda: started(node.unmatched(), "these connections are missing"),
            "connecting nodes",
            processes,
        )
        self._check_graph()
        node.begin_running()
        self._first_sample = time.monotonic()
        self._start_time = _process_age()
        self._follow_progress(processes)
        self._last_sample = time.monotonic()

    def end(self, status: str, message: str, processes: HostProcesses) -> list[str]:
        """End hosts and nodes in good order; return a line on each host that does not answer."""
        node = self._node
        dead = {ended.name for ended in processes.ended()}
        node.end(FINISHED if status == FINISHED else FAILED, message)
        if self._session:
            self._session.close()
        deadline = time.monotonic() + GOODBYE_TIMEOUT
        while silent := [
            f"host {name} (process {host['pid']}: {_some(host['nodes'])}) does not answer"
            for name, host in node.hosts.items()
            if host["state"] != "closed" and name not in dead
        ]:
            if time.monotonic() > deadline:
                break
            self._spin()
            dead |= {ended.name for ended in processes.ended()}
        processes.stop()
        if self._recorder:
            self._recorder.close()
        self._executor.shutdown()
        if self._recorder:
            self._recorder.destroy_node()
        _end_node(node)
        shared_memory.sweep()
        return silent

    def parts_elsewhere(self) -> dict[str, Any]:
        """Return what hosts recorded outside of the run folder, as far as it is on this machine."""
        parts = [Path(host["part"]) for host in self._node.hosts.values() if host["part"]]
        return read_parts(
            [part for part in parts if self._folder.parts.absolute() not in part.parents]
        )

    def measured(self) -> dict[str, Any]:
        """Return times, progress and hosts for run.json."""
        wall = max(0.0, self._last_sample - self._first_sample)
        run = self._scenario.run
        return {
            "samples": self._node.progress + 1,
            "wall_time": wall,
            "real_time_factor": run.duration / wall if wall else None,
            "start_time": self._start_time,
            "hosts": self._node.host_summaries(),
        }

    def _follow_progress(self, processes: HostProcesses) -> None:
        node, limit = self._node, self._scenario.run.stall_timeout
        progress, moved = node.progress, time.monotonic()
        if self._scenario.run.real_time_factor:
            limit += (
                self._scenario.run.step
                * node.scenario.run.window
                / (self._scenario.run.real_time_factor)
            )

        def complete() -> bool:
            nonlocal progress, moved
            now = time.monotonic()
            if node.progress > progress:
                progress, moved = node.progress, now
            elif now - moved > limit:
                raise RunFailedError(f"no progress for {limit:g} s")
            self._check_graph_now_and_then()
            return node.complete

        self._wait(complete, "running", processes)

    def _record_the_rest(self) -> None:
        """Record in this process what no host records."""
        covered = {topic for host in self._node.hosts.values() for topic in host["records"]}
        topics = [t for t in Graph.of(self._scenario).recorded if t.name not in covered]
        if not topics:
            return
        part = self._folder.parts / "supervisor"
        self._recorder = RecorderNode(self._scenario, "supervisor", topics, part)
        self._executor.add_node(self._recorder)
        self._session = HostSession(
            "supervisor", [self._recorder], self._scenario, self._recorder, self._node.run
        )
        self._wait(lambda: "supervisor" in self._node.hosts, "starting nodes")

    def _wait(
        self, done: Callable[[], bool], what: str, processes: HostProcesses | None = None
    ) -> None:
        """Spin until something is done; raise RunFailedError when the run cannot go on."""
        while not done():
            self._observe(what, self._node.progress + 1, self._scenario.samples)
            self._spin()
            if signal_name := self._stopped():
                raise RunFailedError(f"stopped by {signal_name}")
            if failures := self._node.failures():
                raise RunFailedError("; ".join([*failures[:3], *self._strangers(failures)]))
            for ended in processes.ended() if processes else ():
                nodes = self._node.hosts.get(ended.name, {}).get("nodes", ["before it appeared"])
                raise RunFailedError(
                    f"host {ended.name} (process {ended.pid}: {_some(nodes)}) {ended.how}"
                )

    def _spin(self) -> None:
        spin_for(self._executor, TICK)
        self._node.poll()
        if self._session:
            self._session.poll()
        if time.monotonic() - self._flushed > FLUSH_PERIOD:
            self._flushed = time.monotonic()
            shared_memory.note_segments()
            if self._recorder:
                self._recorder.flush()

    def _strangers(self, failures: list[str]) -> list[str]:
        """Say who else publishes, if the failures sound like it and the graph shows it soon."""
        if not any("another publisher" in failure for failure in failures):
            return []
        deadline = time.monotonic() + GRAPH_PERIOD
        while not (found := self._node.foreign_publishers()) and time.monotonic() < deadline:
            self._spin()
        return [*found[:1], ADVICE]

    def _check_graph_now_and_then(self) -> None:
        if time.monotonic() - self._graph_checked > GRAPH_PERIOD:
            self._graph_checked = time.monotonic()
            self._check_graph()

    def _check_graph(self) -> None:
        if foreign := self._node.foreign_publishers():
            raise RunFailedError(f"{foreign[0]}. {ADVICE}")

    @staticmethod
    def _elapsed(since: float) -> float:
        return time.monotonic() - since


def _process_age() -> float:
    """Return for how long this process has been there [s]: the wait from command to now."""
    started = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
    return time.clock_gettime(time.CLOCK_BOOTTIME) - started / os.sysconf("SC_CLK_TCK")


def _some(items: list[str], limit: int = 6) -> str:
    more = f" and {len(items) - limit} more" if len(items) > limit else ""
    return ", ".join(items[:limit]) + more
