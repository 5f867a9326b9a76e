"""The supervisor's node: its topics, and what can be seen of the platoon in the graph."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Int64, String

from cacc_platoon.dds import shared_memory
from cacc_platoon.errors import UserError
from cacc_platoon.nodes import qos, ros_parameters
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario
from cacc_platoon.scenario.table import GROUPS
from cacc_platoon.supervision.protocol import HostState, ProtocolError, RunStatus
from cacc_platoon.supervision.run_events import Event, HostReported, Recorded
from cacc_platoon.supervision.run_machine import refusal
from msg_adapters.topics import Graph

MAX_HOSTS = 1000
UNKNOWN = "_NODE_NAME_UNKNOWN_"


class SupervisorNode(Node):  # type: ignore[misc]
    """Publishes horizon, status and scenario; turns what hosts say into events.

    Parameters
    ----------
    scenario : Scenario
        What is run.

    Attributes
    ----------
    feed : callable
        Called with each event.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._prefix = scenario.platoon.namespace
        super().__init__("supervisor", namespace=self._prefix, use_global_arguments=False)
        ros_parameters.declare(self, scenario, {}, tuple(GROUPS))
        self.scenario = scenario
        self.feed: Callable[[Event], None] = lambda event: None
        self.graph = Graph.of(scenario)
        self.topics = self.graph.platoon
        latched = qos.latched()
        self._horizon = self.create_publisher(Int64, self.topics.horizon, latched)
        self._status = self.create_publisher(String, self.topics.status, latched)
        self._scenario_publisher = self.create_publisher(String, self.topics.scenario, latched)
        self._scenario_publisher.publish(String(data=format_scenario(scenario)))
        profile = qos.latched()
        profile.depth = MAX_HOSTS
        self.create_subscription(String, self.topics.host_state, self._on_host_state, profile)

    def publish_status(self, status: RunStatus) -> None:
        """Tell everybody how far the run is."""
        self._status.publish(String(data=status.to_json()))

    def publish_horizon(self, sample: int) -> None:
        """Let the leader go as far as a sample."""
        self._horizon.publish(Int64(data=sample))

    def follow_recorder(self, host: str) -> None:
        """Listen to the progress of a host's recorder."""
        self.create_subscription(
            Int64,
            self.topics.recorded(host),
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

    def foreign_publishers(self, recorders: Iterable[str]) -> tuple[str, ...]:
        """Return a line for each topic with a foreign publisher, with who it is."""
        own = {topic.name for topic in self.graph.run_topics}
        own |= {self.topics.horizon, self.topics.status}
        own |= {self.topics.recorded(host) for host in recorders}
        found = []
        for topic in sorted(own):
            publishers = self.get_publishers_info_by_topic(topic)
            if len(publishers) > 1:
                names = sorted(
                    f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in publishers
                )
                found.append(f"{topic} has {len(names)} publishers: {', '.join(names)}")
        return tuple(found)

    def outside_subscribers(self, nodes: Collection[str]) -> dict[str, int]:
        """Return how many subscribers each data topic has besides some nodes of the platoon.

        Only those who would miss what was published before they are connected count.
        """
        own = {f"{self._prefix}/{node}" for node in nodes}
        return {
            topic.name: sum(
                f"{info.node_namespace.rstrip('/')}/{info.node_name}" not in own
                and info.node_name != UNKNOWN
                and info.qos_profile.durability == DurabilityPolicy.VOLATILE
                for info in self.get_subscriptions_info_by_topic(topic.name)
            )
            for topic in self.graph.run_topics
        }

    def _on_host_state(self, message: String) -> None:
        try:
            event: Event = HostReported(HostState.from_json(message.data))
        except ProtocolError as error:
            event = refusal(self.topics.host_state, error)
        self.feed(event)


def start_supervisor(scenario: Scenario) -> SupervisorNode:
    """Start rclpy and the supervisor's node.

    Raises
    ------
    UserError
        When that cannot be.
    """
    shared_memory.note_start()
    try:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
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
