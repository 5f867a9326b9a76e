"""The supervisor's node: its topics, and what can be seen of the platoon in the graph."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace

import rclpy
from builtin_interfaces.msg import Time
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSProfile,
    qos_check_compatible,
)
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import Int64, String

from cacc_platoon.dds import shared_memory
from cacc_platoon.dds.platoon_lock import PlatoonLock
from cacc_platoon.errors import UserError
from cacc_platoon.nodes import qos, ros_parameters
from cacc_platoon.runs.events import event_line
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario
from cacc_platoon.scenario.run_event import RunEvent
from cacc_platoon.scenario.table import GROUPS
from cacc_platoon.supervision.belief import refusal
from cacc_platoon.supervision.participant import start_ros, taking_part
from cacc_platoon.supervision.pause_services import STEP_SAMPLES, Heeded, offer_services
from cacc_platoon.supervision.pausing import Asked
from cacc_platoon.supervision.protocol import HostState, ProtocolError, RunStatus, text_digest
from cacc_platoon.supervision.run_events import (
    Event,
    GraphObserved,
    HostReported,
    Recorded,
    RivalHeard,
)
from cacc_platoon.supervision.run_state import some
from msg_adapters.topics import Graph

CLOCK = "/clock"
MANY = 1000
"""Hosts, and events, that there is room for."""
UNKNOWN = "_NODE_NAME_UNKNOWN_"
NAMELESS_LIMIT = 10.0
"""How long the graph may take to tell the node of a publisher that it shows [s]."""
REMEMBERED = 100
"""Statuses that this node knows for its own when they come back."""


class SupervisorNode(Node):  # type: ignore[misc]
    """Publishes horizon, status and scenario; turns what hosts say into events.

    It has no topic, and so stands in nobody's way, before it is announced.

    Parameters
    ----------
    scenario : Scenario
        What is run.

    Attributes
    ----------
    feed : callable
        Called with each event.
    ask : callable
        Called with what a user asks for; returns what came of it.
    lock : PlatoonLock
        Holds the platoon's name among the processes of this user on this machine.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._prefix = scenario.platoon.namespace
        super().__init__("supervisor", namespace=self._prefix, use_global_arguments=False)
        ros_parameters.declare(self, scenario, {}, tuple(GROUPS), STEP_SAMPLES)
        self.scenario = scenario
        self.feed: Callable[[Event], None] = lambda event: None
        self.ask: Callable[[Asked], Heeded] = lambda asked: Heeded(False, "nothing runs here")
        self.graph = Graph.of(scenario)
        self.topics = self.graph.platoon
        self._types = {topic.name: topic.kind.type_name for topic in self.graph.recorded}
        self.lock = PlatoonLock(self._prefix, os.environ)
        self._sent: deque[str] = deque(maxlen=REMEMBERED)
        self._nameless: dict[bytes, float] = {}

    def announce(self) -> None:
        """Take the names of the platoon: from now on everybody sees that it is there."""
        latched = qos.latched()
        self._horizon = self.create_publisher(Int64, self.topics.horizon, latched)
        self._status = self.create_publisher(String, self.topics.status, latched)
        self._scenario_publisher = self.create_publisher(String, self.topics.scenario, latched)
        text = format_scenario(self.scenario)
        self._view_request = self.create_publisher(Int64, self.topics.view_request, qos.glimpse())
        self._scenario_digest = text_digest(text)
        self._scenario_publisher.publish(String(data=text))
        self._events = self.create_publisher(String, self.topics.events, qos.latched(MANY))
        self.create_subscription(String, self.topics.status, self._on_status, latched)
        many = qos.latched(MANY)
        self.create_subscription(String, self.topics.host_state, self._on_host_state, many)
        if self.shows_time:
            self._time = self.create_publisher(ClockMessage, CLOCK, 10)
        offer_services(self, self.topics, self.ask)

    def publish_status(self, status: RunStatus) -> None:
        """Tell everybody how far the run is."""
        text = replace(status, scenario=self._scenario_digest).to_json()
        self._sent.append(text)
        self._status.publish(String(data=text))

    def publish_event(self, event: RunEvent) -> None:
        """Tell everybody what happened."""
        self._events.publish(String(data=event_line(event, self.scenario.run.step)))

    @property
    def shows_time(self) -> bool:
        """Whether the simulated time is published on /clock."""
        return self.scenario.run.clock

    def publish_clock(self, nanoseconds: int) -> None:
        """Tell everybody who uses it the simulated time [ns]."""
        seconds, rest = divmod(nanoseconds, 10**9)
        self._time.publish(ClockMessage(clock=Time(sec=seconds, nanosec=rest)))

    def publish_horizon(self, sample: int) -> None:
        """Let the leader go as far as a sample."""
        self._horizon.publish(Int64(data=sample))

    def ask_for_view(self, sample: int) -> None:
        """Ask all hosts what their vehicles did at a sample, if anybody wants to see it."""
        if self.count_subscribers(self.topics.view):
            self._view_request.publish(Int64(data=sample))

    def follow_recorder(self, host: str) -> None:
        """Listen to the progress of a host's recorder."""
        topic = self.topics.recorded(host)
        if topic in {one.topic_name for one in self.subscriptions}:
            return  # that of a host that was started again
        self.create_subscription(
            Int64,
            topic,
            lambda message: self.feed(Recorded(host, message.data)),
            qos.latched(),
        )

    def connected_recorders(self, hosts: Iterable[str]) -> frozenset[str]:
        """Return the hosts, of those that are followed, whose progress arrives."""
        counts = {
            subscription.topic_name: subscription.get_publisher_count()
            for subscription in self.subscriptions
        }
        return frozenset(host for host in hosts if counts.get(self.topics.recorded(host)))

    def look(
        self,
        allowed: Mapping[str, frozenset[str]],
        processes: Collection[int] = (),
        gone: Collection[int] = (),
    ) -> GraphObserved:
        """Return which publishers there are beyond those allowed, by full name of their node.

        Parameters
        ----------
        allowed : mapping of str to frozenset of str
            The nodes that may publish each topic, one publisher each.
        processes : collection of int
            The processes of the run's hosts.
        gone : collection of int
            Those that have ended; DDS shows what they published for some time.
        """
        foreign, harmless = [], []
        if holder := self.lock.taken_by():
            foreign.append(f"{self._prefix} is a platoon in this domain already: {holder}")
        publishers = {topic: self.get_publishers_info_by_topic(topic) for topic in sorted(allowed)}
        ours = frozenset(
            _participant(info)
            for topic, infos in publishers.items()
            for info in infos
            if _name(info) in allowed[topic]
        )
        machines = {participant[:4] for participant in ours}
        if gone:
            dead = {(one, pid & 0xFFFF) for one in machines for pid in gone}
            publishers = {
                topic: [info for info in infos if _machine_and_process(info) not in dead]
                for topic, infos in publishers.items()
            }
        started = {(one, pid & 0xFFFF) for one in machines for pid in processes}
        nameless = [
            info
            for infos in publishers.values()
            for info in infos
            if _is_nameless(info, ours) and _machine_and_process(info) not in started
        ]
        strangers = self._stay_nameless(nameless)
        for topic, infos in publishers.items():
            deaf: list[TopicEndpointInfo] = []
            heard: list[TopicEndpointInfo] = []
            for info in infos:
                mute = _name(info) not in allowed[topic] and not self._can_be_heard(info, topic)
                (deaf if mute else heard).append(info)
            if _with_foreign(heard, allowed[topic], strangers):
                foreign.append(f"{topic} {_published_by(heard, allowed[topic])}")
            harmless += [f"{topic}: {_name(info)} publishes {_unheard(info)}" for info in deaf]
        return GraphObserved(tuple(foreign), tuple(harmless), not nameless)

    def _stay_nameless(self, infos: Iterable[TopicEndpointInfo]) -> frozenset[bytes]:
        """Return the publishers whose node the graph has not told for long, as of one without."""
        now = time.monotonic()
        gids = [bytes(info.endpoint_gid) for info in infos]
        self._nameless = {gid: self._nameless.get(gid, now) for gid in gids}
        return frozenset(gid for gid in gids if now - self._nameless[gid] > NAMELESS_LIMIT)

    def _can_be_heard(self, info: TopicEndpointInfo, topic: str) -> bool:
        """Whether a publisher has the type of a topic and a QoS that its subscribers take."""
        kind = self._types.get(topic)
        profile = qos.stream(self.scenario) if kind else qos.latched()
        numbers = topic.endswith("/recorded") or topic == self.topics.horizon
        wanted = kind or ("std_msgs/msg/Int64" if numbers else "std_msgs/msg/String")
        compatible, _ = qos_check_compatible(info.qos_profile, profile)
        return bool(info.topic_type == wanted and compatible != QoSCompatibility.ERROR)

    def outside_subscribers(self, nodes: Collection[str]) -> dict[str, int]:
        """Return how many subscribers each data topic has besides some nodes of the platoon.

        Only those who would miss what was published before they are connected count.
        """
        own = {f"{self._prefix}/{node}" for node in nodes}
        return {
            topic.name: sum(
                _name(info) not in own
                and info.node_name != UNKNOWN
                and info.qos_profile.durability == DurabilityPolicy.VOLATILE
                for info in self.get_subscriptions_info_by_topic(topic.name)
            )
            for topic in self.graph.run_topics
        }

    def _on_host_state(self, message: String) -> None:
        returned = time.time_ns()
        try:
            event: Event = HostReported(HostState.from_json(message.data), returned)
        except ProtocolError as error:
            event = refusal(self.topics.host_state, error)
        self.feed(event)

    def _on_status(self, message: String) -> None:
        """Listen for supervisors of the same name; one's own words come back, too."""
        if message.data in self._sent:
            return
        try:
            status = RunStatus.from_json(message.data)
        except ProtocolError as error:
            self.feed(refusal(self.topics.status, error))
        else:
            self.feed(RivalHeard(status.run, status.phase))


