"""Names and types of every topic of a platoon, and who publishes and subscribes to which."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from cacc_platoon.model import Link, Topology
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import (
    NodeKind,
    NodeName,
    host_name,
    split_vehicle,
    vehicle_name,
)
from msg_adapters.stamped import ACCEL, POSE, TWIST, VECTOR, Kind, StampedCodec


class Topic(NamedTuple):
    """One topic: its full name, its kind of message and the frame its messages are given in."""

    name: str
    kind: Kind
    frame_id: str

    @property
    def codec(self) -> StampedCodec:
        """The pair that packs and unpacks this topic's messages."""
        return StampedCodec(self.kind, self.frame_id)


class LinkTopics(NamedTuple):
    """What the relay of one link publishes: accelerations, and how many it has published."""

    accel: Topic
    complete: Topic


class VehicleTopics:
    """The topics of vehicle `index` under a platoon's `prefix`.

    Examples
    --------
    >>> VehicleTopics("/platoon", 3).received.name
    '/platoon/vehicle_3/v2v/accel'
    """

    def __init__(self, prefix: str, index: int) -> None:
        self.namespace = f"{prefix}/{vehicle_name(index)}"
        body = _body(index)
        self.pose = Topic(f"{self.namespace}/pose", POSE, "map")
        self.twist = Topic(f"{self.namespace}/twist", TWIST, body)
        self.accel = Topic(f"{self.namespace}/accel", ACCEL, body)
        self._index = index
        self.received, self.complete = self.link(index - 1)
        self.command = Topic(f"{self.namespace}/command", ACCEL, body)
        self.spacing_error = Topic(f"{self.namespace}/spacing_error", VECTOR, body)
        self.reception = Topic(f"{self.namespace}/reception", VECTOR, body)
        self.monitor = Topic(f"{self.namespace}/monitor", VECTOR, body)
        self.timing = Topic(f"{self.namespace}/timing", VECTOR, body)

    @property
    def motion(self) -> tuple[Topic, Topic, Topic]:
        """Pose, twist and accel."""
        return self.pose, self.twist, self.accel

    @property
    def shown(self) -> tuple[Topic, Topic, Topic]:
        """What is published for viewers alone: command, spacing error, state of the reception."""
        return self.command, self.spacing_error, self.reception

    def link(self, sender: int) -> LinkTopics:
        """Return the topics of the link from another vehicle."""
        nearest = sender == self._index - 1
        v2v = f"{self.namespace}/v2v" if nearest else f"{self.namespace}/v2v/from_{sender}"
        return LinkTopics(
            Topic(f"{v2v}/accel", ACCEL, _body(sender)),
            Topic(f"{v2v}/complete", VECTOR, _body(self._index)),
        )


def _body(index: int) -> str:
    return f"{vehicle_name(index)}/base_link"


class PlatoonTopics:
    """The topics and services that belong to a platoon as a whole."""

    def __init__(self, prefix: str) -> None:
        self.prefix = prefix
        self.horizon = f"{prefix}/horizon"
        self.status = f"{prefix}/status"
        self.scenario = f"{prefix}/scenario"
        self.host_state = f"{prefix}/host_state"
        self.events = f"{prefix}/events"
        self.markers = f"{prefix}/markers"
        self.pause = f"{prefix}/pause"
        self.resume = f"{prefix}/resume"
        self.step = f"{prefix}/step"
        self.set_parameters = f"{prefix}/supervisor/set_parameters"
        self.view_request = f"{prefix}/view_request"
        self.view = f"{prefix}/view"

    def recorded(self, host: str) -> str:
        """Return the topic on which the recorder of a host publishes its progress."""
        return f"{self.prefix}/{host_name(host)}/recorded"

    def part(self, host: str) -> str:
        """Return the topic on which a host on another machine gives what it has recorded."""
        return f"{self.prefix}/{host_name(host)}/part"

    def part_wanted(self, host: str) -> str:
        """Return the topic on which the supervisor says how much of that it has [bytes]."""
        return f"{self.prefix}/{host_name(host)}/part_wanted"


class Role(NamedTuple):
    """What a topic means: a quantity of a vehicle.

    Attributes
    ----------
    quantity : str
        "pose", "twist", "accel" or "received".
    vehicle : int
        Its index, 0 for the leader unless it leads a chained run.
    sender : int
        Index of the vehicle that it is received from; -1 where nothing is received.
    """

    quantity: str
    vehicle: int
    sender: int = -1


_RECEIVED = re.compile(r"v2v/(?:from_(?P<sender>0|[1-9]\d{0,8})/)?accel")


