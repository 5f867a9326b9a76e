"""Vehicles by clocks, without ROS: clocks that a test moves, and messages that take their time."""

from __future__ import annotations

import heapq
import itertools
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pytest

from cacc_platoon.analysis.consistency import check_consistency
from cacc_platoon.model import State
from cacc_platoon.runs.events import events_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.run_event import MOST_TURNS, EventKind, RunEvent
from cacc_platoon.simulation import Arrivals, Trajectory, simulate
from cacc_platoon.simulation.bodies import measured_velocities
from cacc_platoon.simulation.timing import Timing
from cacc_platoon.simulation.trajectory import law_shares
from cacc_platoon.stepping.deliveries import LockstepError
from cacc_platoon.stepping.lockstep import LockstepRelay
from cacc_platoon.stepping.recorded import RecordedFollower
from cacc_platoon.stepping.wall import (
    BestEffortRelay,
    LateSamples,
    VehicleClock,
    WallFollower,
    WallLeader,
)

MS = 1_000_000
START = 5_000 * MS
SHORT = {
    "platoon.followers": 3,
    "run.duration": 4.0,
    "run.sync": "wall",
    "leader.start": 0.5,
    "leader.amplitude": 2.0,
    "leader.angular_frequency": 3.0,
}


class World:
    """A platoon by clocks: what happens when, in order.

    Parameters
    ----------
    scenario : Scenario
        The platoon.
    travel : callable
        How long the next message takes [ns].
    busy : callable
        How long the computer of a vehicle is busy before it can look at its clock [ns], given the
        vehicle and the time.
    """

    def __init__(
        self,
        scenario: Scenario,
        travel: Callable[[], int] = lambda: MS // 10,
        busy: Callable[[int, int], int] = lambda vehicle, now: 0,
        tell: Callable[[RunEvent], None] = lambda event: None,
    ) -> None:
        self.scenario, self.now, self._tell = scenario, 0, tell
        self._travel, self._busy = travel, busy
        self._order = itertools.count()
        self._due: list[tuple[int, int, Callable[[], None]]] = []
        self._last: dict[Any, int] = {}
        self.states: dict[int, list[State[float]]] = {i: [] for i in scenario.vehicles}
        self.published: dict[int, list[int]] = {i: [] for i in scenario.vehicles}
        self.counts: dict[int, list[int]] = {i: [] for i in scenario.indices}
        self.timing: dict[int, list[tuple[float, float]]] = {i: [] for i in scenario.indices}
        self.packets: dict[int, list[tuple[int, float]]] = {i: [] for i in scenario.indices}
        self.relays: dict[int, LockstepRelay] = {}
        self.leader = WallLeader(scenario, self._publisher(scenario.leader_index), lambda: self.now)
        self.followers = {index: self._follower(index) for index in scenario.indices}

    def later(self, delay: int, what: Callable[[], None], wire: object = None) -> None:
        """Let something happen after a time; what goes over one wire stays in order."""
        at = max(self.now + delay, self._last.get(wire, 0) if wire else 0)
        if wire:
            self._last[wire] = at
        heapq.heappush(self._due, (at, next(self._order), what))

    def run(self) -> Trajectory:
        """Let all happen, and return what a bag of it would say."""
        vehicles: list[WallLeader | WallFollower] = [self.leader, *self.followers.values()]
        for vehicle, index in zip(vehicles, self.scenario.vehicles, strict=True):
            vehicle.begin(START)
            self._wait(vehicle, index)
        while self._due:
            self.now, _, happens = heapq.heappop(self._due)
            happens()
        return self._trajectory()

    def _wait(self, vehicle: WallLeader | WallFollower, index: int) -> None:
        if (wait := vehicle.wait) is not None:
            busy = self._busy(index, self.now + wait)
            self.later(wait + busy, lambda: self._tick(vehicle, index))

    def _tick(self, vehicle: WallLeader | WallFollower, index: int) -> None:
        vehicle.tick()
        self._wait(vehicle, index)

    def _follower(self, index: int) -> WallFollower:
        follower = self.scenario.follower(index)

        def receive(stamp: int, value: float) -> None:
            self.packets[index].append((stamp, value))
            made.take_acceleration(stamp, value)

        def deliver(stamp: int, value: float) -> None:
            self.later(self._travel(), lambda: receive(stamp, value), (index, "v2v"))

        self.relays[index] = LockstepRelay(follower, self.scenario, deliver)
        made = WallFollower(
            follower,
            self.scenario,
            self._publisher(index),
            clock=lambda: self.now,
            publish_counts=[lambda stamp, count, more: self.counts[index].append(count)],
            publish_timing=lambda stamp, age, late: self.timing[index].append((age, late)),
            tell=self._tell,
        )
        return made

    def _publisher(self, index: int) -> Callable[[int, State[float]], None]:
        def publish(stamp: int, state: State[float]) -> None:
            assert stamp == len(self.states[index]) * self.scenario.step_ns
            self.states[index].append(state)
            self.published[index].append(self.now)
            if behind := self.followers.get(index + 1) if index + 1 in self.timing else None:
                relay = self.relays[index + 1]
                for name, take, value in (
                    ("pose", behind.take_position, state.position),
                    ("twist", behind.take_velocity, state.velocity),
                    ("accel", relay.take, state.acceleration),
                ):
                    self.later(
                        self._travel(),
                        partial(take, stamp, value),
                        (index, name),
                    )

        return publish

    def _trajectory(self) -> Trajectory:
        scenario, step = self.scenario, self.scenario.step_ns
        states = np.array([self.states[i] for i in scenario.vehicles])
        position, velocity, acceleration = (
            np.ascontiguousarray(states[:, :, part].T) for part in range(3)
        )
        motion = np.stack([position, velocity, acceleration])
        timing = np.array([self.timing[i] for i in scenario.indices])
        known = Timing(timing[:, :, 0].T.astype(np.int64), timing[:, :, 1].T)
        measured = measured_velocities(scenario, motion, known)
        received, shares, links = [], {}, []
        for column, index in enumerate(scenario.indices):
            counts = self.counts[index]
            used = self.packets[index][: counts[-1]]
            sample = np.searchsorted(counts, np.arange(1, len(used) + 1))
            source = np.array([stamp // step for stamp, _ in used])
            links.append(Arrivals(source, sample, np.array([value for _, value in used])))
            history = links[-1].of_bag(scenario.follower(index), measured[column])
            received.append(history.used)
            if history.share is not None:
                shares[column] = history.share
        return Trajectory(
            scenario,
            position,
            velocity,
            acceleration,
            np.stack(received, axis=1),
            tuple(links),
            law_shares(scenario, shares),
            known,
        )


def scenario_of(**more: Any) -> Scenario:
    values = {**SHORT, **{name.replace("__", "."): value for name, value in more.items()}}
    return Scenario.from_values(values)


def test_clocks_that_are_in_time_give_the_run_in_lockstep():
    scenario = scenario_of()
    run, lockstep = World(scenario).run(), simulate(scenario.in_lockstep)
    for ours, theirs in zip(run.motion, lockstep.motion, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert run.timing is not None
    assert not run.timing.age.any()


@pytest.mark.parametrize(("phases", "pace"), [("spread", 1.0), ("random", 1.0), ("spread", 2.5)])
def test_a_sample_is_published_when_its_vehicles_clock_says_so(phases: str, pace: float):
    scenario = scenario_of(run__phases=phases, run__real_time_factor=pace)
    period = int(scenario.step_ns / pace)
    world = World(scenario)
    world.run()
    seen = set()
    for index in scenario.vehicles:
        times = np.array(world.published[index][1:]) - START
        phase = times[0] - period
        seen.add(phase)
        assert 0 <= phase < period
        due = phase + np.arange(1, scenario.samples) * period
        np.testing.assert_array_equal(times, due)
    assert len(seen) == len(scenario.vehicles)


def jitter(seed: int, most: float) -> Iterator[int]:
    random = np.random.default_rng(seed)
    while True:
        yield int(random.uniform(0.05, most) * MS)


CHANNELS: dict[str, dict[str, Any]] = {
    "ideal": {},
    "random phases": {"run__phases": "random"},
    "lossy": {"v2v__loss": 0.3, "v2v__reception": "hold"},
    "late": {"v2v__latency": 0.05},
    "fallback": {
        "v2v__reception": "fallback",
        "v2v__fallback_after": 0.1,
        "v2v__blackouts": [1.0, 2.5],
    },
    "monitored": {"v2v__monitor": "report", "sensing__range_rate_std": 0.1},
    "sensors and limits": {
        "sensing__delay": 0.03,
        "sensing__range_std": 0.1,
        "vehicle__limits": "constant",
        "vehicle__max_jerk": 2.0,
        "vehicle__stops": True,
    },
    "cam": {"v2v__send_rule": "cam"},
    "pace": {"run__real_time_factor": 2.0},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CHANNELS)
@pytest.mark.parametrize("seed", range(3))
def test_what_is_published_of_a_run_is_enough_to_work_it_out_again(name: str, seed: int):
    """Late messages, vehicles that are busy for up to 0.4 s: every state to the last bit."""
    scenario = scenario_of(**CHANNELS[name])
    travel = jitter(seed, 30.0)
    random = np.random.default_rng(seed + 100)

    def busy(vehicle: int, now: int) -> int:
        return int(random.exponential(2.0) * MS) if random.random() < 0.95 else 400 * MS

    world = World(scenario, lambda: next(travel), busy)
    run = world.run()
    found = check_consistency(run)
    assert found.steps == scenario.platoon.followers * (scenario.samples - 1)
    assert found.largest == 0.0
    assert run.timing is not None
    assert run.timing.overrun.any()
    assert run.timing.age.max() > 3
    for index, late in zip(scenario.indices, run.timing.overrun.T, strict=True):
        used = np.diff(world.counts[index], prepend=0)
        assert not used[late].any()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lossy", "sensors and limits", "fallback"])
@pytest.mark.parametrize("seed", range(5))
def test_recorded_timing_gives_the_same_bits_in_whatever_order_it_comes(name: str, seed: int):
    scenario = scenario_of(**CHANNELS[name])
    travel, random = jitter(seed, 40.0), np.random.default_rng(seed)

    def busy(vehicle: int, now: int) -> int:
        return int(random.exponential(3.0) * MS) if random.random() < 0.98 else 200 * MS

    world = World(scenario, lambda: next(travel), busy)
    world.run()
    published: list[State[float]] = []
    again = RecordedFollower(
        scenario.follower(2), scenario, lambda stamp, state: published.append(state)
    )
    stamps = [k * scenario.step_ns for k in range(scenario.samples)]
    motion = list(zip(stamps, world.states[1], strict=True))
    counts = zip(stamps, world.counts[2], strict=True)
    timing = zip(stamps, world.timing[2], strict=True)
    feeds: list[deque[Callable[[], None]]] = [
        deque(partial(again.take_position, at, state.position) for at, state in motion),
        deque(partial(again.take_velocity, at, state.velocity) for at, state in motion),
        deque(partial(again.take_acceleration, *packet) for packet in world.packets[2]),
        deque(partial(again.take_count, at, count) for at, count in counts),
        deque(partial(again.take_timing, at, *one) for at, one in timing),
    ]
    while feeds := [feed for feed in feeds if feed]:
        feed = feeds[random.integers(len(feeds))]
        for _ in range(min(len(feed), int(random.integers(1, 200)))):
            feed.popleft()()
    assert published == world.states[2]


def test_a_busy_vehicle_keeps_its_command_and_the_others_go_on():
    scenario = scenario_of()
    frozen = START + 1_000 * MS

    def busy(vehicle: int, now: int) -> int:
        return 500 * MS if vehicle == 2 and frozen <= now < frozen + 10 * MS else 0

    world = World(scenario, busy=busy)
    run = world.run()
    assert run.timing is not None
    late = run.timing.overrun
    assert late.any(axis=0).tolist() == [False, True, False]
    begin, end = np.flatnonzero(late[:, 1])[[0, -1]]
    assert (begin, end) == (100, 149)
    decay = np.exp(-scenario.run.step / scenario.follower(2).tau)
    acceleration = run.acceleration[:, 2]
    command = (acceleration[1:] - decay * acceleration[:-1]) / (1.0 - decay)
    np.testing.assert_allclose(command[begin:end], command[begin - 1], atol=1e-10)
    assert abs(command[end + 1] - command[end - 1]) > 0.01
    assert check_consistency(run).largest == 0.0
    ages = run.timing.age
    assert ages[:, [0, 1]].max() == 0
    assert ages[:, 2].max() == 50  # at the last late sample
    times = np.diff(world.published[3][1:])
    assert set(times.tolist()) == {scenario.step_ns}


def test_the_expected_distance_of_a_run_whose_poses_are_a_sample_old():
    """A pose that is carried forward by its twist is off by the acceleration alone."""
    scenario = scenario_of(run__phases="random", run__seed=4)
    run = World(scenario).run()
    assert run.timing is not None
    aged = run.timing.age[1:].min(axis=0) == 1
    assert aged.any()
    assert np.abs(run.position - simulate(scenario.in_lockstep).position).max() < 0.02


@pytest.mark.parametrize(("vehicle", "phase"), [(0, 0), (1, 2_500_000), (3, 7_500_000)])
def test_phases_are_spread_over_a_period(vehicle: int, phase: int):
    assert VehicleClock(scenario_of(), vehicle, lambda: 0).phase == phase


@pytest.mark.parametrize("stamp", [-10 * MS, 5, 4_010 * MS, 10**18, 3_000 * MS])
def test_a_packet_that_nobody_can_have_sent_is_refused(stamp: int):
    """Before the run, between samples, after it, and of a sample that no clock can show by then."""
    world = World(scenario_of())
    follower = world.followers[2]
    follower.begin(START)
    world.now = START + 1_500 * MS
    follower.take_acceleration(1_500 * MS, 0.1)
    follower.take_acceleration(2_400 * MS, 0.1)
    with pytest.raises(LockstepError, match="no sample that anybody can have taken"):
        follower.take_acceleration(stamp, 0.1)


def test_who_touches_the_vehicle_ahead_says_so_once_and_drives_on():
    scenario = scenario_of(
        leader__profile="brake", leader__deceleration=20.0, leader__start=0.1, vehicle__length=4.5,
        platoon__standstill_distance=0.1, controller__time_headway=0.3,
    )  # fmt: skip
    run = simulate(scenario)
    assert len(run.position) == scenario.samples
    told = [event for event in events_of(run) if event.kind is EventKind.COLLISION]
    first = np.argmax(run.gap <= 0.0, axis=0)
    touched = (run.gap <= 0.0).any(axis=0)
    assert sorted(event.sample for event in told) == sorted(first[touched].tolist())
    assert told
    heard: list[RunEvent] = []
    world = World(scenario, tell=heard.append)
    world.run()
    assert [e for e in heard if e.kind is EventKind.COLLISION] == told


@pytest.mark.parametrize("step", [0.5, 0.1])
def test_what_is_never_late_is_never_told(step: float):
    heard: list[RunEvent] = []
    late = LateSamples(step, "vehicle_1/vehicle", heard.append)
    for sample in range(500):
        late.take(sample, 0.1)
    assert heard == []
    for sample in range(500, 1500):
        late.take(sample, 5.0 if sample % 10 < 8 else 0.0)
    assert len(heard) == MOST_TURNS


def test_a_sample_may_be_a_little_early_and_is_then_not_late():
    scenario = scenario_of()
    now = 0
    states: list[int] = []
    leader = WallLeader(scenario, lambda stamp, state: states.append(stamp), lambda: now)
    leader.begin(START)
    assert states == [0]
    now = START + 9_400_000
    leader.tick()
    assert states == [0]
    now = START + 9_600_000
    leader.tick()
    assert states == [0, 10 * MS]
    assert leader.wait == 10_400_000


def test_what_dds_loses_on_the_way_to_a_relay_is_a_lost_packet() -> None:
    values = {**SHORT, "v2v.best_effort": True, "v2v.latency": 0.02, "v2v.noise": "none"}
    one = Scenario.from_values(values)
    published: list[tuple[int, float]] = []
    relay = BestEffortRelay(one.follower(1), one, lambda *packet: published.append(packet))
    for sample in (0, 1, 2, 5, 6, 9):
        relay.take(sample * one.step_ns, float(sample))
    assert published == [(k * one.step_ns, float(k)) for k in (0, 1, 2, 5, 6)]
    relay.take(9 * one.step_ns, -9.0)  # a sender that starts again says it twice
    assert len(published) == 5
    with pytest.raises(LockstepError):
        relay.take(one.samples * one.step_ns, 0.0)
