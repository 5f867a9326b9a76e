"""Parameters of running nodes: what may be set, what is refused, and that nothing is half done."""

from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
from rclpy.parameter import Parameter

from cacc_platoon.dds.domain import own_domain
from cacc_platoon.nodes.node import MOST_CHANGES, PlatoonNode
from cacc_platoon.nodes.noise_relay import NoiseRelayNode
from cacc_platoon.nodes.vehicle import VehicleNode
from cacc_platoon.scenario import Scenario

SMALL: dict[str, Any] = {"platoon.followers": 2, "run.adjustable": True}


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    with own_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        rclpy.init(args=[])
        yield
        rclpy.shutdown()


def texts(node: PlatoonNode) -> list[str]:
    return [event.text for event in node.events]


def test_a_change_is_an_event_of_the_next_sample(ros: None) -> None:
    scenario = Scenario.from_values(SMALL)
    relay, vehicle = NoiseRelayNode(scenario, 2), VehicleNode(scenario, 2)
    [result] = relay.set_parameters([Parameter("v2v.loss", value=1)])
    assert result.successful, result.reason
    [result] = vehicle.set_parameters([Parameter("controller.time_headway", value=1.25)])
    assert result.successful, result.reason
    assert (texts(relay), texts(vehicle)) == (["v2v.loss=1.0"], ["controller.time_headway=1.25"])
    assert {event.sample for event in (*relay.events, *vehicle.events)} == {0}
    relay.destroy_node()
    vehicle.destroy_node()


def test_what_is_refused_together_is_not_carried_out_in_part(ros: None) -> None:
    relay = NoiseRelayNode(Scenario.from_values(SMALL), 2)
    both = [Parameter("v2v.loss", value=0.5), Parameter("use_sim_time", value=True)]
    assert not relay.set_parameters_atomically(both).successful
    assert texts(relay) == []
    assert relay.get_parameter("v2v.loss").value == 0.0
    relay.destroy_node()


def test_a_node_does_not_change_for_ever(ros: None) -> None:
    relay = NoiseRelayNode(Scenario.from_values(SMALL), 2)
    for number in range(MOST_CHANGES):
        [result] = relay.set_parameters([Parameter("v2v.loss", value=number / 1000)])
        assert result.successful
    [result] = relay.set_parameters([Parameter("v2v.loss", value=0.5)])
    assert not result.successful
    assert f"changed {MOST_CHANGES} times" in result.reason
    assert len(texts(relay)) == MOST_CHANGES
    relay.destroy_node()


def test_custom_code_that_would_ignore_it_refuses_a_change(ros: None) -> None:
    def law(follower: Any) -> Any:
        return follower.law()

    vehicle = VehicleNode(Scenario.from_values(SMALL), 2, law)
    [result] = vehicle.set_parameters([Parameter("controller.time_headway", value=1.25)])
    assert not result.successful
    assert "is ignored by the control law" in result.reason
    vehicle.destroy_node()


def test_nothing_may_be_set_where_the_run_is_not_adjustable(ros: None) -> None:
    relay = NoiseRelayNode(Scenario.from_values({"platoon.followers": 2}), 2)
    [result] = relay.set_parameters([Parameter("v2v.loss", value=1.0)])
    assert not result.successful
    assert "read-only" in result.reason
    assert texts(relay) == []
    relay.destroy_node()
