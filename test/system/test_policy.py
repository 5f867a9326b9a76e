"""The SROS 2 policy beside the endpoints of a real platoon: all of them, and no other."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node

from cacc_platoon.scenario.names import NodeName
from cacc_platoon.supervision.host_plan import divide
from cacc_platoon.testing import Platoon
from msg_adapters.access import RUN, WATCH, Access, access_of, enclaves
from msg_adapters.topics import Graph

Start = Callable[..., Platoon]
BY_HAND = "vehicle_2/vehicle"


@pytest.fixture
def onlooker() -> Iterator[Callable[[Platoon], Node]]:
    """Return a function that makes a node beside a platoon."""
    made: list[tuple[Node, Context]] = []

    def make(run: Platoon) -> Node:
        context = Context()
        rclpy.init(args=[], context=context, domain_id=run.domain)
        node = Node("onlooker", context=context, use_global_arguments=False)
        made.append((node, context))
        return node

    yield make
    for node, context in made:
        node.destroy_node()
        rclpy.shutdown(context=context)


def seen(node: Node, prefix: str, name: str) -> Access:
    """Return the access that a node of a platoon makes use of, as the graph shows it."""
    namespace, _, own = f"{prefix}/{name}".rpartition("/")

    def names(found: list[tuple[str, list[str]]]) -> frozenset[str]:
        return frozenset(topic for topic, _ in found)

    try:
        return Access(
            name,
            names(node.get_publisher_names_and_types_by_node(own, namespace)),
            names(node.get_subscriber_names_and_types_by_node(own, namespace)),
            tuple(sorted(names(node.get_service_names_and_types_by_node(own, namespace)))),
        )
    except rclpy.node.NodeNameNonExistentError:
        return Access(name, frozenset(), frozenset(), ())


def allowed(prefix: str, access: Access) -> Access:
    """Return an access with the services by their full names."""
    own = [service.replace("~", f"{prefix}/{access.node}") for service in access.services]
    return access._replace(services=tuple(sorted(own)))


@pytest.mark.parametrize(
    "settings",
    [
        ("v2v.loss=0.1", "v2v.send_rule=cam", "record.command=true", "run.clock=true"),
        ("run.sync=wall", "v2v.reception=fallback", "v2v.monitor=report"),
    ],
    ids=["lockstep", "wall"],
)
def test_a_platoon_uses_what_its_policy_allows_and_nothing_else(
    platoon: Start, onlooker: Callable[[Platoon], Node], settings: tuple[str, ...]
) -> None:
    """Of a node that is started manually, and of those that the run starts."""
    more = ("platoon.followers=3", "run.real_time_factor=1", "run.duration=60", *settings)
    run = platoon(*more, hosts=2, manual_nodes={BY_HAND: ()})
    run.start(BY_HAND)
    run.wait_state("running")
    node, graph = onlooker(run), Graph.of(run.scenario)
    by_hand = next(name for name in graph.nodes if str(name) == BY_HAND)
    expected = [access_of(graph, by_hand, speaks=True)]
    expected += enclaves(graph, divide(run.scenario, cores=2), clock=run.scenario.run.clock)[RUN]
    given = {access.node: allowed(graph.prefix, access) for access in expected}
    del given[WATCH]  # of a terminal
    given["supervisor"] = _of_this_run(given["supervisor"], graph)
    given["host_supervisor/recorder"] = _recording(given, by_hand, graph)

    def differing() -> list[tuple[Access, Access]]:
        pairs = [(access, seen(node, graph.prefix, name)) for name, access in given.items()]
        return [(access, found) for access, found in pairs if access != found]

    with contextlib.suppress(TimeoutError):
        run.wait(lambda: not differing(), 20.0, "what the policy allows")
    assert differing() == []
    names = {f"{space.rstrip('/')}/{name}" for name, space in node.get_node_names_and_namespaces()}
    ours = {name.removeprefix(f"{graph.prefix}/") for name in names if graph.prefix in name}
    assert ours == given.keys()


def _of_this_run(access: Access, graph: Graph) -> Access:
    """Return the access of the supervisor without hosts that are not there in this run."""
    there = {graph.platoon.recorded(host) for host in ("0", "1", "supervisor")}
    kept = {name for name in access.subscribes if not name.endswith("/recorded")}
    return access._replace(subscribes=frozenset(kept | there))


def _recording(given: dict[str, Access], manual: NodeName, graph: Graph) -> Access:
    """Return the access of the supervisor's recorder where only one node does not record."""
    topics = {topic.name for topic in graph.recorded_with(manual)}
    access = given["host_supervisor/recorder"]
    return access._replace(
        subscribes=frozenset(topics | {graph.platoon.status, graph.platoon.view_request})
    )
