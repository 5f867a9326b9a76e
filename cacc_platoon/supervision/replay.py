"""One real node in a process of its own, given what was recorded; its answers are kept.

The process that replays is supervisor, predecessor and relay at once. Its messages reach the
node over DDS only, and it keeps to the horizon as a leader does: it is never more than the lockstep
window ahead of the answers.
"""

from __future__ import annotations

import dataclasses
import multiprocessing
import signal
import sys
import uuid
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection

import numpy as np
from rclpy.node import Node
from std_msgs.msg import Int64

from cacc_platoon.dds import shared_memory
from cacc_platoon.errors import UserError
from cacc_platoon.model import State
from cacc_platoon.nodes import qos
from cacc_platoon.nodes.executor import create_executor
from cacc_platoon.nodes.node import MESSAGE_TYPES
from cacc_platoon.nodes.vehicle import VehicleNode
from cacc_platoon.runs.info import EndStatus
from cacc_platoon.runs.recording import count_of_each_sample
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import NodeKind, NodeName, host_name
from cacc_platoon.supervision.conductor import Conductor, Crew, Observer
from cacc_platoon.supervision.host import NODE_CLASSES, host_signals, serve
from cacc_platoon.supervision.host_session import HostSession
from cacc_platoon.supervision.log import log_to_stderr, logs_to_stderr
from cacc_platoon.supervision.participant import start_ros
from cacc_platoon.supervision.replay_machine import REPLAYED, REPLAYER, ReplayMachine
from cacc_platoon.supervision.supervisor_node import start_supervisor
from msg_adapters.topics import Graph, PlatoonTopics, Topic

Feed = Sequence[tuple[Topic, Sequence[Sequence[bytes]]]]
"""Topics with the messages of each sample."""

Expected = Sequence[tuple[Topic, Sequence[int]]]
"""Topics with the number of their messages up to and including each sample."""


class ReplayFailedError(Exception):
    """The replay cannot go on; the line names the node, its last sample and what was missing."""


@dataclass(frozen=True)
class NodePlan:
    """A node to start, and where a follower begins if not in equilibrium."""

    run: str
    name: str
    node: NodeName
    scenario: Scenario
    initial: State[float] | None = None
    verbose: bool = False


def run_node(plan: NodePlan, lifeline: Connection) -> None:
    """Run the node of a plan as a host of its own; see `run_host`."""
    stop = host_signals()
    if plan.verbose:
        log_to_stderr()
    start_ros([])
    failure = ""
    try:
        node = _make(plan)
    except UserError as error:
        node, failure = _spokesman(plan), str(error)
    session = HostSession(plan.name, [node], plan.scenario, run=plan.run, failure=failure)
    sys.exit(serve([node], session, None, stop, lifeline.poll))


def _make(plan: NodePlan) -> Node:
    if plan.node.kind == NodeKind.VEHICLE:
        return VehicleNode(plan.scenario, plan.node.vehicle, initial=plan.initial, replayed=True)
    return NODE_CLASSES[plan.node.kind](plan.scenario, plan.node.vehicle)


def _spokesman(plan: NodePlan) -> Node:
    """Return a node that is there only to say why the node of the plan cannot be made."""
    namespace = f"{plan.scenario.platoon.namespace}/{host_name(plan.name)}"
    return Node("spokesman", namespace=namespace, use_global_arguments=False)


class Feeder:
    """Gives samples out as far as the horizon of a run allows.

    Parameters
    ----------
    samples : int
        How many there are.
    give : callable
        Called with each sample, in order.

    Attributes
    ----------
    given : int
        How many were given out.

    Examples
    --------
    >>> given = []
    >>> feeder = Feeder(samples=5, give=given.append)
    >>> feeder.take_horizon(1)
    >>> feeder.take_horizon(2)
    >>> given
    [0, 1, 2]
    """

    def __init__(self, samples: int, give: Callable[[int], None]) -> None:
        self._samples, self._give = samples, give
        self.given = 0

    def take_horizon(self, horizon: int) -> None:
        """Give every sample up to and including `horizon`."""
        while self.given < min(horizon + 1, self._samples):
            self._give(self.given)
            self.given += 1


