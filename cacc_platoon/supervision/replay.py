"""One real node in a process of its own, given what was recorded; what it publishes is heard.

The process that replays is supervisor, predecessor and relay at once. It speaks to the node over
DDS only and is never more than the lockstep window ahead of its answers.
"""

from __future__ import annotations

import signal
import sys
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Int64

from cacc_platoon.dds import shared_memory
from cacc_platoon.model import State
from cacc_platoon.nodes import qos
from cacc_platoon.nodes.executor import create_executor, spin_for
from cacc_platoon.nodes.node import MESSAGE_TYPES
from cacc_platoon.nodes.vehicle import VehicleNode
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import NodeKind, NodeName
from cacc_platoon.stop_signal import StopSignal
from cacc_platoon.supervision.conductor import ADVICE, GOODBYE_TIMEOUT, TICK, RunFailedError
from cacc_platoon.supervision.host import NODE_CLASSES, serve
from cacc_platoon.supervision.host_session import FAILED, FINISHED, HostSession
from cacc_platoon.supervision.launcher import HostProcesses
from cacc_platoon.supervision.supervisor_node import SupervisorNode
from msg_adapters.topics import Topic, VehicleTopics

Feed = Sequence[tuple[Topic, Sequence[bytes | None]]]
"""Topics with a message per sample, None where there is none."""

Observer = Callable[[str, int, int], None]


@dataclass(frozen=True)
class NodePlan:
    """A node to start, and where a follower begins if not in equilibrium."""

    run: str
    name: str
    node: NodeName
    scenario: Scenario
    initial: State[float] | None = None


def run_node(plan: NodePlan, lifeline: Connection) -> None:
    """Run the node of a plan as a host of its own; see `run_host`."""
    stop = StopSignal(signal.SIGTERM)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node: Node
    if plan.node.kind == NodeKind.VEHICLE:
        node = VehicleNode(plan.scenario, plan.node.vehicle, initial=plan.initial)
    else:
        node = NODE_CLASSES[plan.node.kind](plan.scenario, plan.node.vehicle)
    session = HostSession(plan.name, [node], plan.scenario, run=plan.run)
    sys.exit(serve([node], session, None, stop, lifeline.poll))


class Feeder:
    """Gives samples out, never more than a window ahead of their answers.

    Parameters
    ----------
    samples, window : int
        How many there are, and how many may be without an answer.
    give : callable
        Called with each sample, in order.

    Examples
    --------
    >>> given = []
    >>> feeder = Feeder(samples=5, window=2, give=given.append)
    >>> feeder.advance(done=0)
    >>> feeder.advance(done=1)
    >>> given
    [0, 1, 2]
    """

    def __init__(self, samples: int, window: int, give: Callable[[int], None]) -> None:
        self._samples, self._window, self._give = samples, window, give
        self._given = 0

    def advance(self, done: int) -> None:
        """Give what may be given when `done` samples are answered."""
        limit = min(done + self._window, self._samples)
        while self._given < limit:
            self._give(self._given)
            self._given += 1


class ReplayerNode(Node):  # type: ignore[misc]
    """Publishes what was recorded, as far as the window allows, and keeps the answers.

    Parameters
    ----------
    scenario : Scenario
        The run.
    index : int
        The vehicle whose node is replayed.
    feed : Feed
        What to publish.
    outputs : sequence of Topic
        What to listen to.
    samples : int
        How many samples of it.
    """

    def __init__(
        self, scenario: Scenario, index: int, feed: Feed, outputs: Sequence[Topic], samples: int
    ) -> None:
        namespace = scenario.platoon.namespace
        super().__init__("replayer", namespace=namespace, use_global_arguments=False)
        self.answers: dict[str, list[bytes]] = {topic.name: [] for topic in outputs}
        self.samples = samples
        self._feeder = Feeder(samples, scenario.run.window, self._publish)
        self._step_ns = scenario.step_ns
        profile = qos.stream(scenario)
        own = VehicleTopics(namespace, index)
        self._lost = self.create_publisher(Int64, own.complete.name, profile)
        self._feed = [
            (
                self.create_publisher(MESSAGE_TYPES[topic.kind.type_name], topic.name, profile),
                messages,
                topic == own.received,
            )
            for topic, messages in feed
        ]
        for topic in outputs:
            kind = MESSAGE_TYPES[topic.kind.type_name]
            receive = self._receiver(self.answers[topic.name])
            self.create_subscription(kind, topic.name, receive, profile, raw=True)

    @property
    def done(self) -> int:
        """For so many samples every answer is here."""
        return min(len(messages) for messages in self.answers.values())

    def advance(self) -> None:
        """Publish the samples that the window allows."""
        self._feeder.advance(self.done)

    def _publish(self, sample: int) -> None:
        for publisher, messages, lossy in self._feed:
            message = messages[sample]
            if message is not None:
                publisher.publish(message)
            elif lossy:
                self._lost.publish(Int64(data=sample * self._step_ns))

    def _receiver(self, answers: list[bytes]) -> Callable[[bytes], None]:
        def receive(data: bytes) -> None:
            answers.append(data)
            self.advance()

        return receive


