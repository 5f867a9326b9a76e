"""What the supervisor makes of publishers whose node the graph does not tell, or not yet."""

import time
from collections.abc import Iterator
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.qos import QoSProfile

from cacc_platoon.dds.domain import own_domain
from cacc_platoon.nodes import qos
from cacc_platoon.scenario import Scenario
from cacc_platoon.supervision.supervisor_node import NAMELESS_LIMIT, UNKNOWN, SupervisorNode

STATUS = "/platoon/status"
POSE, RECORDED = "/platoon/vehicle_1/pose", "/platoon/host_0/recorded"
ALLOWED = {
    POSE: frozenset({"/platoon/vehicle_1/vehicle"}),
    RECORDED: frozenset({"/platoon/host_0/recorder"}),
}


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Iterator[SupervisorNode]:
    with own_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        rclpy.init(args=[])
        made = SupervisorNode(Scenario.from_values({"platoon.followers": 1}))
        yield made
        made.lock.drop()
        made.destroy_node()
        rclpy.shutdown()


def publisher(node: str, participant: int, entity: int, kind: str) -> SimpleNamespace:
    """Return what the graph tells of a publisher."""
    namespace, _, name = node.rpartition("/")
    profile: QoSProfile = qos.latched() if "Int64" in kind else qos.stream(Scenario())
    return SimpleNamespace(
        node_name=name or UNKNOWN,
        node_namespace=namespace or "_NODE_NAMESPACE_UNKNOWN_",
        endpoint_gid=[participant] * 12 + [0, 0, entity, 2],
        topic_type=kind,
        qos_profile=profile,
    )


@pytest.mark.parametrize("process", [0x12345, 0x54321])
def test_a_whole_process_the_graph_is_late_with_is_known_by_its_number(
    node: SupervisorNode, monkeypatch: pytest.MonkeyPatch, process: int
) -> None:
    status = publisher("/platoon/supervisor", 1, 1, "std_msgs/msg/String")
    late = publisher("", 1, 2, "std_msgs/msg/Int64")
    late.endpoint_gid = [1, 1, 1, 1, 0x45, 0x23, 9, 9, 0, 0, 0, 0, 0, 0, 2, 2]
    seen = {STATUS: [status], RECORDED: [late]}
    allowed = {STATUS: frozenset({"/platoon/supervisor"}), RECORDED: ALLOWED[RECORDED]}
    now = 100.0
    monkeypatch.setattr(node, "get_publishers_info_by_topic", lambda topic: seen[topic])
    monkeypatch.setattr(time, "monotonic", lambda: now)
    node.look(allowed, [process])
    now += NAMELESS_LIMIT + 1.0
    found = node.look(allowed, [process])
    assert bool(found.foreign) is (process == 0x54321)


@pytest.mark.parametrize(("participant", "foreign"), [(1, False), (2, True)])
def test_a_node_the_graph_is_late_with_is_known_by_its_process(
    node: SupervisorNode, monkeypatch: pytest.MonkeyPatch, participant: int, foreign: bool
) -> None:
    seen = {
        POSE: [publisher("/platoon/vehicle_1/vehicle", 1, 1, "geometry_msgs/msg/PoseStamped")],
        RECORDED: [publisher("", participant, 2, "std_msgs/msg/Int64")],
    }
    now = 100.0
    monkeypatch.setattr(node, "get_publishers_info_by_topic", lambda topic: seen[topic])
    monkeypatch.setattr(time, "monotonic", lambda: now)
    first = node.look(ALLOWED)
    assert (first.foreign, first.settled) == ((), not foreign)
    now += NAMELESS_LIMIT + 1.0
    later = node.look(ALLOWED)
    assert [line.partition(" ")[0] for line in later.foreign] == [RECORDED] * foreign
    seen[RECORDED] = [publisher("/platoon/host_0/recorder", participant, 2, "std_msgs/msg/Int64")]
    assert node.look(ALLOWED).foreign == ()
    seen[RECORDED] = [publisher("", participant, 2, "std_msgs/msg/Int64")]
    assert node.look(ALLOWED).foreign == ()
