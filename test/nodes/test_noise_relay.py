"""A real relay: how it subscribes to what its predecessor sends."""

import pytest
import rclpy
from rclpy.qos import ReliabilityPolicy

from cacc_platoon.dds.domain import own_domain
from cacc_platoon.nodes.noise_relay import NoiseRelayNode
from cacc_platoon.scenario import Scenario


@pytest.mark.parametrize("best_effort", [False, True])
def test_losses_of_dds_are_asked_for(monkeypatch: pytest.MonkeyPatch, best_effort: bool) -> None:
    values = {"platoon.followers": 1, "run.sync": "wall", "v2v.best_effort": best_effort}
    wanted = ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE
    with own_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        rclpy.init(args=[])
        try:
            node = NoiseRelayNode(Scenario.from_values(values), 1)
            found = {one.topic_name: one.qos_profile.reliability for one in node.subscriptions}
            sent = {one.topic_name: one.qos_profile.reliability for one in node.publishers}
            node.destroy_node()
        finally:
            rclpy.shutdown()
    assert found["/platoon/vehicle_0/accel"] is wanted
    assert sent["/platoon/vehicle_1/v2v/accel"] is ReliabilityPolicy.RELIABLE
