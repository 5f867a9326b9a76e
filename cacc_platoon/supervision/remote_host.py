"""A host that was started on its own, on this machine or another, and meets a run by its name.

What it runs is what the supervisor's scenario gives to a host of that name.
"""

from __future__ import annotations

import multiprocessing
import os
import select
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

import rclpy
from rclpy.executors import Executor
from rclpy.node import Node
from std_msgs.msg import String

from cacc_platoon.errors import UserError
from cacc_platoon.nodes import qos
from cacc_platoon.nodes.executor import create_executor, spin_for
from cacc_platoon.nodes.recorder import RecorderNode
from cacc_platoon.runs.recorded_leader import with_recorded_leader
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import NodeKind, NodeName, host_name
from cacc_platoon.stop_signal import StopSignal
from cacc_platoon.supervision.host import NODE_CLASSES, POLL_PERIOD, serve
from cacc_platoon.supervision.host_plan import nodes_of
from cacc_platoon.supervision.host_session import HostSession
from cacc_platoon.supervision.log import LOG, log_to_stderr
from cacc_platoon.supervision.meeting import Matchmaker, Met, Wishes, objection, own_host
from cacc_platoon.supervision.part_transfer import PartOffer
from cacc_platoon.supervision.participant import start_ros, taking_part
from msg_adapters.topics import Graph, PlatoonTopics, Topic

FAILED = 1


def run_remote_host(wishes: Wishes, stop: StopSignal) -> int:
    """Wait for a run, take part in it, and return the exit code.

    Raises
    ------
    UserError
        When the run that comes has no such host, or nothing can be recorded.
    """
    multiprocessing.current_process().name = host_name(wishes.name)
    log_to_stderr()
    start_ros([])
    try:
        met = _meet(wishes, stop)
        return _take_part(wishes, met, stop) if met else stop.exit_code or FAILED
    finally:
        rclpy.try_shutdown()


def _meet(wishes: Wishes, stop: StopSignal) -> Met | None:
    """Wait for a run; None when none has come, or a signal."""
    topics = PlatoonTopics(wishes.namespace)
    matchmaker, executor = Matchmaker(topics.scenario), create_executor()
    with taking_part():
        node = Node(
            "waiting",
            namespace=f"{wishes.namespace}/{host_name(wishes.name)}",
            use_global_arguments=False,
            start_parameter_services=False,
        )
    node.create_subscription(
        String, topics.scenario, lambda m: matchmaker.take_scenario(m.data), qos.latched()
    )
    node.create_subscription(
        String, topics.status, lambda m: matchmaker.take_status(m.data), qos.latched()
    )
    executor.add_node(node)
    LOG.info("waits for a supervisor of %s", wishes.namespace)
    deadline, orphaned = time.monotonic() + wishes.timeout, _orphaned(wishes)
    try:
        while not (met := matchmaker.met()):
            spin_for(executor, POLL_PERIOD)
            if stop.received() or orphaned():
                return None
            if time.monotonic() > deadline:
                LOG.info("no supervisor of %s has come for %g s", wishes.namespace, wishes.timeout)
                return None
        return met
    finally:
        executor.shutdown()
        node.destroy_node()


def _orphaned(wishes: Wishes) -> Callable[[], bool]:
    """Return what says whether whoever has started this host is gone."""
    if not wishes.attached:
        return lambda: False

    def gone() -> bool:
        readable, _, _ = select.select([sys.stdin], [], [], 0.0)
        return bool(readable) and not os.read(sys.stdin.fileno(), 4096)

    return gone


def _take_part(wishes: Wishes, met: Met, stop: StopSignal) -> int:
    scenario, run = met.scenario, met.run
    host = own_host(wishes, scenario)
    failure = objection(wishes, host, scenario)
    nodes_due = nodes_of(scenario, host)
    topics = [topic for node in nodes_due for topic in Graph.of(scenario).recorded_with(node)]
    with taking_part():
        recorder = _recorder(wishes, met, topics)
        nodes: list[Node] = [recorder]
        try:
            nodes += [] if failure else _nodes(scenario, nodes_due)
        except UserError as error:
            failure = str(error)
    offer = PartOffer(recorder, PlatoonTopics(wishes.namespace), wishes.name)
    session = HostSession(
        wishes.name,
        nodes,
        scenario,
        records=recorder.recorded,
        part=str(recorder.folder),
        run=run,
        failure=failure,
    )

    def give(executor: Executor) -> None:
        given = offer.give(executor, recorder.folder, recorder.recorded, stop.received)
        if given:
            LOG.info("the supervisor has what was recorded")
        if given and wishes.parts is None:
            shutil.rmtree(recorder.folder.parent, ignore_errors=True)

    code = serve(nodes, session, recorder, stop, _orphaned(wishes), give=give)
    if recorder.folder.exists():
        LOG.info("what was recorded is in %s", recorder.folder)
    return code


def _recorder(wishes: Wishes, met: Met, topics: list[Topic]) -> RecorderNode:
    """Return the recorder, in a folder that is its own as long as nobody names another."""
    when = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
    folder = Path("runs") / f"{met.scenario.name}-{when}-{wishes.name}"
    path = (wishes.parts or folder) / host_name(wishes.name)
    try:
        return RecorderNode(met.scenario, wishes.name, topics, path, run=met.run)
    except FileExistsError as error:
        raise UserError(
            f"{path}: exists already, a host never overwrites what it has recorded. Remove it or "
            "give another folder with --part."
        ) from error
    except OSError as error:
        raise UserError(
            f"{path}: cannot be written ({error.strerror}). Give another folder with --part."
        ) from error


def _nodes(scenario: Scenario, names: Sequence[NodeName]) -> Iterator[Node]:
    if names[0].kind is NodeKind.LEADER:
        scenario = with_recorded_leader(scenario)
    for kind, index in names:
        yield NODE_CLASSES[kind](scenario, index)
