"""The lockstep core alone: any order of arrival, same bits; what must not be used is refused."""

import dataclasses
import math
import random
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cacc_platoon.model import ComposedChannel, Delivery, State
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.simulation import simulate
from cacc_platoon.stepping.deliveries import LockstepError
from cacc_platoon.stepping.lockstep import (
    LockstepFollower,
    LockstepLeader,
    LockstepRelay,
)

SCENARIO = Scenario.from_values(
    {"run.duration": 12.0, "platoon.followers": 2, "leader.start": 1.0}, None, "test"
)
STEP = SCENARIO.step_ns
REFERENCE = simulate(SCENARIO)


def follower_1(published: list[tuple[int, State[float]]]) -> LockstepFollower:
    return LockstepFollower(
        SCENARIO.follower(1), SCENARIO, lambda stamp, state: published.append((stamp, state))
    )


@given(st.integers())
def test_any_interleaving_of_the_inputs_gives_the_bits_of_the_simulation(seed: int) -> None:
    published: list[tuple[int, State[float]]] = []
    core = follower_1(published)
    streams = {
        core.take_position: list(REFERENCE.position[:, 0]),
        core.take_velocity: list(REFERENCE.velocity[:, 0]),
        core.take_acceleration: list(REFERENCE.received[:, 0]),
    }
    turns = [take for take, values in streams.items() for _ in values]
    random.Random(seed).shuffle(turns)
    sent = dict.fromkeys(streams, 0)
    for take in turns:
        k = sent[take]
        take(k * STEP, float(streams[take][k]))
        sent[take] = k + 1
    assert [stamp for stamp, _ in published] == [k * STEP for k in range(SCENARIO.samples)]
    states = np.array([state for _, state in published])
    assert (states[:, 0] == REFERENCE.position[:, 1]).all()
    assert (states[:, 1] == REFERENCE.velocity[:, 1]).all()
    assert (states[:, 2] == REFERENCE.acceleration[:, 1]).all()


def test_received_accelerations_may_overtake_each_other() -> None:
    in_order: list[tuple[int, State[float]]] = []
    overtaken: list[tuple[int, State[float]]] = []
    for published, order in ((in_order, (0, 1, 2)), (overtaken, (2, 0, 1))):
        core = follower_1(published)
        for k in order:
            core.take_acceleration(k * STEP, 0.1 * k)
        for k in range(3):
            core.take_velocity(k * STEP, 25.0)
            core.take_position(k * STEP, 0.25 * k)
    assert in_order == overtaken
    assert len(in_order) == 4


@pytest.mark.parametrize("stream", ["take_position", "take_velocity"])
@pytest.mark.parametrize("stamp", [STEP, 2 * STEP, 1, -STEP])
def test_a_stamp_that_is_not_due_is_refused(stream: str, stamp: int) -> None:
    with pytest.raises(LockstepError, match=r"stamped .* where 0 s is due"):
        getattr(follower_1([]), stream)(stamp, 0.0)


def test_a_sample_that_comes_twice_says_from_where_on_nothing_can_be_trusted() -> None:
    """Two of one sample: whoever came first was used, be it ours or not."""
    core = follower_1([])
    for k in range(3):
        core.take_velocity(k * STEP, 25.0)
    with pytest.raises(LockstepError, match="; everything from sample 1 on may be wrong"):
        core.take_velocity(STEP, 25.0)
    with pytest.raises(LockstepError, match=r"another publisher$"):
        core.take_velocity(7 * STEP, 25.0)


LOSSY = SCENARIO.with_values({"v2v.loss": 0.5})


def counted() -> LockstepFollower:
    return LockstepFollower(LOSSY.follower(1), LOSSY, lambda stamp, state: None)


def test_a_packet_of_a_later_sample_than_it_is_delivered_at_is_refused() -> None:
    core = counted()
    core.take_acceleration(9 * STEP, 0.0)
    with pytest.raises(LockstepError, match=r"vehicle_1: v2v/accel was delivered at 0 s, before"):
        core.take_count(0, 1.0)