class ReplayerNode(Node):  # type: ignore[misc]
    """Publishes what was recorded, as far as the horizon allows, and keeps the answers.

    Parameters
    ----------
    scenario : Scenario
        The run.
    feed : Feed
        What to publish.
    expected : Expected
        What to listen to.
    samples : int
        How many samples of it.
    """

    def __init__(self, scenario: Scenario, feed: Feed, expected: Expected, samples: int) -> None:
        namespace = scenario.platoon.namespace
        super().__init__("replayer", namespace=namespace, use_global_arguments=False)
        self.scenario = scenario
        self.answers: dict[str, list[bytes]] = {topic.name: [] for topic, _ in expected}
        self._ends = {topic.name: ends for topic, ends in expected}
        self._samples, self._reported = samples, -1
        self._stride = scenario.run.stride
        profile = qos.stream(scenario)
        self._progress = self.create_publisher(
            Int64, PlatoonTopics(namespace).recorded(REPLAYER), qos.latched()
        )
        self._feed = [
            (
                self.create_publisher(MESSAGE_TYPES[topic.kind.type_name], topic.name, profile),
                messages,
            )
            for topic, messages in feed
        ]
        counts = {topics.complete for topics in Graph.of(scenario).counted_links.values()}
        for topic, _ in expected:
            kind = MESSAGE_TYPES[topic.kind.type_name]
            receive = self._receiver(topic, topic in counts)
            self.create_subscription(kind, topic.name, receive, profile, raw=True)
        self._feeder = Feeder(samples, self._publish)
        self.create_subscription(
            Int64, PlatoonTopics(namespace).horizon, self._go_on, qos.latched()
        )

    def _go_on(self, horizon: Int64) -> None:
        self._feeder.take_horizon(horizon.data)
        self._report()

    def _publish(self, sample: int) -> None:
        for publisher, messages in self._feed:
            for message in messages[sample]:
                publisher.publish(message)

    def _receiver(self, topic: Topic, counts: bool) -> Callable[[bytes], None]:
        answers = self.answers[topic.name]
        step_ns, size, samples = self.scenario.step_ns, topic.codec.size, self.scenario.samples

        def receive(data: bytes) -> None:
            if counts and len(data) == size:
                row = np.frombuffer(data, np.uint8)[np.newaxis]
                each = count_of_each_sample(topic, row, step_ns, samples)
                answers.extend(one.tobytes() for one in each)
            else:
                answers.append(data)
            self._report()

        return receive

    def _report(self) -> None:
        """Say up to which sample every answer is here, periodically and at the end.

        No further than that of the last input: by clocks a relay is ahead of what was used of it.
        """
        done = min(bisect_right(ends, len(self.answers[name])) for name, ends in self._ends.items())
        done = min(done, self._feeder.given + 1)
        if done - 1 >= self._reported + self._stride or done == self._samples:
            self._reported = done - 1
            self._progress.publish(Int64(data=done - 1))


def replay_node(
    plan: NodePlan,
    feed: Feed,
    expected: Expected,
    samples: int,
    *,
    observe: Observer = lambda *_: None,
    stopped: Callable[[], str | None] = lambda: None,
) -> Mapping[str, list[bytes]]:
    """Start a node, give it what was recorded and return what it publishes, by topic.

    Parameters
    ----------
    plan : NodePlan
        The node.
    feed, expected, samples
        As in `ReplayerNode`.
    observe : callable, optional
        Called with what is being done, the sample reached and the number of samples.
    stopped : callable, optional
        Returns the name of a signal that asks for the end, or None.

    Raises
    ------
    ReplayFailedError
        When the node does not appear, ends, reports a failure or does not answer.
    """
    shared_memory.sweep()
    multiprocessing.current_process().name = REPLAYER
    supervisor = start_supervisor(plan.scenario)
    replayer = ReplayerNode(plan.scenario, feed, expected, samples)
    executor = create_executor()
    for node in (supervisor, replayer):
        executor.add_node(node)
    shared_memory.note_segments()
    crew = ReplayCrew(plan, replayer)
    machine = ReplayMachine(plan.scenario, plan.node, [*replayer.answers], samples)
    conductor = Conductor(
        supervisor,
        executor,
        machine,
        crew,
        run_id=plan.run,
        observe=lambda _, k, n: observe("replaying", k, n),
        stopped=stopped,
    )
    end = conductor.conduct()
    name = conductor.run.signal
    conductor.leave(128 + signal.Signals[name] if name else 1)
    if end.status is not EndStatus.FINISHED:
        raise ReplayFailedError(end.message)
    ends = {topic.name: counts[-1] for topic, counts in expected}
    return {name: messages[: ends[name]] for name, messages in replayer.answers.items()}


def plan_replay(
    scenario: Scenario, node: str, index: int, initial: State[float] | None = None
) -> NodePlan:
    """Return the plan of a node that is to be replayed."""
    on = dataclasses.replace(scenario.run, stop_on_collision=False)
    scenario = dataclasses.replace(scenario, run=on)
    if node == NodeKind.LEADER:
        scenario = scenario.in_lockstep  # it hears of nobody, so that only a horizon paces it
    run, name = uuid.uuid4().hex, NodeName(NodeKind(node), index)
    return NodePlan(run, REPLAYED, name, scenario, initial, logs_to_stderr())


class ReplayCrew(Crew):
    """The process of the node, and this one as the recorder of its answers.

    Parameters
    ----------
    plan : NodePlan
        The node.
    replayer : ReplayerNode
        Gives it what was recorded, and has its answers.
    """

    def __init__(self, plan: NodePlan, replayer: ReplayerNode) -> None:
        super().__init__()
        self.nodes.append(replayer)
        self._plan = plan
        records = [*replayer.answers]
        self._session = HostSession(
            REPLAYER, [replayer], plan.scenario, records=records, run=plan.run
        )

    def start_hosts(self) -> None:
        """Start the process of the node."""
        self.processes.start([self._plan], run_node)

    def close_own_host(self) -> None:
        """Say that everything was given."""
        self._session.close()

    def poll(self) -> None:
        """Report connections and failures of the host in this process."""
        self._session.poll()
