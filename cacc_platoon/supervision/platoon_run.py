"""A whole run from start to finish: the hosts, the run folder, how it ended."""

from __future__ import annotations

import contextlib
import dataclasses
import multiprocessing
import os
import shutil
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rclpy.executors import Executor
from rclpy.node import Node

from cacc_platoon.bags.rows import Recording
from cacc_platoon.dds import shared_memory
from cacc_platoon.dds.environment import is_local
from cacc_platoon.nodes.executor import create_executor
from cacc_platoon.nodes.recorder import RecorderNode
from cacc_platoon.runs.events import append_events
from cacc_platoon.runs.folder import UNFINISHED, RunFolder
from cacc_platoon.runs.info import EndStatus, RunInfo
from cacc_platoon.runs.parts import read_parts
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.scenario.timeline import change_of
from cacc_platoon.supervision.belief import Belief, OwnHost
from cacc_platoon.supervision.clock_machine import ClockMachine, system_ahead
from cacc_platoon.supervision.conductor import Conductor, Crew, Observer
from cacc_platoon.supervision.fetching import fetch_parts, is_here
from cacc_platoon.supervision.host import FLUSH_PERIOD
from cacc_platoon.supervision.host_plan import HostPlan, plan_hosts
from cacc_platoon.supervision.host_session import HostSession
from cacc_platoon.supervision.log import LOG, logging_to, logs_to_stderr
from cacc_platoon.supervision.outcome import conclude
from cacc_platoon.supervision.pacing import start_by_clocks
from cacc_platoon.supervision.remote_commands import RemoteCommands, words_of
from cacc_platoon.supervision.run_events import ProcessEnded
from cacc_platoon.supervision.run_machine import RunMachine
from cacc_platoon.supervision.run_state import OWN_HOST, Run, summaries
from cacc_platoon.supervision.supervisor_node import (
    SupervisorNode,
    end_supervisor,
    start_supervisor,
)
from msg_adapters.topics import Graph


@dataclass(frozen=True)
class Outcome:
    """How a run ended.

    Attributes
    ----------
    status : EndStatus
        "finished", "failed" or "interrupted".
    message : str
        Why it did not finish; empty otherwise.
    info : RunInfo
        What run.json says.
    leave : callable
        To be called with an exit code when everything that counts is saved: it ends the node of the
        supervisor, and where that takes too long, the process with that exit code.
    """

    status: EndStatus
    message: str
    info: RunInfo
    leave: Callable[[int], None]


def run_platoon(
    scenario: Scenario,
    path: Path,
    observe: Observer = lambda *_: None,
    stopped: Callable[[], str | None] = lambda: None,
    insisted: Callable[[], bool] = lambda: False,
    *,
    beside: Callable[[], Sequence[Node]] = tuple,
) -> Outcome:
    """Run a scenario on real nodes and leave a finished run folder.

    From the moment the folder is there, its run.json is true, whatever ends the run.

    Parameters
    ----------
    scenario : Scenario
        What to run.
    path : Path
        The run folder, made here.
    observe : callable, optional
        Receives the progress.
    stopped : callable, optional
        Returns the name of a signal that asks for the end of the run, or None.
    insisted : callable, optional
        Returns whether it was asked for again: then the bag is left to `platoon report`.
    beside : callable, optional
        Makes nodes that are spun in this process beside that of the supervisor.

    Raises
    ------
    UserError
        When the run cannot start; nothing is left behind then.
    """
    shared_memory.sweep()
    multiprocessing.current_process().name = OWN_HOST
    run_id = uuid.uuid4().hex
    plans = _plans(scenario, path, run_id) if scenario.run.spawn else []
    words = words_of(scenario, os.environ)
    node = start_supervisor(scenario)
    try:
        folder = RunFolder.create(path, scenario, run_id)
    except BaseException:
        end_supervisor(node)
        raise
    remote = RemoteCommands(words, folder.logs)
    with logging_to(folder.logs / f"{OWN_HOST}.log"), remote:
        conductor, crew = _conductor(
            node, folder, plans, run_id, remote, observe=observe, stopped=stopped
        )
        crew.take_along(beside())
        try:
            conductor.conduct()
            elsewhere = crew.fetch(conductor.run, node, observe, insisted)
            remote.stop()
            return _finish(folder, crew.scenario, conductor, elsewhere, _until(insisted, observe))
        except BaseException as error:
            _say_what_happened(folder, error)
            raise


class _InsistedError(Exception):
    """The process is to end now; what can be done later is left for later."""


