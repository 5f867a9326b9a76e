"""Which platoons a bag holds: namespaces and vehicles, found from the names of its topics."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

from cacc_platoon.bags.raw import RawTopic
from msg_adapters.topics import Topic, VehicleTopics

_VEHICLE_TOPIC = re.compile(r"(.*)/vehicle_(\d{1,4})/(?:pose|twist|accel|v2v/accel)")
MAX_FOLLOWERS = 500


class Role(NamedTuple):
    """What a topic means: a quantity of a vehicle.

    Attributes
    ----------
    quantity : str
        "pose", "twist", "accel" or "received".
    vehicle : int
        Its index, 0 for the leader unless it leads a chained run.
    """

    quantity: str
    vehicle: int


class FoundPlatoon(NamedTuple):
    """A platoon seen in a bag.

    Attributes
    ----------
    prefix : str
        Its namespace.
    vehicles : tuple of int
        Indices that have at least one topic.
    messages : int
        Messages on their topics.
    """

    prefix: str
    vehicles: tuple[int, ...]
    messages: int


def find_platoons(topics: Mapping[str, list[RawTopic]]) -> list[FoundPlatoon]:
    """Return the platoons of a bag, the one with the most messages first."""
    vehicles: dict[str, set[int]] = {}
    messages: dict[str, int] = {}
    for name, parts in topics.items():
        match = _VEHICLE_TOPIC.fullmatch(name)
        if match and int(match[2]) <= MAX_FOLLOWERS:
            vehicles.setdefault(match[1], set()).add(int(match[2]))
            count = sum(len(part.lengths) for part in parts)
            messages[match[1]] = messages.get(match[1], 0) + count
    found = [
        FoundPlatoon(prefix, tuple(sorted(indices)), messages[prefix])
        for prefix, indices in vehicles.items()
    ]
    return sorted(found, key=lambda platoon: (-platoon.messages, platoon.prefix))


def expected_topics(prefix: str, followers: range) -> dict[Role, Topic]:
    """Return the topics that make up a run of some followers, by what they mean."""
    topics: dict[Role, Topic] = {}
    for index in range(followers[0] - 1, followers.stop):
        vehicle = VehicleTopics(prefix, index)
        topics[Role("pose", index)] = vehicle.pose
        topics[Role("twist", index)] = vehicle.twist
        topics[Role("accel", index)] = vehicle.accel
        if index in followers:
            topics[Role("received", index)] = vehicle.received
    return topics
