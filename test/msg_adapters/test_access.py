"""The access of nodes: what follows from the graph, and the XML in which SROS 2 takes it."""

import xml.etree.ElementTree as ET

import pytest

from cacc_platoon.cli import main
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import NodeKind, NodeName
from msg_adapters.access import (
    EVERY_NODE,
    MARKERS,
    RECORDER,
    RUN,
    SUPERVISOR,
    access_of,
    enclaves,
    policy,
)
from msg_adapters.topics import Graph

WALL = {"run.sync": "wall", "v2v.loss": 0.1, "v2v.reception": "fallback"}


def graph_of(values: dict | None = None) -> Graph:
    return Graph.of(Scenario.from_values({"platoon.followers": 2, **(values or {})}))


@pytest.mark.parametrize("values", [{}, WALL, {"v2v.loss": 0.1, "v2v.send_rule": "cam"}])
def test_who_listens_to_a_data_topic_and_who_publishes_it_is_what_the_graph_says(values):
    graph = graph_of(values)
    for node, topics in graph.nodes.items():
        access = access_of(graph, node)
        assert access.publishes >= {topic.name for topic in topics.publishes}.union(EVERY_NODE)
        assert access.subscribes >= {topic.name for topic in topics.subscribes}
        more = access.publishes | access.subscribes
        more -= {topic.name for topic in (*topics.publishes, *topics.subscribes)}
        assert more <= {*EVERY_NODE, "/platoon/horizon", "/diagnostics"}


def test_no_topic_of_data_has_two_nodes_that_may_publish_it():
    graph = graph_of(WALL)
    hosts = [list(graph.nodes)]
    (run, *others) = enclaves(graph, hosts).items()
    assert run[0] == RUN
    for topic in graph.recorded:
        assert sum(topic.name in access.publishes for access in run[1]) == 1
        publishers = [
            name for name, nodes in others if any(topic.name in one.publishes for one in nodes)
        ]
        assert len(publishers) == 1


def test_a_node_that_is_started_manually_speaks_and_hears_for_its_host():
    graph = graph_of()
    node = NodeName(NodeKind.VEHICLE, 2)
    speaks, silent = access_of(graph, node, speaks=True), access_of(graph, node)
    assert speaks.publishes - silent.publishes == {"/platoon/host_state"}
    assert speaks.subscribes - silent.subscribes == {"/platoon/status"}


def test_only_the_supervisor_may_give_orders():
    graph = graph_of()
    orders = {"/platoon/status", "/platoon/horizon", "/platoon/scenario", "/platoon/events"}
    found = enclaves(graph, [list(graph.nodes)])
    givers = {one.node for nodes in found.values() for one in nodes if orders & one.publishes}
    assert givers == {SUPERVISOR}
    assert {RECORDER, MARKERS, *map(str, graph.nodes)} < found.keys()


def test_the_xml_says_the_same_and_nothing_is_denied_by_a_rule():
    graph = graph_of()
    found = enclaves(graph, [list(graph.nodes)])
    root = ET.fromstring(policy(graph.prefix, found))
    assert (root.tag, root.get("version")) == ("policy", "0.2.0")
    read = {enclave.get("path", ""): enclave for enclave in root.findall("enclaves/enclave")}
    assert read.keys() == {f"/platoon/{name}" for name in found}
    for name, nodes in found.items():
        profiles = read[f"/platoon/{name}"].findall("profiles/profile")
        assert len(profiles) == len(nodes)
        for profile, node in zip(profiles, nodes, strict=True):
            assert f"{profile.get('ns')}/{profile.get('node')}" == f"/platoon/{node.node}"
            rules = {next(iter(rule.items())): [e.text for e in rule] for rule in profile}
            assert rules == {
                ("publish", "ALLOW"): sorted(node.publishes),
                ("subscribe", "ALLOW"): sorted(node.subscribes),
                ("reply", "ALLOW"): list(node.services),
            }


def test_the_command_prints_it_for_the_hosts_of_a_scenario(capsys):
    settings = ["--set", "platoon.followers=2", "--set", "run.hosts=2"]
    assert main(["policy", "config/paper_a.yaml", *settings]) == 0
    root = ET.fromstring(capsys.readouterr().out)
    run = root.find("enclaves/enclave[@path='/platoon/run']")
    assert run is not None
    recorders = {p.get("ns") for p in run.findall("profiles/profile[@node='recorder']")}
    assert recorders == {f"/platoon/host_{name}" for name in ("0", "1", "supervisor")}
