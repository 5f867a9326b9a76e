"""By clocks without ROS: what a follower and a leader do at each of their sample times.

Every vehicle has a clock of its own, which is behind the common start by a phase. When it shows
k T the vehicle takes its sample k, with what has arrived by then: the newest pose of the
predecessor, carried forward over its age, and the packets that came. A sample that comes a control
period late, or more, keeps the command before it; so the plant goes on as one whose computer was
busy, and every sample is there. What was used at each sample is published, so that a recorded run
can be worked out again to the last bit.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from cacc_platoon.model import LeaderProfile, State
from cacc_platoon.model.keyed_random import CLOCK, keyed_uniform
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.scenario.names import NodeKind, NodeName
from cacc_platoon.scenario.run_event import MOST_TURNS, NOTICED, EventKind, RunEvent
from cacc_platoon.stepping.deliveries import LockstepError, doubtful_from, seconds
from cacc_platoon.stepping.lockstep import (
    LockstepFollower,
    LockstepRelay,
    PublishCount,
    PublishState,
)
from cacc_platoon.stepping.turns import Tell

Clock = Callable[[], int]
"""The time now [ns], never decreasing."""

PublishTiming = Callable[[int, float, float], None]

CLOCK_MARGIN = 1.0
"""How far the clocks of a platoon may be apart [s]."""

_EARLY = 0.05
"""Share of a control period by which a sample may be taken early: timers are not exact."""


class VehicleClock:
    """When the samples of a vehicle are due.

    Parameters
    ----------
    scenario : Scenario
        The run; its real_time_factor is the pace, 1 unless it is given.
    vehicle : int
        Whose clock it is.
    clock : callable
        The time now [ns].

    Attributes
    ----------
    period : int
        Wall time from sample to sample [ns].
    phase : int
        How far this clock is behind the common start [ns].
    """

    def __init__(self, scenario: Scenario, vehicle: int, clock: Clock) -> None:
        self.period = round(scenario.run.clock_period * 1e9)
        self.phase = int(_share_of_period(scenario, vehicle) * self.period)
        self._clock, self._first = clock, 0

    def begin(self, start: int) -> None:
        """Let sample 0 of a vehicle without phase be due at a time [ns]."""
        self._first = start + self.phase

    def lateness(self, sample: int) -> float:
        """Return how long ago a sample was due, in control periods; negative before."""
        return (self._clock() - self._first) / self.period - sample

    def is_beyond(self, sample: int) -> bool:
        """Return whether no clock that agrees with this one can show a sample by now."""
        return self.lateness(sample) * self.period < -CLOCK_MARGIN * 1e9

    def until(self, sample: int) -> int:
        """Return how long to wait for a sample [ns].

        That is until it is due, or a tenth of a period where it is and cannot be taken yet.
        """
        return max(self._first + sample * self.period - self._clock(), self.period // 10)


def _share_of_period(scenario: Scenario, vehicle: int) -> float:
    """Return the phase of a vehicle's clock [control periods], below 1."""
    match scenario.run.phases:
        case "spread":
            return (vehicle - scenario.leader_index) / len(scenario.vehicles)
        case "random":
            return float(keyed_uniform(scenario.run.seed, vehicle, CLOCK)(0, 1)[0])
        case other:
            raise ValueError(f"run.phases = {other} has no branch here")


class LateSamples:
    """Says which samples are late, and tells of those that are so for long.

    Parameters
    ----------
    step : float
        Control period [s].
    node : str
        Whose they are.
    tell : callable
        Called with each time of `NOTICED` or more, once it is over; of many, the first ones.

    Examples
    --------
    >>> late = LateSamples(0.1, "vehicle_1/vehicle", lambda event: print(*event))
    >>> [late.take(sample, lateness) for sample, lateness in enumerate((0.1, 2.3, 1.3, 0.3))]
    late 1 vehicle_1/vehicle 2 samples, by up to 2.3 periods
    [False, True, True, False]
    """

    def __init__(self, step: float, node: str, tell: Tell) -> None:
        self._enough, self._node, self._tell = max(1, round(NOTICED / step)), node, tell
        self._left, self._samples, self._latest = MOST_TURNS, 0, 0.0

    def take(self, sample: int, lateness: float) -> bool:
        """Return whether a sample comes a control period late, or more."""
        if lateness >= 1.0:
            self._samples += 1
            self._latest = max(self._latest, lateness)
            return True
        if self._samples >= self._enough and self._left:
            first = sample - self._samples
            self._tell(RunEvent.late(first, self._samples, self._latest, self._node))
            self._left -= 1
        self._samples, self._latest = 0, 0.0
        return False


