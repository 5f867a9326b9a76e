"""What a node gets to decide its samples; the one place that chooses how a run keeps time.

A node passes what arrives on, publishes what its stepper says, and calls nothing else; a stepper
has no clock of its own: where a way of keeping time needs one it is handed in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from cacc_platoon.model import Channel, ControlLaw, State
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.scenario.timeline import Change
from cacc_platoon.stepping.lockstep import (
    LockstepFollower,
    LockstepLeader,
    LockstepRelay,
    PublishAcceleration,
    PublishCommand,
    PublishCount,
    PublishMonitor,
    PublishReception,
    PublishState,
    Tell,
)

Clock = Callable[[], int]
"""The time now [ns], never decreasing."""


class Changing(Protocol):
    """What may take changes that are not planned."""

    @property
    def next_sample(self) -> int:
        """The sample from which on a change can take effect."""
        ...

    def change(self, change: Change) -> None:
        """Take a change."""
        ...


class FollowerStepper(Changing, Protocol):
    """A follower: takes what it receives, in any order, and publishes its samples."""

    def take_position(self, stamp: int, position: float) -> None:
        """Accept the predecessor's position [m] of a stamp [ns]."""
        ...

    def take_velocity(self, stamp: int, velocity: float) -> None:
        """Accept the predecessor's velocity [m/s]."""
        ...

    def take_acceleration(self, stamp: int, acceleration: float, link: int = 0) -> None:
        """Accept an acceleration [m/s^2] with the stamp of its source, from a link's sender.

        Links are numbered from that to the predecessor on.
        """
        ...

    def take_count(self, stamp: int, count: float, link: int = 0) -> None:
        """Accept how many messages a link's relay has published up to a sample."""
        ...


class RelayStepper(Changing, Protocol):
    """The channel of one link: takes what is sent and publishes what is delivered."""

    def take(self, stamp: int, acceleration: float) -> None:
        """Accept the predecessor's acceleration [m/s^2]."""
        ...

    def take_position(self, stamp: int, position: float) -> None:
        """Accept the predecessor's position [m], where it sends as it moves."""
        ...

    def take_velocity(self, stamp: int, velocity: float) -> None:
        """Accept the predecessor's velocity [m/s], where it sends as it moves."""
        ...


class LeaderStepper(Protocol):
    """Vehicle 0: publishes its motion as far as it may."""

    def take_horizon(self, horizon: int) -> None:
        """Accept the last sample that may be published."""
        ...


@dataclass(frozen=True)
class Steppers:
    """The steppers of one scenario.

    Attributes
    ----------
    scenario : Scenario
        The run.
    clock : Clock
        Handed to what keeps time by a clock; lockstep follows data alone.
    """

    scenario: Scenario
    clock: Clock

    def follower(
        self,
        follower: Follower,
        publish_state: PublishState,
        publish_command: PublishCommand | None = None,
        *,
        publish_reception: PublishReception | None = None,
        publish_monitor: PublishMonitor | None = None,
        tell: Tell | None = None,
        law: ControlLaw | None = None,
        initial: State[float] | None = None,
    ) -> FollowerStepper:
        """Return the stepper of a follower; see `LockstepFollower`."""
        return LockstepFollower(
            follower,
            self.scenario,
            publish_state,
            publish_command,
            law,
            publish_reception=publish_reception,
            publish_monitor=publish_monitor,
            tell=tell,
            initial=initial,
        )

    def relay(
        self,
        follower: Follower,
        publish: PublishAcceleration,
        publish_count: PublishCount | None = None,
        *,
        channel: Channel | None = None,
    ) -> RelayStepper:
        """Return the stepper of a relay; see `LockstepRelay`."""
        return LockstepRelay(follower, self.scenario, publish, publish_count, channel)

    def leader(self, publish_state: PublishState) -> LeaderStepper:
        """Return the stepper of the leader; see `LockstepLeader`."""
        return LockstepLeader(self.scenario, publish_state)
