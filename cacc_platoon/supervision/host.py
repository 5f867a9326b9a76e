"""A host: one process with an executor, some nodes, and a recorder of what they publish."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterable
from multiprocessing.connection import Connection

import rclpy
from rclpy.executors import Executor
from rclpy.node import Node

from cacc_platoon.dds import shared_memory
from cacc_platoon.errors import UserError
from cacc_platoon.nodes.executor import create_executor, spin_for
from cacc_platoon.nodes.leader import LeaderNode
from cacc_platoon.nodes.node import PlatoonNode
from cacc_platoon.nodes.noise_relay import NoiseRelayNode
from cacc_platoon.nodes.recorder import RecorderNode
from cacc_platoon.nodes.vehicle import VehicleNode
from cacc_platoon.runs.journal import Journal
from cacc_platoon.runs.past import Past
from cacc_platoon.scenario.names import NodeKind
from cacc_platoon.stop_signal import STOP_SIGNALS, StopSignal
from cacc_platoon.supervision.host_plan import HostPlan
from cacc_platoon.supervision.host_session import HostSession
from cacc_platoon.supervision.log import LOG, log_to_stderr, logging_to
from cacc_platoon.supervision.participant import start_ros, taking_part
from cacc_platoon.time_limit import time_limit
from msg_adapters.topics import Graph, queue_depth

NODE_CLASSES: dict[NodeKind, type[LeaderNode | VehicleNode | NoiseRelayNode]] = {
    NodeKind.LEADER: LeaderNode,
    NodeKind.VEHICLE: VehicleNode,
    NodeKind.NOISE_RELAY: NoiseRelayNode,
}
POLL_PERIOD = 0.05
FLUSH_PERIOD = 0.5
DDS_LIMIT = 10.0
"""How long the nodes of a host may take to end [s]."""


def run_host(plan: HostPlan, lifeline: Connection) -> None:
    """Run a host in a process of its own until the supervisor ends the run or is gone.

    Parameters
    ----------
    plan : HostPlan
        What to run.
    lifeline : Connection
        Reading end of a pipe whose other end the supervisor holds: it closes when that dies.
    """
    stop = host_signals()
    if plan.verbose:
        log_to_stderr()
    with logging_to(plan.log):
        start_ros([])
        graph = Graph.of(plan.scenario)
        topics = [topic for node in plan.nodes for topic in graph.recorded_with(node)]
        failure = ""
        with taking_part():
            restarts = plan.scenario.run.restarts > 0
            recorder = RecorderNode(plan.scenario, plan.name, topics, plan.part, told=restarts)
            journal = _journal(plan, recorder) if restarts else None
            nodes: list[Node] = [recorder]
            try:
                for kind, index in plan.nodes:
                    nodes.append(NODE_CLASSES[kind](plan.scenario, index, journal=journal))
            except UserError as error:  # own code may fail here and nowhere before
                failure = str(error)
        if journal:
            _resume(journal, nodes)
        session = HostSession(
            plan.name,
            nodes,
            plan.scenario,
            records=recorder.recorded,
            part=str(recorder.folder),
            run=plan.run,
            failure=failure,
            journal=journal,
        )
        sys.exit(serve(nodes, session, recorder, stop, lifeline.poll))


def _journal(plan: HostPlan, recorder: RecorderNode) -> Journal:
    """Return the journal of a host that may be started again, or was."""
    past = Past(plan.ended, plan.part.parent) if plan.ended else None
    scenario = plan.scenario
    return Journal(recorder.receivers, scenario.step_ns, queue_depth(scenario), past)


def _resume(journal: Journal, nodes: Iterable[Node]) -> None:
    """Let nodes work through what was recorded before; what happened then was told already."""
    journal.resume()
    for node in nodes:
        if isinstance(node, PlatoonNode):
            node.events.clear()


def host_signals() -> StopSignal:
    """From now on SIGTERM ends this host cleanly; what a terminal sends is for the supervisor."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    stop = StopSignal(signal.SIGTERM)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOP_SIGNALS)
    return stop


def serve(
    nodes: Iterable[Node],
    session: HostSession,
    recorder: RecorderNode | None,
    stop: StopSignal,
    orphaned: Callable[[], bool] = lambda: False,
    *,
    give: Callable[[Executor], None] = lambda executor: None,
) -> int:
    """Spin the nodes of a host until the run has ended; close the part; return the exit code.

    Once the run has ended and the part is closed, `give` may hand it over, spinning the nodes.
    """
    nodes = list(nodes)
    executor = create_executor()
    for node in nodes:
        executor.add_node(node)
    shared_memory.note_segments()
    try:
        _spin(executor, session, recorder, stop, orphaned)
    finally:
        if recorder:
            recorder.close()
    session.close()
    if session.ended:
        give(executor)
    exit_code = 0 if session.finished else stop.exit_code or 1
    with time_limit(DDS_LIMIT, exit_code), shared_memory.cleared_segments():
        executor.shutdown()
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
    shared_memory.sweep()
    return exit_code


def _spin(
    executor: Executor,
    session: HostSession,
    recorder: RecorderNode | None,
    stop: StopSignal,
    orphaned: Callable[[], bool],
) -> None:
    flushed = time.monotonic()
    while not session.ended:
        spin_for(executor, POLL_PERIOD)
        session.poll()
        if recorder:
            recorder.end_at(session.samples)
        if time.monotonic() - flushed > FLUSH_PERIOD:
            flushed = time.monotonic()
            shared_memory.note_segments()
            if recorder:
                recorder.flush()
        if (name := stop.received()) and not session.ended:
            session.fail(f"{session} was stopped by {name}")
            return
        if orphaned() or session.abandoned:
            LOG.info("host %s: the supervisor is gone", session.host)
            return
        if session.unmet:
            LOG.info("host %s: %s", session.host, session.unmet)
            return