class WallFollower(LockstepFollower):
    """One follower by its clock; see `LockstepFollower` for what it has in common with it.

    Parameters
    ----------
    follower, scenario, publish_state
        As there; a state is published when it is due.
    clock : callable
        The time now [ns].
    publish_counts : sequence of callable
        One for each link: called with stamp [ns], the number of packets that were used of it so
        far, and 0, since nobody knows what comes, for every sample.
    publish_timing : callable
        Called with stamp [ns], age of the predecessor's pose that was used and lateness of the
        sample [control periods], for every sample.
    options
        As there.
    """

    def __init__(
        self,
        follower: Follower,
        scenario: Scenario,
        publish_state: PublishState,
        *,
        clock: Clock,
        publish_counts: Sequence[PublishCount],
        publish_timing: PublishTiming,
        **options: Any,
    ) -> None:
        super().__init__(follower, scenario, self._keep, **options)
        self.clock = VehicleClock(scenario, follower.index, clock)
        self._step_s = scenario.run.step
        self._publish, self._publish_timing = publish_state, publish_timing
        self._publish_counts = publish_counts
        self._waiting: list[deque[tuple[int, float]]] = [deque() for _ in self._inboxes]
        self._used = [0] * len(self._inboxes)
        self._oldest = 0  # the sample of the first of the predecessor's motion that is kept
        self._late = False
        node = str(NodeName(NodeKind.VEHICLE, follower.index))
        self._lateness = LateSamples(scenario.run.step, node, self._tell)
        self._command_before = 0.0
        self._length, self._length_ahead = self._length_ahead, -math.inf  # it goes on
        self._node = node

    def take_position(self, stamp: int, position: float) -> None:
        """Accept the predecessor's position [m], which may come twice where that starts again."""
        if stamp >= self._position_sequence.due:
            super().take_position(stamp, position)

    def take_velocity(self, stamp: int, velocity: float) -> None:
        """Accept the predecessor's velocity [m/s], as its position."""
        if stamp >= self._velocity_sequence.due:
            super().take_velocity(stamp, velocity)

    def take_acceleration(self, stamp: int, acceleration: float, link: int = 0) -> None:
        """Accept an acceleration [m/s^2] received over one of its links."""
        sample, off = divmod(stamp, self._step_ns)
        early = sample > 0 and self.clock.is_beyond(sample)  # the first one comes before the start
        if off or early or not 0 <= stamp <= self._end:
            raise LockstepError(
                f"{self._name}: v2v/accel is stamped {seconds(stamp)}, which is no sample that "
                "anybody can have taken: it comes from another publisher; "
                f"{doubtful_from(self._stamp // self._step_ns)}"
            )
        self._waiting[link].append((stamp, acceleration))

    def begin(self, start: int) -> None:
        """Let the clock begin at a time [ns]."""
        self.clock.begin(start)

    @property
    def wait(self) -> int | None:
        """How long to wait for the next sample [ns]; None after the last one."""
        over = self._stamp > self._end
        return None if over else self.clock.until(self._stamp // self._step_ns)

    def tick(self) -> None:
        """Take every sample that is due."""
        while self._velocities and self._positions and self._stamp <= self._end:
            sample = self._stamp // self._step_ns
            lateness = self.clock.lateness(sample)
            if lateness < -_EARLY:
                return
            self._take_sample(sample, lateness)

    def _advance(self) -> None:
        """Wait for the clock, whatever has arrived."""

    def _keep(self, stamp: int, state: State[float]) -> None:
        """Publish the first state at once: the vehicle behind begins from it."""
        if stamp == 0:
            self._publish(stamp, state)

    def _take_sample(self, sample: int, lateness: float) -> None:
        stamp, state = self._stamp, self._state
        assert state is not None
        if sample:
            self._publish(stamp, state)
        self._late = self._lateness.take(sample, lateness)
        for number, inbox in enumerate(self._inboxes):
            for _ in range(self._usable(number)):
                inbox.take(*self._waiting[number].popleft())
                self._used[number] += 1
            inbox.count(stamp, self._used[number], stamp)
            self._publish_counts[number](stamp, self._used[number], 0)
        age = self._pose_age(sample)
        while self._oldest < sample - age:
            self._positions.popleft()
            self._velocities.popleft()
            self._oldest += 1
        self._publish_timing(stamp, float(age), lateness)
        velocity = self._velocities[0]
        position = self._positions[0] + velocity * (age * self._step_s)
        if position - state.position <= self._length:
            self._length = -math.inf
            self._tell(RunEvent(EventKind.COLLISION, sample, self._node))
        self._step(position, velocity)

    @property
    def _newest(self) -> int:
        """The newest sample of the predecessor's motion that is here."""
        return self._oldest + min(len(self._positions), len(self._velocities)) - 1

    def _usable(self, link: int) -> int:
        """Return how many of the packets that wait may be used; a late sample uses none."""
        if self._late:
            return 0
        sent = itertools.takewhile(lambda packet: packet[0] <= self._stamp, self._waiting[link])
        return sum(1 for _ in sent)

    def _pose_age(self, sample: int) -> int:
        """Return how many samples old the newest motion is that was stamped by a sample."""
        return max(0, sample - self._newest)

    def _decide(
        self,
        stamp: int,
        motion: tuple[float, float, float, float],
        received: tuple[float, ...],
        share: float,
    ) -> float:
        """Return the command, that of the sample before where this one is late."""
        if not self._late:
            self._command_before = super()._decide(stamp, motion, received, share)
        return self._command_before


class WallRelay(LockstepRelay):
    """A relay by clocks: a sender that was started again may say twice what it said last."""

    def take(self, stamp: int, acceleration: float) -> None:
        """Accept the predecessor's acceleration [m/s^2] and deliver what is due."""
        if stamp >= self._inputs[0].due:
            super().take(stamp, acceleration)

    def take_position(self, stamp: int, position: float) -> None:
        """Accept the predecessor's position [m], where it sends as it moves."""
        if stamp >= self._inputs[1].due:
            super().take_position(stamp, position)

    def take_velocity(self, stamp: int, velocity: float) -> None:
        """Accept the predecessor's velocity [m/s], where it sends as it moves."""
        if stamp >= self._inputs[2].due:
            super().take_velocity(stamp, velocity)


class BestEffortRelay(WallRelay):
    """A relay that DDS may lose messages to, which then are lost packets; see `WallRelay`."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        publish, self._end = self._publish, (self._samples - 1) * self._step_ns

        def publish_what_came(stamp: int, acceleration: float) -> None:
            if not math.isnan(acceleration):
                publish(stamp, acceleration)

        self._publish = publish_what_came

    def take(self, stamp: int, acceleration: float) -> None:
        """Accept the predecessor's acceleration [m/s^2] and deliver what is due."""
        while self._inputs[0].due < stamp <= self._end:
            super().take(self._inputs[0].due, math.nan)
        super().take(stamp, acceleration)


class WallLeader:
    """Vehicle 0 by its clock: follows its profile."""

    def __init__(self, scenario: Scenario, publish_state: PublishState, clock: Clock) -> None:
        self._profile: LeaderProfile = scenario.leader_profile()
        self._step, self._step_ns = scenario.run.step, scenario.step_ns
        self._samples, self._publish_state = scenario.samples, publish_state
        self._sample = 0
        self.clock = VehicleClock(scenario, scenario.leader_index, clock)

    def begin(self, start: int) -> None:
        """Let the clock begin at a time [ns], and say where the platoon begins."""
        self.clock.begin(start)
        self._publish()

    @property
    def wait(self) -> int | None:
        """How long to wait for the next sample [ns]; None after the last one."""
        return None if self._sample == self._samples else self.clock.until(self._sample)

    def tick(self) -> None:
        """Publish every sample that is due."""
        while self._sample < self._samples and self.clock.lateness(self._sample) >= -_EARLY:
            self._publish()

    def _publish(self) -> None:
        k = self._sample
        self._publish_state(k * self._step_ns, self._profile.at(k * self._step))
        self._sample = k + 1
