"""What every node of a platoon publishes, subscribes to and answers, all of it: its access.

The data topics are those of the graph; here is what a node has besides: what processes tell each
other, and what every ROS node has. From it follows a policy for SROS 2.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple
from xml.etree import ElementTree as ET

from cacc_platoon.scenario.names import NodeKind, NodeName, host_name
from msg_adapters.topics import Graph, Topic

SUPERVISOR, RECORDER, MARKERS, WATCH = "supervisor", "recorder", "markers", "watch"
RUN = "run"
"""The enclave of `platoon run` and the hosts that it starts."""
EVERY_NODE = ("/parameter_events", "/rosout")
SERVICES = (
    *("~/describe_parameters", "~/get_parameter_types", "~/get_parameters", "~/list_parameters"),
    *("~/set_parameters", "~/set_parameters_atomically", "~/get_type_description"),
)
DIAGNOSTICS, CLOCK = "/diagnostics", "/clock"


class Access(NamedTuple):
    """The access of one node.

    Attributes
    ----------
    node : str
        Its name below the platoon's prefix.
    publishes, subscribes : frozenset of str
        Full names of topics.
    services : tuple of str
        What it answers; ~ stands for the node.
    """

    node: str
    publishes: frozenset[str]
    subscribes: frozenset[str]
    services: tuple[str, ...] = SERVICES


def access_of(graph: Graph, node: NodeName, *, speaks: bool = False) -> Access:
    """Return the access of a node; one that is started manually speaks for its host."""
    topics = graph.nodes[node]
    publishes, subscribes = _names(topics.publishes), _names(topics.subscribes)
    if node.kind is NodeKind.LEADER and not graph.clocked:
        subscribes |= {graph.platoon.horizon}
    if node.kind is NodeKind.VEHICLE and graph.clocked:
        publishes |= {DIAGNOSTICS}
    return _access(graph, str(node), publishes, subscribes, speaks=speaks)


def recorder_of(graph: Graph, host: str, topics: Iterable[Topic], *, speaks: bool = True) -> Access:
    """Return the access of the recorder of a host."""
    node = f"{host_name(host)}/{RECORDER}"
    of = graph.platoon
    own, heard = frozenset({of.recorded(host), of.view}), _names(topics) | {of.view_request}
    return _access(graph, node, own, heard, speaks=speaks)


def supervisor_of(graph: Graph, hosts: Iterable[str], *, clock: bool = False) -> Access:
    """Return the access of the supervisor, who listens to the recorders of hosts.

    Parameters
    ----------
    graph : Graph
        The platoon.
    hosts : iterable of str
        Names of the hosts.
    clock : bool, optional
        Whether it publishes the simulated time.
    """
    of = graph.platoon
    publishes = frozenset({of.horizon, of.status, of.scenario, of.events, of.view_request})
    publishes |= {CLOCK} if clock else frozenset()
    progress = {of.recorded(host) for host in hosts}
    heard = frozenset({of.status, of.host_state, *progress})
    access = _access(graph, SUPERVISOR, publishes, heard)
    return access._replace(services=(*SERVICES, of.pause, of.resume, of.step))


def markers_of(graph: Graph) -> Access:
    """Return the access of what draws the platoon for RViz."""
    poses = _names(vehicle.pose for vehicle in graph.vehicles.values())
    return _access(graph, MARKERS, frozenset({graph.platoon.markers}), poses)


def watch_of(graph: Graph) -> Access:
    """Return the access of a viewer, in `platoon watch` and in `platoon run` on a terminal."""
    of = graph.platoon
    heard = frozenset({of.scenario, of.status, of.events, of.view})
    return _access(graph, WATCH, frozenset(), heard)


def _access(
    graph: Graph,
    node: str,
    publishes: frozenset[str],
    subscribes: frozenset[str],
    *,
    speaks: bool = False,
) -> Access:
    if speaks:
        publishes |= {graph.platoon.host_state}
        subscribes |= {graph.platoon.status}
    return Access(node, publishes.union(EVERY_NODE), subscribes)


def _names(topics: Iterable[Topic]) -> frozenset[str]:
    return frozenset(topic.name for topic in topics)


def enclaves(
    graph: Graph, hosts: Sequence[Sequence[NodeName]], *, clock: bool = False
) -> dict[str, list[Access]]:
    """Return the nodes of every process that may be there, by its name below the prefix.

    Parameters
    ----------
    graph : Graph
        The platoon.
    hosts : sequence of sequence of NodeName
        The nodes of each host that `platoon run` starts.
    clock : bool, optional
        Whether the supervisor publishes the simulated time.
    """
    names = [f"{number}" for number in range(len(hosts))]
    started = [
        recorder_of(graph, name, _recorded(graph, nodes))
        for name, nodes in zip(names, hosts, strict=True)
    ]
    started += [access_of(graph, node) for nodes in hosts for node in nodes]
    rest = recorder_of(graph, SUPERVISOR, graph.recorded)
    by_hand = {str(node): str(node).replace("/", "_") for node in graph.nodes}
    everybody = [*names, SUPERVISOR, RECORDER, *by_hand.values()]
    supervisor = supervisor_of(graph, everybody, clock=clock)
    viewer = watch_of(graph)
    found = {RUN: [supervisor, rest, viewer, *started], SUPERVISOR: [supervisor, rest]}
    for node in graph.nodes:
        found[str(node)] = [
            access_of(graph, node, speaks=True),
            recorder_of(graph, by_hand[str(node)], graph.recorded_with(node), speaks=False),
        ]
    found[RECORDER] = [recorder_of(graph, RECORDER, graph.recorded)]
    found[MARKERS] = [markers_of(graph)]
    found[WATCH] = [viewer]
    return found


def _recorded(graph: Graph, nodes: Iterable[NodeName]) -> list[Topic]:
    return [topic for node in nodes for topic in graph.recorded_with(node)]


def policy(prefix: str, processes: Mapping[str, Iterable[Access]]) -> str:
    """Return the SROS 2 policy of processes, one enclave each, as XML.

    Parameters
    ----------
    prefix : str
        The platoon's namespace, with which the name of every enclave begins.
    processes : mapping of str to iterable of Access
        The nodes of each process.
    """
    root = ET.Element("policy", version="0.2.0")
    found = ET.SubElement(root, "enclaves")
    for name, nodes in processes.items():
        enclave = ET.SubElement(found, "enclave", path=f"{prefix}/{name}")
        profiles = ET.SubElement(enclave, "profiles")
        for node in nodes:
            _add_profile(profiles, prefix, node)
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _add_profile(profiles: ET.Element, prefix: str, access: Access) -> None:
    namespace, _, name = f"{prefix}/{access.node}".rpartition("/")
    profile = ET.SubElement(profiles, "profile", ns=namespace or "/", node=name)
    for kind, word, direction, names in (
        ("topics", "topic", "publish", sorted(access.publishes)),
        ("topics", "topic", "subscribe", sorted(access.subscribes)),
        ("services", "service", "reply", access.services),
    ):
        if names:
            rule = ET.SubElement(profile, kind, {direction: "ALLOW"})
            for one in names:
                ET.SubElement(rule, word).text = one