@pytest.mark.parametrize(
    ("stamp", "count", "doubtful"),
    [(0, 1.0, 0), (STEP, 1.0, 1), (2 * STEP, 0.5, 2), (2 * STEP, -1.0, 2), (99 * STEP, 9.0, None)],
)
def test_a_count_of_another_publisher_says_from_where_on_nothing_can_be_trusted(
    stamp: int, count: float, doubtful: int | None
) -> None:
    core = counted()
    for k in range(2):
        core.take_count(k * STEP, 0.0)
    with pytest.raises(
        LockstepError, match=r"vehicle_1: v2v/complete .*another publisher"
    ) as error:
        core.take_count(stamp, count)
    doubt = f"everything from sample {doubtful} on may be wrong"
    assert str(error.value).endswith(doubt) == (doubtful is not None)


@pytest.mark.parametrize("more", [0.5, -1.0, math.nan, math.inf, LOSSY.run.window + 1.0])
def test_a_count_stands_for_samples_of_the_window_alone(more: float) -> None:
    core = counted()
    core.take_count(0, 0.0)
    with pytest.raises(LockstepError, match=r"v2v/complete .* samples more: .*another publisher"):
        core.take_count(STEP, 0.0, more)


def test_a_count_stands_for_samples_of_the_run_alone() -> None:
    core, window = counted(), LOSSY.run.window
    last = LOSSY.samples - 1
    for k in range(0, last - window, window + 1):
        core.take_count(k * STEP, 0.0, window)
    due = k + window + 1
    with pytest.raises(LockstepError, match=r"v2v/complete .* samples more: .*another publisher"):
        core.take_count(due * STEP, 0.0, last - due + 1.0)
    core.take_count(due * STEP, 0.0, last - due)


def test_a_follower_goes_as_far_as_counts_stand_for_and_no_further() -> None:
    states: list[int] = []
    core = LockstepFollower(LOSSY.follower(1), LOSSY, lambda stamp, state: states.append(stamp))
    for k in range(9):
        core.take_position(k * STEP, 100.0)
        core.take_velocity(k * STEP, 25.0)
    core.take_count(0, 1.0, 3.0)
    assert states == [0]
    core.take_acceleration(0, 0.5)
    assert states[-1] == 4 * STEP
    with pytest.raises(LockstepError, match="is stamped"):
        core.take_count(3 * STEP, 1.0)
    core.take_count(4 * STEP, 1.0)
    assert states[-1] == 5 * STEP


CAM_LOSSY = {
    **{"v2v.send_rule": "cam", "v2v.phase": "random", "v2v.loss": 0.1},
    **{"v2v.latency": 0.02, "v2v.jitter": 0.03, "v2v.noise": "none"},
}