def _with_foreign(
    infos: Sequence[TopicEndpointInfo], allowed: frozenset[str], strangers: Collection[bytes]
) -> bool:
    """Whether publishers are more than one of each node that is allowed."""
    known = [_name(info) for info in infos if info.node_name != UNKNOWN]
    strange = len({*known} & allowed) < len(known) or 0 < len(allowed) < len(infos)
    return strange or any(bytes(info.endpoint_gid) in strangers for info in infos)


def _participant(info: TopicEndpointInfo) -> bytes:
    """Return which participant of DDS, a process of ours or another one, an endpoint is of."""
    return bytes(info.endpoint_gid)[:12]


def _machine_and_process(info: TopicEndpointInfo) -> tuple[bytes, int]:
    """Return where Fast DDS says that an endpoint is: vendor and machine, the end of its number.

    On a busy machine the graph may be late, for many seconds, with all nodes of a process.
    """
    participant = _participant(info)
    return participant[:4], int.from_bytes(participant[4:6], "little")


def _is_nameless(info: TopicEndpointInfo, ours: Collection[bytes]) -> bool:
    """Whether nothing tells the node of a publisher: neither its name nor others of its process.

    On a busy machine the graph may be late, for many seconds, with the last nodes of a process.
    """
    return bool(info.node_name == UNKNOWN) and _participant(info) not in ours