def replay_node(
    plan: NodePlan,
    feed: Feed,
    outputs: Sequence[Topic],
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
    feed, outputs, samples
        As in `ReplayerNode`.
    observe : callable, optional
        Called with what is being done, the sample reached and the number of samples.
    stopped : callable, optional
        Returns the name of a signal that asks for the end, or None.

    Raises
    ------
    RunFailedError
        When the node does not appear, ends, reports a failure or does not answer.
    """
    shared_memory.sweep()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    replayer = ReplayerNode(plan.scenario, plan.node.vehicle, feed, outputs, samples)
    replay = _Replay(plan, replayer, observe, stopped)
    state = FAILED
    try:
        replay.conduct()
        state = FINISHED
    finally:
        replay.end(state)
    return {name: messages[:samples] for name, messages in replayer.answers.items()}


def plan_replay(
    scenario: Scenario, node: str, index: int, initial: State[float] | None = None
) -> NodePlan:
    """Return the plan of a node that is to be replayed."""
    return NodePlan(
        uuid.uuid4().hex, "replayed", NodeName(NodeKind(node), index), scenario, initial
    )


class _Replay:
    """The steps of a replay: barrier, feeding, end."""

    def __init__(
        self,
        plan: NodePlan,
        replayer: ReplayerNode,
        observe: Observer,
        stopped: Callable[[], str | None],
    ) -> None:
        self._plan, self._replayer = plan, replayer
        self._observe, self._stopped = observe, stopped
        self._supervisor = SupervisorNode(plan.scenario, plan.run)
        self._session = HostSession("replayer", [replayer], plan.scenario, run=plan.run)
        self._executor = create_executor()
        for node in (self._supervisor, replayer):
            self._executor.add_node(node)
        self._processes = HostProcesses()
        shared_memory.note_segments()

    def conduct(self) -> None:
        """Start the node and bring it to its last sample."""
        supervisor, run = self._supervisor, self._plan.scenario.run
        self._processes.start([self._plan], run_node)
        hosts = {self._plan.name, self._session.host}
        self._wait(lambda: hosts <= supervisor.hosts.keys(), run.start_timeout, "has not appeared")
        supervisor.begin_matching()
        self._wait(lambda: not supervisor.unmatched(), run.start_timeout, "is not connected")
        if foreign := supervisor.foreign_publishers():
            raise RunFailedError(f"{foreign[0]}. {ADVICE}")
        supervisor.begin_running()
        self._replayer.advance()
        while (done := self._replayer.done) < self._replayer.samples:
            self._wait(
                lambda done=done: self._replayer.done > done,  # type: ignore[misc]
                run.stall_timeout,
                f"gave no answer to sample {done} and has stopped, or what it was given has",
            )

    def end(self, state: str) -> None:
        """End the node and its process in good order."""
        ended = {one.name for one in self._processes.ended()}
        self._supervisor.end(state, "")
        self._session.close()
        deadline = time.monotonic() + GOODBYE_TIMEOUT
        heard = self._supervisor.hosts
        while time.monotonic() < deadline and not ended:
            if heard.get(self._plan.name, {"state": ""})["state"] == "closed":
                break
            self._spin()
        self._processes.stop()
        with shared_memory.cleared_segments():
            self._executor.shutdown()
            self._replayer.destroy_node()
            self._supervisor.destroy_node()
            rclpy.try_shutdown()
        shared_memory.sweep()

    def _wait(self, done: Callable[[], bool], limit: float, failure: str) -> None:
        began = time.monotonic()
        who = str(self._plan.node)
        while not done():
            self._spin()
            if name := self._stopped():
                raise RunFailedError(f"stopped by {name}")
            if failures := self._supervisor.failures():
                raise RunFailedError(failures[0])
            for ended in self._processes.ended():
                raise RunFailedError(f"{who} (process {ended.pid}) {ended.how}")
            if time.monotonic() - began > limit:
                missing = "; ".join(self._supervisor.unmatched())
                raise RunFailedError(f"{who} {failure} for {limit:g} s {missing}".rstrip())

    def _spin(self) -> None:
        spin_for(self._executor, TICK)
        self._supervisor.poll()
        self._session.poll()
        self._supervisor.advance(self._replayer.done - 1)
        self._observe("replaying", self._replayer.done, self._replayer.samples)
