"""What is known of each vehicle, from the last message of each of its topics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

from cacc_platoon.live.picture import VehicleNow
from cacc_platoon.model import ConstantTimeHeadway
from cacc_platoon.model.fallback import ReceptionState
from cacc_platoon.runs.sample_reader import Reading
from cacc_platoon.scenario import Scenario
from msg_adapters.topics import Graph, Topic, VehicleTopics

_STATES = {state.value: state.name.lower() for state in ReceptionState}


class Spacing:
    """The topics of each vehicle, and the spacing that it should keep.

    Parameters
    ----------
    scenario : Scenario
        What is run.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.topics = Graph.of(scenario).vehicles
        self.step = scenario.run.step
        self._scenario = scenario
        self._followers = {follower.index: follower for follower in scenario.followers}
        self._headways = {
            index: moving
            for index, follower in self._followers.items()
            if (moving := follower.headways(scenario.samples)) is not None
        }

    def behind(self, ahead: VehicleNow, own: VehicleNow) -> VehicleNow:
        """Return a vehicle with its gap and spacing error, as far as both are known at a sample."""
        if ahead.position is None or own.position is None or ahead.sample != own.sample:
            return own
        gap = ahead.position - own.position - self._scenario.length_ahead(own.index)
        error = None
        if own.velocity is not None:
            policy = self._policy(own.index, own.sample or 0)
            error = float(policy.spacing_error(own.position, own.velocity, ahead.position))
        return replace(own, gap=gap, spacing_error=error)

    def _policy(self, index: int, sample: int) -> ConstantTimeHeadway:
        policy = self._followers[index].spacing_policy()
        moving = self._headways.get(index)
        return policy if moving is None else policy.with_headway(float(moving[sample]))


def vehicles_now(spacing: Spacing, readings: Mapping[str, Reading]) -> tuple[VehicleNow, ...]:
    """Return what is known of each vehicle, from front to rear.

    Parameters
    ----------
    spacing : Spacing
        The topics and what spacing is wanted.
    readings : mapping of str to Reading
        The last message of each topic, by its name.
    """
    alone = [
        _alone(index, topics, spacing.step, readings) for index, topics in spacing.topics.items()
    ]
    return (*alone[:1], *(spacing.behind(ahead, own) for ahead, own in pairwise(alone)))


def _alone(
    index: int, topics: VehicleTopics, step: float, readings: Mapping[str, Reading]
) -> VehicleNow:
    """Return what is known of a vehicle without regard to the one ahead."""
    pose = readings.get(topics.pose.name)
    if pose is None:
        return VehicleNow(index)

    def at_sample(topic: Topic) -> Reading | None:
        reading = readings.get(topic.name)
        return reading if reading and reading.sample == pose.sample else None

    twist, accel = at_sample(topics.twist), at_sample(topics.accel)
    reception, monitor = at_sample(topics.reception), at_sample(topics.monitor)
    timing, packet = at_sample(topics.timing), readings.get(topics.received.name)
    return VehicleNow(
        index,
        sample=pose.sample,
        position=pose.x,
        velocity=twist.x if twist else None,
        acceleration=accel.x if accel else None,
        received=packet.x if packet else None,
        packet_age=max(0, pose.sample - packet.sample) * step if packet else None,
        reception=_STATES.get(int(reception.x), "") if reception else "",
        alarm=bool(monitor.x) if monitor else None,
        lateness=timing.y if timing else None,
    )