def role_of(topic: str) -> tuple[str, Role] | None:
    """Return the prefix and the role of a topic's name; None when it has none in a platoon.

    Examples
    --------
    >>> role_of("/platoon/vehicle_3/v2v/accel")
    ('/platoon', Role(quantity='received', vehicle=3, sender=2))
    """
    found = split_vehicle(topic)
    if found is None:
        return None
    prefix, index, rest = found
    if rest in ("pose", "twist", "accel"):
        return prefix, Role(rest, index)
    received = _RECEIVED.fullmatch(rest)
    if received is None:
        return None
    return prefix, Role("received", index, int(received["sender"] or index - 1))


class NodeTopics(NamedTuple):
    """The data topics of one node."""

    publishes: tuple[Topic, ...]
    subscribes: tuple[Topic, ...]


@dataclass(frozen=True)
class Graph:
    """The nodes of a platoon and the topics between them.

    Attributes
    ----------
    prefix : str
        The platoon's namespace.
    topology : Topology
        Who receives from whom.
    counted : frozenset of int
        Followers whose packets are counted, because they may be lost or late.
    command, spacing_error : bool
        Whether vehicles publish these too.
    triggered : frozenset of int
        Followers whose relay follows the motion of the senders too, which send as they move.
    fallback : frozenset of int
        Followers that fall back without V2V, and publish the state of their reception.
    monitored : frozenset of int
        Followers that compare what they receive with what they measure, and publish what they find.
    clocked : bool
        Whether vehicles keep time by clocks. Then they count their packets themselves, since nobody
        else knows what has arrived by a sample, and publish the timing of every sample.

    Examples
    --------
    >>> graph = Graph.of(Scenario.from_values({"platoon.followers": 1}))
    >>> [topic.name for topic in graph.nodes[NodeName(NodeKind.NOISE_RELAY, 1)].publishes]
    ['/platoon/vehicle_1/v2v/accel']
    """

    prefix: str
    topology: Topology
    counted: frozenset[int] = frozenset()
    command: bool = False
    spacing_error: bool = False
    triggered: frozenset[int] = frozenset()
    fallback: frozenset[int] = frozenset()
    monitored: frozenset[int] = frozenset()
    clocked: bool = False

    @classmethod
    def of(cls, scenario: Scenario) -> Graph:
        """Return the graph of a scenario."""
        record, followers = scenario.record, scenario.followers
        return cls(
            scenario.platoon.namespace,
            scenario.topology,
            frozenset(one.index for one in followers if one.counted),
            record.command,
            record.spacing_error,
            frozenset(one.index for one in followers if one.triggered),
            frozenset(one.index for one in followers if one.fallback_law()),
            frozenset(one.index for one in followers if one.monitored),
            scenario.clocked,
        )

    @cached_property
    def vehicles(self) -> Mapping[int, VehicleTopics]:
        """The topics of each vehicle, the leader's first."""
        followers = self.topology.followers
        indices = range(followers.start - 1, followers.stop)
        return {index: VehicleTopics(self.prefix, index) for index in indices}

    @cached_property
    def links(self) -> Mapping[Link, LinkTopics]:
        """The topics of every link, in the order of the topology."""
        return {
            link: self.vehicles[link.receiver].link(link.sender) for link in self.topology.links
        }

    @cached_property
    def counted_links(self) -> Mapping[Link, LinkTopics]:
        """The topics of the links whose relay counts its messages."""
        return {
            link: topics for link, topics in self.links.items() if link.receiver in self.counted
        }

    @cached_property
    def platoon(self) -> PlatoonTopics:
        """The topics of the platoon as a whole."""
        return PlatoonTopics(self.prefix)

    @cached_property
    def nodes(self) -> Mapping[NodeName, NodeTopics]:
        """The data topics of every node, from front to rear."""
        leader = self.topology.followers.start - 1
        found = {NodeName(NodeKind.LEADER, leader): NodeTopics(self.vehicles[leader].motion, ())}
        for index in self.topology.followers:
            found[NodeName(NodeKind.VEHICLE, index)] = self._vehicle(index)
            found[NodeName(NodeKind.NOISE_RELAY, index)] = self._relay(index)
        return found

    @cached_property
    def roles(self) -> Mapping[Role, Topic]:
        """The topics that make up a run, and its digest: motion of all, v2v/accel of followers."""
        roles: dict[Role, Topic] = {}
        for index, vehicle in self.vehicles.items():
            for quantity, topic in zip(("pose", "twist", "accel"), vehicle.motion, strict=True):
                roles[Role(quantity, index)] = topic
            for link in self._links_to(index):
                roles[Role("received", index, link.sender)] = self.links[link].accel
        return roles

    @property
    def run_topics(self) -> list[Topic]:
        """The topics that make up a run; by clocks, when samples were taken too."""
        timing = [self.vehicles[index].timing for index in self.topology.followers]
        return [*self.roles.values(), *(timing if self.clocked else [])]

    @property
    def recorded(self) -> list[Topic]:
        """Every topic that the bag of a run has to hold."""
        return [topic for node in self.nodes.values() for topic in node.publishes]

    @cached_property
    def followers(self) -> Mapping[str, int]:
        """How many nodes of the platoon follow each data topic."""
        return Counter(topic.name for node in self.nodes.values() for topic in node.subscribes)

    def recorded_with(self, node: NodeName) -> tuple[Topic, ...]:
        """Return the topics that the host of a node records.

        They are what it publishes; only what is received stays with its counts.
        """
        publishes = self.nodes[node].publishes
        if self.clocked and node.kind is NodeKind.NOISE_RELAY:
            return ()
        if self.clocked and node.kind is NodeKind.VEHICLE:
            return (*publishes, *self._received(node.vehicle))
        return publishes

    def replayed(self, node: NodeName) -> NodeTopics:
        """Return the topics on which a replay of a node gives and takes.

        A vehicle that kept time by a clock is given when it took its samples, and what it had then.
        """
        topics = self.nodes[node]
        if not (self.clocked and node.kind is NodeKind.VEHICLE):
            return topics
        links = (self.links[link] for link in self._links_to(node.vehicle))
        given = {self.vehicles[node.vehicle].timing, *(link.complete for link in links)}
        return NodeTopics(
            tuple(topic for topic in topics.publishes if topic not in given),
            (*topics.subscribes, *(topic for topic in topics.publishes if topic in given)),
        )

    def _vehicle(self, index: int) -> NodeTopics:
        own, ahead = self.vehicles[index], self.vehicles[index - 1]
        asked = (
            (self.command, own.command),
            (self.spacing_error, own.spacing_error),
            (index in self.fallback, own.reception),
            (index in self.monitored, own.monitor),
            (self.clocked, own.timing),
        )
        publishes = (*own.motion, *(topic for wanted, topic in asked if wanted))
        if self.clocked:
            publishes += tuple(self.links[link].complete for link in self._links_to(index))
        return NodeTopics(publishes, (ahead.pose, ahead.twist, *self._received(index)))

    def _relay(self, index: int) -> NodeTopics:
        senders = [self.vehicles[link.sender] for link in self._links_to(index)]
        if index in self.triggered:
            heard = tuple(t for one in senders for t in (one.accel, one.pose, one.twist))
        else:
            heard = tuple(one.accel for one in senders)
        return NodeTopics(self._received(index), heard)

    def _links_to(self, index: int) -> tuple[Link, ...]:
        return self.topology.links_to(index) if index in self.topology.followers else ()

    def _received(self, index: int) -> tuple[Topic, ...]:
        """Return what the relay of a follower publishes."""
        counts = index in self.counted and not self.clocked
        topics = (self.links[link] for link in self._links_to(index))
        return tuple(topic for link in topics for topic in (link if counts else link[:1]))


