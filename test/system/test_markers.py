"""The marker node beside a real run, and among poses that it cannot draw."""

import math
import time
from collections.abc import Callable, Iterator
from itertools import pairwise

import pytest
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from visualization_msgs.msg import MarkerArray

from cacc_platoon.dds.domain import own_domain
from cacc_platoon.nodes.markers import MarkerNode
from cacc_platoon.scenario import Scenario
from cacc_platoon.testing import Platoon

PATIENCE = 30.0


def test_every_vehicle_has_a_box_where_it_is(platoon: Callable[..., Platoon]) -> None:
    settings = ("run.duration=10", "platoon.followers=3", "run.real_time_factor=4")
    run = platoon(*settings, "run.manual_nodes=[vehicle_1/noise_relay]")
    seen: list[MarkerArray] = []
    run.subscribe(MarkerArray, "/platoon/markers", seen.append)
    run.start("markers")
    run.wait(lambda: run.publishers_of("/platoon/markers") == 1, 60, "the marker node")
    run.start("vehicle_1/noise_relay")
    run.wait(lambda: bool(seen) and len(seen[-1].markers) == 8, 60, "all markers")
    assert run.result().status == "finished"
    boxes = [marker for marker in seen[-1].markers if marker.ns == "vehicle"]
    assert sorted(marker.id for marker in boxes) == [0, 1, 2, 3]
    ahead = sorted(boxes, key=lambda marker: marker.id)
    gaps = [a.pose.position.x - b.pose.position.x for a, b in pairwise(ahead)]
    assert min(gaps) > 20.0


@pytest.fixture
def executor() -> Iterator[SingleThreadedExecutor]:
    """Run nodes of this process in a domain of their own."""
    with own_domain() as domain:
        rclpy.init(args=[], domain_id=domain)
        made = SingleThreadedExecutor()
        yield made
        for node in list(made.get_nodes()):
            node.destroy_node()
        made.shutdown()
        rclpy.shutdown()


@pytest.mark.parametrize(("frame", "x"), [("odometry", 1.0), ("map", math.nan)])
def test_a_pose_that_cannot_be_drawn_is_left_out(
    executor: SingleThreadedExecutor, frame: str, x: float
) -> None:
    seen: list[MarkerArray] = []
    other = Node("other", use_global_arguments=False)
    other.create_subscription(MarkerArray, "/platoon/markers", seen.append, 5)
    executor.add_node(other)
    executor.add_node(MarkerNode(Scenario.from_values({"platoon.followers": 1})))
    publishers = [
        other.create_publisher(PoseStamped, f"/platoon/vehicle_{index}/pose", 10)
        for index in (0, 1)
    ]
    deadline = time.monotonic() + PATIENCE
    while len(seen) < 5 and time.monotonic() < deadline:
        for index, publisher in enumerate(publishers):
            message = PoseStamped()
            message.header.frame_id = frame if index else "map"
            message.pose.position.x = x if index else 2.0
            publisher.publish(message)
        executor.spin_once(timeout_sec=0.1)
    assert len(seen) == 5
    assert {marker.id for marker in seen[-1].markers} == {0}
