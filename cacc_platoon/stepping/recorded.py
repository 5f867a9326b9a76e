"""Followers that go by the recorded timing of their samples, for good or until they go on live."""

from __future__ import annotations

from collections import deque
from typing import Any

from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.stepping.deliveries import LockstepError
from cacc_platoon.stepping.lockstep import PublishState
from cacc_platoon.stepping.wall import WallFollower


class RecordedFollower(WallFollower):
    """A follower by the recorded timing of its samples in place of a clock; see `WallFollower`."""

    def __init__(
        self, follower: Follower, scenario: Scenario, publish_state: PublishState, **options: Any
    ) -> None:
        links = scenario.topology.links_to(follower.index)
        super().__init__(
            follower,
            scenario,
            publish_state,
            **{
                "clock": lambda: 0,
                "publish_counts": [lambda stamp, count, more: None for _ in links],
                "publish_timing": lambda stamp, age, lateness: None,
                **options,
            },
        )
        self._recorded: deque[tuple[int, float]] = deque()
        self._totals: list[deque[int]] = [deque() for _ in links]

    def take_acceleration(self, stamp: int, acceleration: float, link: int = 0) -> None:
        """Accept an acceleration [m/s^2] received over one of its links."""
        self._waiting[link].append((stamp, acceleration))
        self._advance()

    def take_count(self, stamp: int, count: float, more: float = 0.0, link: int = 0) -> None:
        """Accept how many packets of a link had been used by the next sample."""
        self._totals[link].append(int(count))
        self._advance()

    def take_timing(self, stamp: int, age: float, lateness: float) -> None:
        """Accept age of the pose and lateness of the next sample [control periods]."""
        self._recorded.append((int(age), lateness))
        self._advance()

    def _advance(self) -> None:
        """Take every sample of which all is here that it used."""
        while self._recorded and all(self._totals) and self._velocities and self._positions:
            sample, (age, lateness) = self._stamp // self._step_ns, self._recorded[0]
            lacking = any(self._usable(n) > len(packets) for n, packets in enumerate(self._waiting))
            if lacking or self._newest < sample - age:
                return
            self._take_sample(sample, lateness)
            self._recorded.popleft()
            for totals in self._totals:
                totals.popleft()

    def _usable(self, link: int) -> int:
        return self._totals[link][0] - self._used[link]

    def _pose_age(self, sample: int) -> int:
        return self._recorded[0][0]


class ResumedFollower(RecordedFollower):
    """A follower whose process was started again: by the record so far, then by its clock.

    Its options are those of `WallFollower`. What it works out from the record is what it has
    published before, to the last bit.
    """

    _live = False

    def begin(self, start: int) -> None:
        """Go on by the clock, as one that has stood still since the last recorded sample."""
        if self._recorded:
            sample = self._stamp // self._step_ns
            raise LockstepError(
                f"{self._name}: what it used at sample {sample} is not recorded, so it cannot go on"
            )
        self._live = True
        super().begin(start)

    def take_acceleration(self, stamp: int, acceleration: float, link: int = 0) -> None:
        """Accept an acceleration [m/s^2] received over one of its links."""
        accept = WallFollower if self._live else RecordedFollower
        accept.take_acceleration(self, stamp, acceleration, link)

    def _advance(self) -> None:
        if not self._live:
            super()._advance()

    def _usable(self, link: int) -> int:
        source = WallFollower if self._live else RecordedFollower
        return source._usable(self, link)

    def _pose_age(self, sample: int) -> int:
        source = WallFollower if self._live else RecordedFollower
        return source._pose_age(self, sample)