def _until(insisted: Callable[[], bool], observe: Observer) -> Callable[[int, int], None]:
    """Return what observes how the bag is written, and stops it."""

    def report(done: int, total: int) -> None:
        observe("writing the bag", done, total)
        if insisted():
            raise _InsistedError

    return report


def _say_what_happened(folder: RunFolder, error: BaseException) -> None:
    """Write a run.json for a run that ended in a way that nobody has thought of."""
    what = " ".join(f"{type(error).__name__}: {error}".split())
    info = dataclasses.replace(folder.begun, status=EndStatus.FAILED, message=what)
    with contextlib.suppress(OSError):
        info.without_bag().write(folder.path)


def _plans(scenario: Scenario, path: Path, run_id: str) -> list[HostPlan]:
    return plan_hosts(
        scenario,
        RunFolder(path),
        run_id,
        cores=len(os.sched_getaffinity(0)),
        local=is_local(os.environ),
        verbose=logs_to_stderr(),
    )


class RunCrew(Crew):
    """The hosts of a run, and the recorder of what none of them records.

    Parameters
    ----------
    scenario : Scenario
        What is run.
    run_id : str
        What tells this run from every other.
    plans : sequence of HostPlan
        The hosts to start.
    executor : Executor
        Spins the recorder.
    folder : RunFolder
        Where it records.
    remote : RemoteCommands
        Start further hosts, elsewhere.

    Attributes
    ----------
    scenario : Scenario
        What is run, with the changes that were not planned.
    """

    def __init__(
        self,
        scenario: Scenario,
        run_id: str,
        plans: Sequence[HostPlan],
        executor: Executor,
        folder: RunFolder,
        *,
        remote: RemoteCommands,
    ) -> None:
        super().__init__()
        self._remote = remote
        self.scenario, self._run_id, self._plans = scenario, run_id, plans
        self._executor, self._folder = executor, folder
        self._trouble = ""
        self._recorder: RecorderNode | None = None
        self._session: HostSession | None = None
        self._flushed = time.monotonic()

    def start_hosts(self) -> None:
        """Start the processes."""
        self.processes.start(self._plans)
        self._remote.start()

    def ended(self) -> list[ProcessEnded]:
        """Return the hosts whose processes, here or elsewhere, have ended."""
        return [*super().ended(), *self._remote.ended()]

    def fetch(
        self, run: Run, node: SupervisorNode, observe: Observer, given_up: Callable[[], bool]
    ) -> Mapping[str, str]:
        """Fetch what hosts on other machines have recorded; return what stays there, by host."""
        return fetch_parts(
            self.scenario,
            run,
            self._folder.parts,
            node,
            self._executor,
            observe=lambda done, total: observe("fetching parts", done, total),
            given_up=given_up,
        )

    def restart(self, host: str) -> None:
        """Start the process of a host again, which goes on from what the one before recorded."""
        (plan,) = (plan for plan in self._plans if plan.name == host)
        ended = self._folder.ended_part(plan.part)
        self.processes.start([replace(plan, ended=ended)])

    def take_along(self, nodes: Sequence[Node]) -> None:
        """Spin more nodes in this process until it leaves."""
        for node in nodes:
            self.nodes.append(node)
            self._executor.add_node(node)

    def record_the_rest(self, topics: Sequence[str]) -> None:
        """Record topics in this process."""
        recorded = [topic for topic in Graph.of(self.scenario).recorded if topic.name in topics]
        part = self._folder.parts / OWN_HOST
        self._recorder = RecorderNode(self.scenario, OWN_HOST, recorded, part)
        self.nodes.append(self._recorder)
        self._executor.add_node(self._recorder)
        self._session = HostSession(
            OWN_HOST,
            [self._recorder],
            self.scenario,
            records=self._recorder.recorded,
            part=str(self._recorder.folder),
            run=self._run_id,
        )

    def poll(self) -> None:
        """Keep the host in this process going."""
        if self._session and self._recorder:
            self._session.poll()
            self._recorder.end_at(self._session.samples)
        if time.monotonic() - self._flushed > FLUSH_PERIOD:
            self._flushed = time.monotonic()
            shared_memory.note_segments()
            if self._recorder:
                self._recorder.flush()
            if not self._folder.parts.is_dir():
                self._trouble = f"{self._folder.parts}: was deleted or moved while the run goes on"

    def trouble(self) -> str:
        """Say what the run cannot do without and has lost."""
        return self._trouble or super().trouble()

    def note(self, event: RunEvent) -> None:
        """Write down what happened; a disk that is full is told of by who records."""
        with contextlib.suppress(OSError):
            append_events(self._folder.path, [event], self.scenario.run.step)
            planned = [change.event for change in self.scenario.changes]
            if event.kind is EventKind.CHANGE and event not in planned:
                self.scenario = self.scenario.with_changes([change_of(event)])
                self._folder.write_scenario(self.scenario)

    def close_own_host(self) -> None:
        """Say that the host in this process is done."""
        if self._session:
            self._session.close()

    def close(self) -> None:
        """End what is left of the hosts, and close the part of the one in this process."""
        super().close()
        if self._recorder:
            self._recorder.close()