def is_packets(topic: str) -> bool:
    """Return whether a topic has what a relay hands on: packets, and not every sample.

    Examples
    --------
    >>> is_packets("/platoon/vehicle_3/v2v/accel"), is_packets("/platoon/vehicle_3/v2v/complete")
    (True, False)
    """
    role = role_of(topic)
    return role is not None and role[1].quantity == "received"


def is_count(topic: str) -> bool:
    """Return whether a topic says how many packets there were up to each sample.

    Examples
    --------
    >>> is_count("/platoon/vehicle_3/v2v/complete"), is_count("/platoon/vehicle_3/pose")
    (True, False)
    """
    return topic.endswith("/complete")


OUTSIDE_LAG = 500
"""Samples that a subscriber outside of the platoon, whom nobody waits for, may lag without loss."""


LONGEST_PAUSE = 60.0
"""For so long a node by a clock may be deaf without losing a message [s]."""


def queue_depth(scenario: Scenario) -> int:
    """Return the depth of every queue: deeper than anything that piles up.

    In lockstep the leader is at most run.window samples ahead of the last complete sample, and a
    follower may lag the leader by one sample a vehicle more.
    """
    run = scenario.run
    depth = 2 * run.window + scenario.platoon.followers + OUTSIDE_LAG
    if not scenario.clocked:
        return depth
    pause = math.ceil(LONGEST_PAUSE / run.clock_period)
    return max(depth, min(scenario.samples, pause))
