"""A custom channel, reception and control law, named by a scenario as own_parts:<name>."""

import multiprocessing
from collections.abc import Iterable

from cacc_platoon.model import ComposedChannel, ContentNoise, IndependentLoss, Packets
from cacc_platoon.scenario import Follower


class Jitter:
    """Delays packet p by 0 to 3 samples, so that packets overtake others."""

    prompt = False
    longest_delay = 3

    def apply(self, packets: Packets) -> Packets:
        return packets._replace(delay=packets.delay + (packets.number * 7) % 4)


def late(follower: Follower) -> ComposedChannel:
    loss = IndependentLoss(0.2, follower.seed, follower.index)
    return ComposedChannel([ContentNoise(follower.noise()), loss, Jitter()])


class Cautious:
    """The follower's own law with half of its feed-forward."""

    def __init__(self, follower: Follower) -> None:
        self._law = follower.spacing_policy()

    def command(
        self,
        position: float,
        velocity: float,
        predecessor_position: float,
        predecessor_velocity: float,
        received_acceleration: float,
    ) -> float:
        return self._law.command(
            position,
            velocity,
            predecessor_position,
            predecessor_velocity,
            0.5 * received_acceleration,
        )


class TwoAhead(Cautious):
    """Uses the mean of what it receives, added one by one: sum() rounds otherwise than numpy."""

    def command(self, *inputs: float) -> float:
        x, v, x_ahead, v_ahead, *received = inputs
        total = received[0]
        for value in received[1:]:
            total = total + value
        return self._law.command(x, v, x_ahead, v_ahead, total / len(received))


class Forgetting:
    """Uses the newest packet, and less of it at every sample in which none comes."""

    def __init__(self, follower: Follower) -> None:
        self._value, self._source = 0.0, -1

    def use(self, delivered: Iterable[tuple[int, float]]) -> float:
        self._value *= 0.9
        for source, value in delivered:
            if source > self._source:
                self._source, self._value = source, value
        return self._value


class Halving(Forgetting):
    """Uses half of the newest packet, whether every packet comes or not."""

    def use(self, delivered: Iterable[tuple[int, float]]) -> float:
        return 0.5 * super().use(delivered)


def tried_alone(follower: Follower) -> Cautious:
    """Make a law where it is tried before a run, and fail in the processes of the run."""
    if multiprocessing.parent_process():
        raise SystemExit(3)
    return Cautious(follower)
