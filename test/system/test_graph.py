"""The graph of a running platoon as `ros2 doctor` wants it: who listens is spoken to."""

from collections.abc import Callable

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node

from cacc_platoon.testing import Platoon


def silent_topics(node: Node) -> list[str]:
    """Return the topics that somebody subscribes to and nobody publishes."""
    names = [name for name, _ in node.get_topic_names_and_types()]
    return [
        name for name in names if node.count_subscribers(name) and not node.count_publishers(name)
    ]


@pytest.mark.parametrize(("loss", "counted"), [(0.0, False), (0.2, True)])
def test_what_is_subscribed_to_is_published(
    platoon: Callable[..., Platoon], loss: float, counted: bool
) -> None:
    """Above all v2v/complete, which only a relay that may lose packets publishes."""
    run = platoon("platoon.followers=3", "run.real_time_factor=2", f"v2v.loss={loss}")
    run.wait_sample(10)
    context = Context()
    rclpy.init(args=[], context=context, domain_id=int(run.environment()["ROS_DOMAIN_ID"]))
    node = Node("onlooker", context=context, use_global_arguments=False)
    try:
        run.wait(lambda: node.count_publishers("/platoon/vehicle_3/pose") == 1, 60, "the graph")
        run.wait(lambda: node.count_publishers("/platoon/host_state") >= 1, 60, "the graph")
        run.wait(lambda: not silent_topics(node), 60, "a publisher for every subscription")
        complete = "/platoon/vehicle_2/v2v/complete"
        if counted:
            run.wait(lambda: node.count_subscribers(complete) > 0, 60, "the graph")
            run.wait(lambda: node.count_publishers(complete) > 0, 60, "the graph")
        assert bool(node.count_subscribers(complete)) is counted
        assert bool(node.count_publishers(complete)) is counted
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
