"""Names and types of every topic of a platoon; the one place where they are written."""

from __future__ import annotations

from typing import NamedTuple

from cacc_platoon.scenario import Scenario
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


class VehicleTopics:
    """The topics of vehicle `index` (0 is the leader) under a platoon's `prefix`.

    Examples
    --------
    >>> VehicleTopics("/platoon", 3).received.name
    '/platoon/vehicle_3/v2v/accel'
    """

    def __init__(self, prefix: str, index: int) -> None:
        self.namespace = f"{prefix}/vehicle_{index}"
        body = f"vehicle_{index}/base_link"
        self.pose = Topic(f"{self.namespace}/pose", POSE, "map")
        self.twist = Topic(f"{self.namespace}/twist", TWIST, body)
        self.accel = Topic(f"{self.namespace}/accel", ACCEL, body)
        self.received = Topic(
            f"{self.namespace}/v2v/accel", ACCEL, f"vehicle_{index - 1}/base_link"
        )
        self.complete = f"{self.namespace}/v2v/complete"
        self.command = Topic(f"{self.namespace}/command", ACCEL, body)
        self.spacing_error = Topic(f"{self.namespace}/spacing_error", VECTOR, body)


class PlatoonTopics:
    """The topics that belong to a platoon as a whole."""

    def __init__(self, prefix: str) -> None:
        self.horizon = f"{prefix}/horizon"
        self.status = f"{prefix}/status"
        self.scenario = f"{prefix}/scenario"
        self.host_state = f"{prefix}/host_state"


def digest_topics(prefix: str, followers: int, first: int = 1) -> list[Topic]:
    """Return the topics that make up a run: pose, twist and accel of all, v2v/accel of followers.

    `first` is the index of the first follower; the leader has the one before.
    """
    topics: list[Topic] = []
    for index in range(first - 1, first + followers):
        vehicle = VehicleTopics(prefix, index)
        topics += [vehicle.pose, vehicle.twist, vehicle.accel]
        if index >= first:
            topics.append(vehicle.received)
    return topics


def run_topics(scenario: Scenario) -> list[Topic]:
    """Return the topics that make up a run of the scenario."""
    platoon = scenario.platoon
    return digest_topics(platoon.namespace, platoon.followers, platoon.first_follower)


OUTSIDE_LAG = 500
"""Samples that a subscriber outside of the platoon, whom nobody waits for, may lag without loss."""


def queue_depth(window: int, followers: int) -> int:
    """Return the depth of every queue: deeper than anything the lockstep window lets pile up.

    The leader is at most `window` samples ahead of the last complete sample, and a follower may
    lag the leader by one sample a vehicle more.
    """
    return 2 * window + followers + OUTSIDE_LAG
