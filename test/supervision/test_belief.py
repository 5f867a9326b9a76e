"""Whose word counts: hosts that were started or are waited for, and publishers by their names."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import NodeKind, NodeName
from cacc_platoon.supervision.belief import Belief, OwnHost
from cacc_platoon.supervision.protocol import HostState
from msg_adapters.topics import Graph

MANUAL = "vehicle_2/vehicle"
TOPICS = tuple(f"/platoon/vehicle_2/{name}" for name in ("pose", "twist", "accel"))
STARTED = [
    NodeName(NodeKind.LEADER, 0),
    NodeName(NodeKind.VEHICLE, 1),
    NodeName(NodeKind.NOISE_RELAY, 1),
    NodeName(NodeKind.NOISE_RELAY, 2),
]
HOST = HostState("f00d", "vehicle_2_vehicle", 7, (MANUAL,))


def belief(*, spawn: bool = True, manual: str = MANUAL, parts: str = "") -> Belief:
    """Return whose word counts where a run starts all nodes but one, in host 0."""
    values = {
        "platoon.followers": 2,
        "run.spawn": spawn,
        "run.manual_nodes": (manual,) if manual else (),
        "record.parts": parts,
    }
    scenario = Scenario.from_values(values, None, "test")
    recorded = frozenset(topic.name for topic in Graph.of(scenario).recorded)
    own = OwnHost("supervisor", frozenset(), recorded, "/run/parts/supervisor", 99)
    hosts = [("0", STARTED, Path("/run/parts/host_0"))] if spawn else []
    return Belief.in_run(scenario, hosts, own)


def doubt(
    belief: Belief, state: HostState, *known: HostState, waiting: bool = True, **changes: Any
) -> str:
    state = dataclasses.replace(state, **changes)
    return belief.doubt(state, {k.host: k for k in known}, {"0": 5}, waiting=waiting)


def test_who_was_started_and_who_is_waited_for_is_believed() -> None:
    names = tuple(str(node) for node in STARTED)
    started = HostState("f00d", "0", 5, ("host_0/recorder", *names), part="/run/parts/host_0")
    own = HostState("f00d", "supervisor", 99, ("host_supervisor/recorder",), records=TOPICS)
    recorder = HostState("f00d", "recorder", 8, ("host_recorder/recorder",), records=TOPICS)
    for state in (started, own, HOST, recorder):
        assert doubt(belief(), state, HOST, waiting=False) == ""


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"nodes": ()}, "runs no node of the platoon"),
        ({"nodes": ("vehicle_1/vehicle",)}, "runs vehicle_1/vehicle, which is none of the nodes"),
        ({"nodes": ("vehicle_9/vehicle",)}, "runs vehicle_9/vehicle, which is none of the nodes"),
        ({"records": (*TOPICS, "/platoon/vehicle_0/pose")}, "says that it records /platoon/vehi"),
        ({"host": "other"}, "runs vehicle_2/vehicle, and so does host vehicle_2_vehicle"),
        ({"pid": 8}, "process 8 speaks for it, but it is process 7"),
        ({"host": "0"}, "process 7 speaks for it, but it is process 5"),
        ({"host": "supervisor"}, "process 7 speaks for it, but it is process 99"),
    ],
)
def test_a_host_that_says_more_is_another_publisher(changes: dict[str, object], why: str) -> None:
    line = doubt(belief(), HOST, HOST, waiting=False, **changes)
    assert line.startswith(f"host {changes.get('host', HOST.host)}: {why}")
    assert line.endswith(": the message comes from another publisher")


def test_a_node_may_be_started_again_before_the_run_begins() -> None:
    assert doubt(belief(), HOST, HOST, pid=8) == ""


def test_nobody_is_waited_for_where_everything_is_started() -> None:
    nobody = belief(manual="")
    assert "is none of the nodes that are started manually" in doubt(nobody, HOST)
    assert "no node is started manually" in doubt(nobody, HOST, host="recorder", nodes=())


def test_all_nodes_of_the_scenario_are_waited_for_where_none_is_started() -> None:
    everybody = belief(spawn=False, manual="")
    assert doubt(everybody, HOST, nodes=("vehicle_0/leader",)) == ""
    assert "vehicle_3/vehicle" in doubt(everybody, HOST, nodes=("vehicle_3/vehicle",))


@pytest.mark.parametrize(
    ("parts", "part", "believed"),
    [
        ("{tmp}/parts", "{tmp}/parts/vehicle_2_vehicle", True),
        ("{tmp}/parts", "{tmp}/parts/deep/er", True),
        ("{tmp}/parts", "{tmp}/parts", False),
        ("{tmp}/parts", "{tmp}/parts/../evil", False),
        ("{tmp}/parts", "{tmp}/parts2/x", False),
        ("{tmp}/parts", "{tmp}/parts/link/x", False),
        ("", "{tmp}/parts/x", False),
    ],
)
def test_a_part_is_believed_in_the_folder_that_the_supervisor_was_told(
    tmp_path: Path, parts: str, part: str, believed: bool
) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "evil").mkdir()
    (tmp_path / "parts" / "link").symlink_to(tmp_path / "evil")
    part, parts = part.format(tmp=tmp_path), parts.format(tmp=tmp_path)
    line = doubt(belief(parts=parts), HOST, part=part)
    assert (line == "") == believed, line
    if not believed:
        assert line.startswith(f"host vehicle_2_vehicle: records in {part}, ")
        assert f"-p record.parts:={Path(part).parent}" in line
        assert "another publisher" not in line, "it is the user's own node"


def test_one_node_may_publish_each_topic() -> None:
    allowed = belief().publishers([], started=True)
    assert allowed["/platoon/vehicle_2/pose"] == {"/platoon/vehicle_2/vehicle"}
    assert allowed["/platoon/vehicle_2/v2v/accel"] == {"/platoon/vehicle_2/noise_relay"}
    assert allowed["/platoon/status"] == {"/platoon/supervisor"}
    assert allowed["/platoon/host_0/recorded"] >= {"/platoon/host_0/recorder"}
    assert "/platoon/vehicle_9/vehicle" not in allowed["/platoon/host_state"]
    assert "/platoon/host_recorder/recorder" in allowed["/platoon/host_state"]
    later = belief().publishers(["vehicle_2_vehicle"], started=True)
    recorder = "/platoon/host_vehicle_2_vehicle/recorder"
    assert later["/platoon/host_vehicle_2_vehicle/recorded"] == {recorder}


def test_before_anything_is_started_only_those_started_manually_may_publish() -> None:
    allowed = belief().publishers([], started=False)
    there = {topic for topic, nodes in allowed.items() if nodes}
    assert there == {*TOPICS, "/platoon/host_state"}
    assert {
        topic for topic, nodes in belief(manual="").publishers([], started=False).items() if nodes
    } == set()


def test_counts_are_published_by_the_relay() -> None:
    scenario = Scenario.from_values({"platoon.followers": 1, "v2v.loss": 0.1}, None, "test")
    own = OwnHost("0", frozenset({"vehicle_1/noise_relay"}), frozenset())
    allowed = Belief(Graph.of(scenario), [own]).publishers([], started=True)
    assert allowed["/platoon/vehicle_1/v2v/complete"] == {"/platoon/vehicle_1/noise_relay"}


# Hosts that others start, by name.

EAST = HostState(
    "f00d", "east", 7, ("host_east/recorder", MANUAL, "vehicle_2/noise_relay"), records=TOPICS
)


def waits_for_east(spawn: bool = True) -> Belief:
    values = {"platoon.followers": 2, "run.remote_hosts": ("east=2",), "run.spawn": spawn}
    scenario = Scenario.from_values(values, None, "test")
    return Belief.in_run(scenario, [], OwnHost("supervisor", frozenset(), frozenset()))


@pytest.mark.parametrize("spawn", [True, False])
def test_a_host_that_is_waited_for_by_its_name_may_be_any_process_and_record_anywhere(
    spawn: bool,
) -> None:
    waits = waits_for_east(spawn)
    assert doubt(waits, EAST, part="/there/host_east") == ""
    assert doubt(waits, EAST, EAST, pid=8, waiting=True) == ""
    line = doubt(waits, EAST, EAST, pid=8, waiting=False)
    assert "process 8 speaks for it, but it is process 7" in line


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"nodes": ("vehicle_1/vehicle",)}, "runs vehicle_1/vehicle, which it was not given"),
        ({"records": ("/platoon/vehicle_1/pose",)}, "which is not for it to record"),
        ({"host": "west", "nodes": (MANUAL,)}, "which is none of the nodes that are started"),
    ],
)
def test_it_may_not_be_more_than_it_was_named_for(changes: dict[str, Any], why: str) -> None:
    assert why in doubt(waits_for_east(), EAST, **changes)


def test_hosts_that_have_not_come_are_named() -> None:
    nodes = [*EAST.nodes[1:], "vehicle_1/vehicle"]
    waits = waits_for_east()
    assert waits.missing(nodes, {}) == ["host east (vehicles 2)", "vehicle_1/vehicle"]
    assert waits.missing(nodes, {"east": EAST}) == ["vehicle_1/vehicle"]
    half = dataclasses.replace(EAST, nodes=EAST.nodes[:2])
    assert waits.missing(nodes[:2], {"east": half}) == ["vehicle_2/noise_relay"]


def test_what_it_publishes_is_known_only_once_the_run_has_shown_itself() -> None:
    waits, topic = waits_for_east(), "/platoon/vehicle_2/pose"
    assert waits.publishers([], started=True)[topic] == {f"/platoon/{MANUAL}"}
    assert waits.publishers([], started=False)[topic] == frozenset()
