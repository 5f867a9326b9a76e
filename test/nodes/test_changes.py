"""Parameters of running nodes: what may be set, what is refused, and that nothing is half done."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from geometry_msgs.msg import AccelStamped
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.parameter import Parameter

from cacc_platoon.dds.domain import own_domain
from cacc_platoon.nodes import qos
from cacc_platoon.nodes.executor import create_executor
from cacc_platoon.nodes.node import MOST_CHANGES, PlatoonNode
from cacc_platoon.nodes.noise_relay import NoiseRelayNode
from cacc_platoon.nodes.vehicle import VehicleNode
from cacc_platoon.scenario import Scenario
from msg_adapters.topics import VehicleTopics

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


def test_a_change_of_a_relay_of_several_links_is_of_the_first_sample_that_none_has(
    ros: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of one link five samples are here, of the other two; the change takes effect on both at 5."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "system"))
    two = {"platoon.predecessors": 2, "controller.law": "own_parts:TwoAhead"}
    scenario = Scenario.from_values({**SMALL, **two})
    relay, other = NoiseRelayNode(scenario, 2), Node("other")
    executor = create_executor()
    for node in (relay, other):
        executor.add_node(node)
    own = VehicleTopics("/platoon", 2)
    arrived: list[bytes] = []
    publishers = []
    for sender in (1, 0):
        accel = VehicleTopics("/platoon", sender).accel
        publishers.append(other.create_publisher(AccelStamped, accel.name, qos.stream(scenario)))
        topic = own.link(sender).accel.name
        other.create_subscription(
            AccelStamped, topic, arrived.append, qos.stream(scenario), raw=True
        )
    received = [own.link(sender).accel.name for sender in (1, 0)]

    def connected() -> bool:
        heard = all(one.get_subscription_count() for one in publishers)
        return heard and all(other.count_publishers(name) for name in received)

    wait(executor, connected)
    for sender, publisher, samples in zip((1, 0), publishers, (5, 2), strict=True):
        codec = VehicleTopics("/platoon", sender).accel.codec
        for k in range(samples):
            publisher.publish(codec.encode(k * scenario.step_ns, 0.5))
    wait(executor, lambda: len(arrived) == 7)
    [result] = relay.set_parameters([Parameter("v2v.loss", value=1.0)])
    assert result.successful, result.reason
    assert [event.sample for event in relay.events] == [5]
    for node in (relay, other):
        node.destroy_node()


def wait(executor: Executor, until: Callable[[], bool]) -> None:
    """Spin until something is the case."""
    end = time.monotonic() + 20.0
    while not until():
        assert time.monotonic() < end, "it has not come to that in 20 s"
        executor.spin_once(timeout_sec=0.05)


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