def _conductor(
    node: SupervisorNode,
    folder: RunFolder,
    plans: Sequence[HostPlan],
    run_id: str,
    remote: RemoteCommands,
    *,
    observe: Observer,
    stopped: Callable[[], str | None],
) -> tuple[Conductor, RunCrew]:
    """Return who brings the run from its beginning to its end, and with whom."""
    scenario, executor = node.scenario, create_executor()
    executor.add_node(node)
    shared_memory.note_segments()
    topics = [topic.name for topic in Graph.of(scenario).recorded]
    part = str((folder.parts / OWN_HOST).absolute())
    own = OwnHost(OWN_HOST, frozenset(), frozenset(topics), part, os.getpid())
    hosts = [(plan.name, plan.nodes, plan.part) for plan in plans]
    belief = Belief.in_run(scenario, hosts, own)
    machine = (
        ClockMachine(scenario, topics, belief, ahead=system_ahead)
        if scenario.clocked
        else RunMachine(scenario, topics, belief)
    )
    crew = RunCrew(scenario, run_id, plans, executor, folder, remote=remote)
    conductor = Conductor(
        node, executor, machine, crew, run_id=run_id, observe=observe, stopped=stopped
    )
    return conductor, crew


def _finish(
    folder: RunFolder,
    scenario: Scenario,
    conductor: Conductor,
    elsewhere: Mapping[str, str],
    progress: Callable[[int, int], None],
) -> Outcome:
    """Write run.json and the bag, with all parts that are not still elsewhere, by host."""
    from cacc_platoon.runs.recording import first_samples, recorded_samples  # noqa: PLC0415  (heavy)

    run = conductor.run
    assert run.end is not None
    recording = {**folder.recording(), **_parts_elsewhere(folder, scenario, run)}
    lacking = {topic for name in elsewhere for topic in run.hosts[name].records}
    topics = [topic.name for topic in Graph.of(scenario).recorded if topic.name not in lacking]
    samples = conductor.samples
    if samples < scenario.samples:
        recording = first_samples(recording, Graph.of(scenario), samples * scenario.step_ns)
    counts = recorded_samples(recording, Graph.of(scenario), samples)
    status, message = conclude(scenario, topics, run.end, counts, samples)
    LOG.info("%s", ": ".join(filter(None, [status, message])))
    info = _measured(conductor, scenario, folder.begun, status, message)
    info = info.without_parts(elsewhere)
    try:
        info = folder.finish(scenario, recording, info, progress)
    except OSError as error:
        why = error.strerror or str(error)
        info = _without_bag(folder, info.without_bag(EndStatus.FAILED, why))
    except _InsistedError:
        info = _without_bag(folder, info.without_bag(EndStatus.INTERRUPTED, "stopped meanwhile"))
    return Outcome(info.status, info.message, info, conductor.leave)


def _without_bag(folder: RunFolder, info: RunInfo) -> RunInfo:
    """Write the run.json of a run whose bag has to wait, in the room that half a bag takes."""
    shutil.rmtree(folder.path / UNFINISHED, ignore_errors=True)
    with contextlib.suppress(OSError):
        info.write(folder.path)
    return info


def _parts_elsewhere(folder: RunFolder, scenario: Scenario, run: Run) -> Recording:
    """Return what hosts recorded outside of the run folder, as far as it is on this machine."""
    states = [host for host in run.hosts.values() if host.part and is_here(scenario, run, host)]
    parts = [Path(host.part) for host in states]
    return read_parts([part for part in parts if folder.parts.absolute() not in part.parents])


def _measured(
    conductor: Conductor, scenario: Scenario, begun: RunInfo, status: EndStatus, message: str
) -> RunInfo:
    """Return how the run ended with its times, progress and hosts, for run.json."""
    run = conductor.run
    began = run.started
    if began is not None and scenario.clocked:
        began = start_by_clocks(scenario, began)
    wall = 0.0 if began is None or run.ended is None else run.ended - began
    return dataclasses.replace(
        begun,
        status=status,
        message=message,
        samples=run.progress + 1,
        wall_time=wall,
        real_time_factor=run.progress * scenario.run.step / wall if wall else None,
        start_time=conductor.start_time,
        hosts=summaries(run),
        clock_offsets=run.offsets,
    )
