"""Draws a platoon for RViz: a box and a number for each vehicle, live or from a played bag."""

from __future__ import annotations

import math
from collections.abc import Callable

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from cacc_platoon.errors import one_line
from cacc_platoon.nodes.ros_parameters import scenario_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import vehicle_name
from msg_adapters.topics import PlatoonTopics, VehicleTopics

PERIOD = 0.05
LENGTH, WIDTH, HEIGHT = 4.5, 1.8, 1.5
LEADER_COLOUR = ColorRGBA(r=0.84, g=0.37, b=0.0, a=1.0)
FOLLOWER_COLOUR = ColorRGBA(r=0.0, g=0.45, b=0.70, a=1.0)


class MarkerNode(Node):  # type: ignore[misc]
    """Publishes <prefix>/markers twenty times a second from the newest pose of each vehicle."""

    def __init__(self, scenario: Scenario | None = None) -> None:
        if scenario is None:
            super().__init__("markers", automatically_declare_parameters_from_overrides=True)
            scenario = scenario_of(self)
        else:
            prefix = scenario.platoon.namespace
            super().__init__("markers", namespace=prefix, use_global_arguments=False)
        self._positions: dict[int, float] = {}
        self._refused: set[int] = set()
        self._leader = scenario.leader_index
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        for index in scenario.vehicles:
            topic = VehicleTopics(scenario.platoon.namespace, index).pose
            receive = self._receiver(index, topic.codec.decode)
            self.create_subscription(PoseStamped, topic.name, receive, newest, raw=True)
        markers = PlatoonTopics(scenario.platoon.namespace).markers
        self._publisher = self.create_publisher(MarkerArray, markers, 5)
        self.create_timer(PERIOD, self._draw)

    def _receiver(
        self, index: int, decode: Callable[[bytes], tuple[int, float]]
    ) -> Callable[[bytes], None]:
        def receive(data: bytes) -> None:
            try:
                _, position = decode(data)
            except ValueError as error:
                self._leave_out(index, str(error))
                return
            if math.isfinite(position):
                self._positions[index] = position
            else:
                self._leave_out(index, f"its position is {position}")

        return receive

    def _leave_out(self, index: int, why: str) -> None:
        """Say once for each vehicle that a pose of it cannot be drawn."""
        if index not in self._refused:
            self._refused.add(index)
            text = f"{vehicle_name(index)}: a pose is left out: {why}"
            self.get_logger().warning(one_line(text))

    def _draw(self) -> None:
        """Publish what is known of the positions."""
        markers = []
        for index, position in self._positions.items():
            markers += [self._box(index, position), self._number(index, position)]
        if markers:
            self._publisher.publish(MarkerArray(markers=markers))

    def _box(self, index: int, position: float) -> Marker:
        box = self._marker("vehicle", index, Marker.CUBE, position, HEIGHT / 2.0)
        box.scale.x, box.scale.y, box.scale.z = LENGTH, WIDTH, HEIGHT
        box.color = LEADER_COLOUR if index == self._leader else FOLLOWER_COLOUR
        return box

    def _number(self, index: int, position: float) -> Marker:
        number = self._marker("number", index, Marker.TEXT_VIEW_FACING, position, HEIGHT + 1.5)
        number.scale.z, number.text = 2.0, str(index)
        number.color = ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0)
        return number

    def _marker(self, kind: str, index: int, shape: int, position: float, height: float) -> Marker:
        marker = Marker(ns=kind, id=index, type=shape, action=Marker.ADD)
        marker.header.frame_id = "map"
        marker.pose.position.x = position - LENGTH / 2.0
        marker.pose.position.z = height
        marker.pose.orientation.w = 1.0
        return marker
