"""What a node gets to decide its samples: the steppers of each way to keep time.

A node passes what arrives on, publishes what its stepper says, and calls nothing else; a stepper
has no clock of its own: where a way of keeping time needs one it is handed in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

from cacc_platoon.model import Channel
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.scenario.timeline import Change
from cacc_platoon.stepping.lockstep import (
    LockstepFollower,
    LockstepLeader,
    LockstepRelay,
    PublishAcceleration,
    PublishCount,
    PublishState,
)
from cacc_platoon.stepping.recorded import RecordedFollower, ResumedFollower
from cacc_platoon.stepping.wall import (
    BestEffortRelay,
    Clock,
    PublishTiming,
    WallFollower,
    WallLeader,
    WallRelay,
)


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

    def take_count(self, stamp: int, count: float, more: float = 0.0, link: int = 0) -> None:
        """Accept how many messages a link's relay has published up to a sample, and `more`."""
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


Clocked: TypeAlias = WallFollower | WallLeader
"""What takes its samples by a clock."""


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
        self, follower: Follower, publish_state: PublishState, **options: Any
    ) -> FollowerStepper:
        """Return the stepper of a follower in lockstep; see `LockstepFollower`."""
        return LockstepFollower(follower, self.scenario, publish_state, **options)

    def clocked_follower(
        self,
        follower: Follower,
        publish_state: PublishState,
        publish_counts: Sequence[PublishCount],
        publish_timing: PublishTiming,
        *,
        resumed: bool = False,
        **options: Any,
    ) -> WallFollower:
        """Return the stepper of a follower by its clock; see `WallFollower`.

        One that is `resumed` goes by its record first; see `ResumedFollower`.
        """
        follows = ResumedFollower if resumed else WallFollower
        return follows(
            follower,
            self.scenario,
            publish_state,
            clock=self.clock,
            publish_counts=publish_counts,
            publish_timing=publish_timing,
            **options,
        )

    def recorded_follower(
        self, follower: Follower, publish_state: PublishState, **options: Any
    ) -> RecordedFollower:
        """Return the stepper of a follower by recorded timing; see `RecordedFollower`."""
        return RecordedFollower(follower, self.scenario, publish_state, **options)

    def relay(
        self,
        follower: Follower,
        publish: PublishAcceleration,
        publish_count: PublishCount | None = None,
        *,
        channel: Channel | None = None,
    ) -> RelayStepper:
        """Return the stepper of a relay; see `LockstepRelay`, `WallRelay`, `BestEffortRelay`."""
        relay: type[LockstepRelay] = WallRelay if self.scenario.clocked else LockstepRelay
        if follower.v2v.best_effort:
            relay = BestEffortRelay
        return relay(follower, self.scenario, publish, publish_count, channel)

    def leader(self, publish_state: PublishState) -> LockstepLeader | WallLeader:
        """Return the stepper of the leader; see `LockstepLeader` and `WallLeader`."""
        if self.scenario.clocked:
            return WallLeader(self.scenario, publish_state, self.clock)
        return LockstepLeader(self.scenario, publish_state)
