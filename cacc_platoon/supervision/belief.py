"""Whose word counts in a run: which hosts there may be, and who may publish which topic.

Anybody in the domain can publish what a host publishes. So a host is believed only when it is one
that the supervisor has started, in the process that it has started, or one that it waits for; and
only as far as it says what such a host can say. Names in the graph can be copied too: what this
keeps out, and what not, is said in docs/security.md.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import NodeName, host_name
from cacc_platoon.scenario.run_event import EventKind
from cacc_platoon.scenario.timeline import change_of
from cacc_platoon.supervision.host_plan import nodes_of
from cacc_platoon.supervision.protocol import HostState, OtherVersionError, ProtocolError
from cacc_platoon.supervision.run_events import MessageRefused
from msg_adapters.topics import Graph

FOREIGN = "another publisher"
"""What a line says of whoever is none of ours."""
ADVICE = (
    "Another platoon or publisher uses these names; give one of them another platoon.namespace "
    "or ROS_DOMAIN_ID"
)
"""What to do about them."""
RECORDER_HOST = "recorder"
"""Name of the host that is a manually started recorder."""


@dataclass(frozen=True)
class OwnHost:
    """A host that the supervisor starts, or that is in its process.

    Attributes
    ----------
    name : str
        Its name.
    nodes : frozenset of str
        What it may run besides its recorder, relative to the platoon's namespace.
    records : frozenset of str
        Topics that it may record.
    part : str
        The folder in which it records.
    pid : int, optional
        Its process, where that is known before it is started.
    early : bool
        Whether it is there before the supervisor has shown itself.
    remote : str
        What to call a host that others start and that is waited for by its name; empty for one of
        ours. Which process it is, and where it records, is its own affair.
    """

    name: str
    nodes: frozenset[str]
    records: frozenset[str]
    part: str = ""
    pid: int | None = None
    early: bool = False
    remote: str = ""

    @property
    def all_nodes(self) -> frozenset[str]:
        """Its nodes and its recorder."""
        return self.nodes | {f"{host_name(self.name)}/recorder"}


def beyond(host: str, sample: int, reach: int) -> str:
    """Say that a recorder cannot be as far as a message claims."""
    return (
        f"host {host}: reports sample {sample} as recorded, beyond the horizon {reach}: the "
        f"message comes from {FOREIGN}"
    )


def refusal(topic: str, error: ProtocolError) -> MessageRefused:
    """Return what to make of a text on a topic that nobody of this version can have sent."""
    if isinstance(error, OtherVersionError):
        return MessageRefused(f"{topic}: {error}")
    return MessageRefused(f"{topic}: a message from {FOREIGN}, no host of ours: {error}")


class Belief:
    """Who may say and publish what in a run.

    Parameters
    ----------
    graph : Graph
        The platoon's topics.
    own : iterable of OwnHost
        The hosts that the supervisor starts or that are in its process.
    manual : iterable of str, optional
        Nodes that somebody else starts.
    parts : str, optional
        The folder in which those may record.
    publishers : mapping of str to str, optional
        Which node publishes each data topic; by default, those of the graph.
    """

    def __init__(
        self,
        graph: Graph,
        own: Iterable[OwnHost],
        *,
        manual: Iterable[str] = (),
        parts: str = "",
        publishers: Mapping[str, str] | None = None,
    ) -> None:
        self._platoon = graph.platoon
        self._own = {host.name: host for host in own}
        self._manual = frozenset(manual)
        self._parts = parts
        self._published = {
            str(node): frozenset(topic.name for topic in topics.publishes)
            for node, topics in graph.nodes.items()
        }
        self._recorded_with = {
            str(node): frozenset(topic.name for topic in graph.recorded_with(node))
            for node in graph.nodes
        }
        by_graph = {topic: node for node, topics in self._published.items() for topic in topics}
        self._publishers = publishers or by_graph

    @classmethod
    def in_run(
        cls,
        scenario: Scenario,
        hosts: Iterable[tuple[str, Iterable[NodeName], Path]],
        own: OwnHost,
    ) -> Belief:
        """Return whose word counts in a run.

        Parameters
        ----------
        scenario : Scenario
            What is run.
        hosts : iterable of (str, iterable of NodeName, Path)
            Name, nodes and part of each host that the supervisor starts.
        own : OwnHost
            The host in the supervisor's process, which records what no other does.
        """
        graph = Graph.of(scenario)
        started = [
            OwnHost(name, *_may(graph, nodes), str(part.absolute())) for name, nodes, part in hosts
        ]
        remote = [
            OwnHost(host.name, *_may(graph, nodes_of(scenario, host)), remote=f"{host}")
            for host in scenario.remote_hosts
        ]
        there = frozenset[str]().union(*(host.nodes for host in remote))
        manual = scenario.run.manual_nodes
        if not scenario.run.spawn:
            manual = tuple(name for name in scenario.node_names if name not in there)
        return cls(graph, [*started, *remote, own], manual=manual, parts=scenario.record.parts)

    def missing(self, nodes: Iterable[str], hosts: Mapping[str, HostState]) -> list[str]:
        """Return which of some nodes have not come, in the words for a line.

        The nodes of a host that is waited for by its name go by that, together.
        """
        present = {node for host in hosts.values() for node in host.nodes}
        named = {
            node: own.remote
            for own in self._own.values()
            if own.name not in hosts
            for node in own.nodes
            if own.remote
        }
        return [*dict.fromkeys(named.get(node, node) for node in nodes if node not in present)]

    def doubt(
        self,
        state: HostState,
        known: Mapping[str, HostState],
        processes: Mapping[str, int],
        *,
        waiting: bool,
    ) -> str:
        """Return why a host is not believed; empty when it is.

        Parameters
        ----------
        state : HostState
            What it says.
        known : mapping of str to HostState
            What is believed of the hosts so far.
        processes : mapping of str to int
            The processes that the supervisor has started, by host.
        waiting : bool
            Whether nodes may still come, or come again.
        """
        own = self._own.get(state.host)
        before = known.get(state.host)
        if own:
            pid = processes.get(own.name, own.pid)
            if own.remote and before and not waiting:
                pid = before.pid
            doubt = _doubt_own(state, own, pid)
        else:
            doubt = self._doubt_manual(state, known, waiting)
        if doubt := doubt or _doubt_events(state):
            return f"host {state.host}: {doubt}: the message comes from {FOREIGN}"
        return "" if own else self._recorded_elsewhere(state)

    def _doubt_manual(self, state: HostState, known: Mapping[str, HostState], waiting: bool) -> str:
        nodes = _besides_recorder(state)
        if unknown := [node for node in nodes if node not in self._manual]:
            return f"runs {unknown[0]}, which is none of the nodes that are started manually"
        if not self._manual:
            return "this run has not started it, and no node is started manually"
        if not nodes and state.host != RECORDER_HOST:
            return "runs no node of the platoon"
        for other in known.values():
            if other.host != state.host and (shared := {*nodes} & {*other.nodes}):
                return f"runs {min(shared)}, and so does host {other.host}"
        before = known.get(state.host)
        if before and before.pid != state.pid and not waiting:
            return f"process {state.pid} speaks for it, but it is process {before.pid}"
        recordable: frozenset[str] = frozenset().union(
            *(self._recorded_with[node] for node in nodes or self._recorded_with)
        )
        return _doubt_records(state, recordable)

    def _recorded_elsewhere(self, state: HostState) -> str:
        """Say that what a manually started host records would not be found."""
        if not state.part or (self._parts and inside(state.part, self._parts)):
            return ""
        where = f"outside of record.parts = {self._parts}" if self._parts else "unknown to the run"
        return (
            f"host {state.host}: records in {state.part}, {where}: it would not be in the bag. "
            f"Start the supervisor with -p record.parts:={Path(state.part).parent}, or the node "
            "without record"
        )

    def publishers(self, hosts: Iterable[str], *, started: bool) -> dict[str, frozenset[str]]:
        """Return the full names of the nodes that may publish each topic of the platoon.

        Parameters
        ----------
        hosts : iterable of str
            Hosts that have appeared.
        started : bool
            Whether the supervisor has shown itself and started its hosts.
        """
        own = [host for host in self._own.values() if started or host.early]
        there = self._manual.union(*(host.nodes for host in own))
        allowed: dict[str, frozenset[str]] = {
            topic: self._names([node] if node in there else [])
            for topic, node in self._publishers.items()
        }
        topics = self._platoon
        for topic in (topics.status, topics.horizon, topics.scenario, topics.events):
            allowed[topic] = self._names(["supervisor"] if started else [])
        for host in own:
            allowed[topics.recorded(host.name)] = self._names(host.all_nodes)
        manual = [name for name in hosts if name not in self._own]
        recorders = [f"{host_name(name)}/recorder" for name in manual]
        for name, recorder in zip(manual, recorders, strict=True):
            allowed[topics.recorded(name)] = self._names([recorder])
        if self._manual:
            recorders.append(f"{host_name(RECORDER_HOST)}/recorder")
        speakers = self._manual.union(recorders, *(host.all_nodes for host in own))
        return {**allowed, topics.host_state: self._names(speakers)}

    def _names(self, nodes: Iterable[str]) -> frozenset[str]:
        return frozenset(f"{self._platoon.prefix}/{node}" for node in nodes)


def _may(graph: Graph, nodes: Iterable[NodeName]) -> tuple[frozenset[str], frozenset[str]]:
    """Return what a host of some nodes may run, and record."""
    nodes = tuple(nodes)
    records = (topic.name for node in nodes for topic in graph.recorded_with(node))
    return frozenset(map(str, nodes)), frozenset(records)


def _doubt_own(state: HostState, own: OwnHost, pid: int | None) -> str:
    if pid is not None and state.pid != pid:
        return f"process {state.pid} speaks for it, but it is process {pid}"
    if strange := [node for node in _besides_recorder(state) if node not in own.nodes]:
        return f"says that it runs {strange[0]}, which it was not given"
    if state.part not in ("", own.part) and not own.remote:
        return f"says that it records in {state.part}, but it was given {own.part or 'no folder'}"
    return _doubt_records(state, own.records)


def _doubt_records(state: HostState, recordable: frozenset[str]) -> str:
    if strange := [topic for topic in state.records if topic not in recordable]:
        return f"says that it records {strange[0]}, which is not for it to record"
    return ""


def _doubt_events(state: HostState) -> str:
    if strange := [event.node for event in state.events if event.node not in state.nodes]:
        return f"says what happened in {strange[0]}, which it does not run"
    for event in state.events:
        if event.kind is EventKind.CHANGE:
            try:
                change_of(event)
            except ValueError as error:
                return f"says that {error}"
    return ""


def _besides_recorder(state: HostState) -> Sequence[str]:
    """Return the nodes of a host that are no helpers of its own."""
    return [node for node in state.nodes if not node.startswith(f"{host_name(state.host)}/")]


def inside(part: str, folder: str) -> bool:
    """Return whether a part lies in a folder, symbolic links followed."""
    return Path(os.path.realpath(folder)) in Path(os.path.realpath(part)).parents