def _name(info: TopicEndpointInfo) -> str:
    """Return the full name of the node that an endpoint belongs to."""
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def _published_by(infos: Sequence[TopicEndpointInfo], allowed: frozenset[str]) -> str:
    """Say who publishes a topic, those first who may not."""
    names = sorted(map(_name, infos), key=lambda name: (name in allowed, name))
    return (
        f"has {len(names)} publishers: {some(names)}"
        if names[1:]
        else f"is published by {names[0]}"
    )


def _unheard(info: TopicEndpointInfo) -> str:
    profile: QoSProfile = info.qos_profile
    quality = f"{profile.reliability.name} {profile.durability.name}".lower()
    return f"{info.topic_type} ({quality}) there, which no node of this platoon can receive"


def start_supervisor(scenario: Scenario) -> SupervisorNode:
    """Start rclpy and the supervisor's node.

    Raises
    ------
    UserError
        When that cannot be.
    """
    try:
        start_ros([])
        with taking_part():
            return SupervisorNode(scenario)
    except (RuntimeError, ValueError, NameValidationException, ParameterException) as error:
        rclpy.try_shutdown()
        raise UserError(
            f"ROS does not start: {' '.join(str(error).split())}. Look at ROS_DOMAIN_ID and at "
            "platoon doctor."
        ) from error


def end_supervisor(node: SupervisorNode) -> None:
    """End the supervisor's node and rclpy."""
    with shared_memory.cleared_segments():
        node.destroy_node()
        rclpy.try_shutdown()
    node.lock.drop()