def relayed(one: Scenario) -> tuple[list[tuple[int, int, int]], list[tuple[int, int]]]:
    """Return the counts of a relay, and sample and source of what it has published."""
    counts: list[tuple[int, int, int]] = []
    published: list[tuple[int, int]] = []
    now = 0

    def publish(stamp: int, _: float) -> None:
        published.append((now, stamp // one.step_ns))

    def count(stamp: int, total: int, more: int) -> None:
        assert total == len(published)
        counts.append((stamp // one.step_ns, total, more))

    relay = LockstepRelay(one.follower(1), one, publish, count)
    motion: list[tuple[int, State[float]]] = []
    LockstepLeader(one, lambda *sample: motion.append(sample)).take_horizon(one.samples)
    for now, (stamp, state) in enumerate(motion):  # noqa: B007  (publish reads it)
        relay.take(stamp, state.acceleration)
        if one.follower(1).triggered:
            relay.take_velocity(stamp, state.velocity)
            relay.take_position(stamp, state.position)
    return counts, published


@pytest.mark.slow
@settings(deadline=None, max_examples=30)
@given(
    send=st.sampled_from(
        [
            {},
            {"v2v.period": 0.1, "v2v.phase": "random"},
            {"v2v.send_rule": "cam"},
            {"v2v.send_rule": "cam", "v2v.phase": "random", "v2v.cam_check": 0.01},
        ]
    ),
    loss=st.sampled_from([0.0, 0.1, 0.9, 1.0]),
    late=st.sampled_from([(0.0, 0.0), (0.02, 0.03), (0.0, 0.4)]),
    in_order=st.booleans(),
    seed=st.integers(1, 1000),
)
def test_what_a_relay_says_of_samples_to_come_is_true(
    send: dict[str, Any], loss: float, late: tuple[float, float], in_order: bool, seed: int
) -> None:
    """Its counts are of all samples, each once, and what it publishes is what simulation says."""
    latency, jitter = late
    link = {"v2v.loss": loss, "v2v.latency": latency, "v2v.jitter": jitter}
    frame = {"v2v.in_order": in_order, "run.seed": seed, "run.duration": 20.0}
    one = Scenario.from_values({**send, **link, **frame, "platoon.followers": 1})
    assume(one.follower(1).counted)
    counts, published = relayed(one)
    due = 0
    for sample, total, more in counts:
        assert sample == due
        assert total == sum(k <= sample + more for k, _ in published)
        due += 1 + more
    assert due == one.samples
    arrivals = simulate(one).arrivals
    assert arrivals is not None
    (arrived,) = arrivals
    assert published == list(zip(arrived.sample.tolist(), arrived.source.tolist(), strict=True))
    if in_order:
        assert arrived.source.tolist() == sorted(arrived.source.tolist())


def test_under_cam_few_counts_are_needed() -> None:
    """A third message for every packet, instead of one of every sample."""
    one = Scenario.from_values({**CAM_LOSSY, "run.duration": 40.0})
    counts, published = relayed(one)
    assert len(published) > 150
    assert len(counts) < 0.16 * one.samples


def test_a_relay_whose_parameters_may_be_set_says_nothing_of_samples_to_come() -> None:
    """But under CAM, where what may be set is of packets that are not sent yet."""
    late = {"v2v.loss": 1.0, "v2v.period": 0.1, "run.adjustable": True, "run.duration": 5.0}
    one = Scenario.from_values(late)
    assert [more for _, _, more in relayed(one)[0]] == one.samples * [0]
    counts, _ = relayed(Scenario.from_values({**late, "v2v.period": 0.0, **CAM_LOSSY}))
    assert max(more for _, _, more in counts) == 9


def test_a_received_acceleration_that_is_there_already_is_refused() -> None:
    core = follower_1([])
    core.take_acceleration(0, 0.0)
    with pytest.raises(LockstepError, match="another publisher"):
        core.take_acceleration(0, 0.0)
    with pytest.raises(LockstepError, match="no sample"):
        core.take_acceleration(STEP + 1, 0.0)


def test_a_vehicle_that_has_collided_takes_what_still_comes_and_does_nothing() -> None:
    published: list[tuple[int, State[float]]] = []
    core = follower_1(published)
    for k in range(5):
        core.take_acceleration(k * STEP, 0.0)
        core.take_position(k * STEP, 0.0 if k < 2 else -100.0)
        core.take_velocity(k * STEP, 25.0)
    assert [stamp for stamp, _ in published] == [0, STEP, 2 * STEP]
    assert core.next_sample == 3


@pytest.mark.parametrize("name", ["position", "velocity", "acceleration"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_what_is_not_finite_is_refused_by_name(name: str, value: float) -> None:
    core = follower_1([])
    inputs = {"position": 0.0, "velocity": 25.0, "acceleration": 0.0}
    core.take_position(0, inputs["position"])
    inputs[name] = value
    with pytest.raises(LockstepError, match=r"vehicle_1: command at 0.01 s is (nan|-?inf)"):  # noqa: PT012
        core.take_acceleration(0, 0.0)
        core.take_velocity(0, 25.0)
        core.take_position(STEP, inputs["position"])
        core.take_velocity(STEP, inputs["velocity"])
        core.take_acceleration(STEP, inputs["acceleration"])


def test_the_relay_multiplies_by_the_factor_of_the_sample() -> None:
    sent: list[tuple[int, float]] = []
    follower = SCENARIO.follower(2)
    relay = LockstepRelay(follower, SCENARIO, lambda stamp, a: sent.append((stamp, a)))
    for k in range(50):
        relay.take(k * STEP, 1.0)
    assert [a for _, a in sent] == follower.noise().factors(0, 50).tolist()
    with pytest.raises(LockstepError, match="accel of vehicle_1"):
        relay.take(49 * STEP, 1.0)


def test_the_leader_goes_as_far_as_the_horizon() -> None:
    sent: list[int] = []
    leader = LockstepLeader(SCENARIO, lambda stamp, _: sent.append(stamp // STEP))
    for horizon, until in ((3, 4), (3, 4), (1, 4), (10, 11), (10**6, SCENARIO.samples)):
        leader.take_horizon(horizon)
        assert sent == list(range(until))


def test_the_command_and_the_spacing_error_follow_from_the_states() -> None:
    commands: list[tuple[int, float, float, float]] = []
    core = LockstepFollower(
        SCENARIO.follower(1),
        SCENARIO,
        lambda *_: None,
        lambda *command: commands.append(command),
    )
    for k in range(SCENARIO.samples):
        core.take_position(k * STEP, float(REFERENCE.position[k, 0]))
        core.take_velocity(k * STEP, float(REFERENCE.velocity[k, 0]))
        core.take_acceleration(k * STEP, float(REFERENCE.received[k, 0]))
    assert len(commands) == SCENARIO.samples
    deltas = np.array([delta for _, _, delta, _ in commands])
    assert (deltas == REFERENCE.spacing_error[:, 0]).all()
    k = 600
    _, u, delta, gap_error = commands[k]
    gains = SCENARIO.follower(1).gains
    v, v_ahead = REFERENCE.velocity[k, 1], REFERENCE.velocity[k, 0]
    law = gains.k_a * REFERENCE.received[k, 0] - gains.k_v * (v - v_ahead) - gains.k_p * delta
    assert u == pytest.approx(law, rel=1e-12)
    assert gap_error == pytest.approx(delta - gains.time_headway * v)


def test_another_law_is_used_when_given() -> None:
    class Coast:
        def command(self, *_: float) -> float:
            return 0.0

    published: list[tuple[int, State[float]]] = []
    core = LockstepFollower(
        SCENARIO.follower(1), SCENARIO, lambda *sample: published.append(sample), law=Coast()
    )
    for k in range(10):
        core.take_position(k * STEP, 1.0 * k)
        core.take_velocity(k * STEP, 30.0)
        core.take_acceleration(k * STEP, 5.0)
    assert {state.velocity for _, state in published} == {25.0}


def test_an_override_reaches_the_follower_it_is_for() -> None:
    scenario = Scenario.from_values({}, {2: {"controller.k_v": 0.7}}, "test")
    assert scenario.follower(2).gains.k_v == 0.7
    assert scenario.follower(1).gains == dataclasses.replace(scenario).follower(3).gains


@pytest.mark.parametrize("failure", [RuntimeError("no"), SystemExit(0)])
def test_a_law_that_fails_is_named(failure: BaseException) -> None:
    class Failing:
        def command(self, *_: float) -> float:
            raise failure

    core = LockstepFollower(SCENARIO.follower(1), SCENARIO, lambda *_: None, law=Failing())
    core.take_position(0, 0.0)
    core.take_velocity(0, 25.0)
    with pytest.raises(LockstepError, match=f"control law raised {type(failure).__name__} at 0 s"):
        core.take_acceleration(0, 0.0)


def test_a_relay_asks_for_the_samples_of_the_run_alone() -> None:
    asked: list[tuple[int, int]] = []

    class Watched(ComposedChannel):
        def delivery(self, start: int, stop: int) -> Delivery:
            asked.append((start, stop))
            return super().delivery(start, stop)

    relay = LockstepRelay(SCENARIO.follower(1), SCENARIO, lambda *_: None, channel=Watched([]))
    for k in range(SCENARIO.samples):
        relay.take(k * STEP, 1.0)
    assert asked[0][0] == 0
    assert asked[-1][1] == SCENARIO.samples


def test_a_follower_has_no_more_attributes_than_python_finds_at_once():
    """CPython keeps up to 30 of an object in place; with more, a run is 3 % slower."""
    assert len(vars(LockstepFollower(SCENARIO.follower(1), SCENARIO, lambda *_: None))) < 30


class Coasting:
    """A law that leaves a vehicle alone."""

    def command(self, *_: float) -> float:
        return 0.0


def test_a_gap_of_zero_to_the_rear_of_the_one_ahead_is_a_collision() -> None:
    lengths = {1: {"vehicle.length": 7.0}, 2: {"vehicle.length": 4.0}}
    scenario = Scenario.from_values({"platoon.followers": 2}, lengths)
    told: list[RunEvent] = []
    core = LockstepFollower(
        scenario.follower(2),
        scenario,
        lambda stamp, state: None,
        law=Coasting(),
        tell=told.append,
        initial=State(0.0, 0.0, 0.0),
    )
    for k, ahead in enumerate((8.0, math.nextafter(7.0, 8.0), 7.0)):
        assert not told
        core.take_velocity(k * scenario.step_ns, 0.0)
        core.take_acceleration(k * scenario.step_ns, 0.0)
        core.take_position(k * scenario.step_ns, ahead)
    assert told == [RunEvent(EventKind.COLLISION, 2, "vehicle_2/vehicle")]
