"""Gaps: of points and of vehicles with a length, at samples and between them."""

import math
from pathlib import Path

import numpy as np
import pytest

from cacc_platoon.analysis import compute_metrics, judge
from cacc_platoon.analysis.braking import worst_braking
from cacc_platoon.analysis.metrics import _least_between
from cacc_platoon.design.requirements import Requirements, assess
from cacc_platoon.model import Gains, State, ThirdOrderPlant
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import Trajectory, simulate
from cacc_platoon.theory import worst_spacing

ROOT = Path(__file__).parents[2]
BRAKING = {
    "platoon.followers": 3,
    "run.duration": 12.0,
    "run.step": 0.1,
    "leader.profile": "step",
    "leader.amplitude": -8.0,
    "leader.hold": 2.5,
    "leader.start": 1.0,
    "controller.k_v": 0.63,
}


def test_the_length_of_the_vehicle_ahead_is_no_gap():
    points = simulate(Scenario.from_values(BRAKING))
    cars = simulate(Scenario.from_values({**BRAKING, "vehicle.length": 4.5}))
    np.testing.assert_array_equal(points.position, cars.position)
    np.testing.assert_array_equal(cars.gap, points.gap - 4.5)
    np.testing.assert_array_equal(cars.spacing, points.gap)
    long, short = compute_metrics(points), compute_metrics(cars)
    np.testing.assert_array_equal(long.min_time_headway, short.min_time_headway)
    assert (short.min_time_to_collision <= long.min_time_to_collision).all()


def test_a_truck_in_the_middle_shortens_the_gap_behind_it():
    mixed = Scenario.from_values({**BRAKING, "vehicle.length": 4.5}, {2: {"vehicle.length": 16.0}})
    assert mixed.lengths == (4.5, 4.5, 16.0, 4.5)
    run = simulate(mixed)
    np.testing.assert_array_equal(run.gap[0], run.spacing[0] - [4.5, 4.5, 16.0])


def test_what_touches_with_its_length_has_collided():
    near = {
        **BRAKING,
        "platoon.standstill_distance": 3.0,
        "platoon.initial_speed": 1.0,
        "run.stop_on_collision": False,
    }
    assert compute_metrics(simulate(Scenario.from_values(near))).first_collision is None
    touching = Scenario.from_values({**near, "vehicle.length": 4.5})
    assert compute_metrics(simulate(touching)).first_collision is not None


@pytest.mark.parametrize("step", [0.1, 0.5])
def test_no_gap_between_samples_is_below_what_is_said(step):
    scenario = Scenario.from_values({**BRAKING, "run.step": step, "vehicle.length": 2.0})
    run = simulate(scenario)
    metrics = compute_metrics(run)
    fine = ThirdOrderPlant(0.5, step / 40)
    decay = math.exp(-step / 0.5)
    command = (run.acceleration[1:] - decay * run.acceleration[:-1]) / (1.0 - decay)
    state = State(run.position[:-1], run.velocity[:-1], run.acceleration[:-1])
    lowest = np.full(run.gap[:-1].shape, np.inf)
    for _ in range(40):
        state = fine.advance(state, command)
        lowest = np.minimum(lowest, state.position[:, :-1] - state.position[:, 1:] - 2.0)
    between = lowest[:, 1:].min(axis=0)  # of followers, whose commands are held
    assert (metrics.sure_min_gap[1:] <= between + 1e-9).all()
    assert (metrics.sure_min_gap <= metrics.min_gap).all()
    assert (metrics.sure_min_gap >= metrics.min_gap - 8.0 * step**2).all()


def test_the_predecessors_least_acceleration_counts_at_both_ends():
    """Of random commands, between samples, against the plant itself."""
    rng, step = np.random.default_rng(4), 0.5
    quiet = Scenario.from_values({**BRAKING, "run.step": step, "run.duration": 40.0})
    run = simulate(quiet)
    plant, fine = ThirdOrderPlant(0.5, step), ThirdOrderPlant(0.5, step / 40)
    commands = rng.uniform(-8.0, 8.0, (len(run.time) - 1, 4))
    states = [State(*(part[0].copy() for part in (run.position, run.velocity, run.acceleration)))]
    lowest = np.full(3, np.inf)
    between = []
    for command in commands:
        inside = states[-1]
        lowest = inside.position[:-1] - inside.position[1:]
        for _ in range(40):
            inside = fine.advance(inside, command)
            lowest = np.minimum(lowest, inside.position[:-1] - inside.position[1:])
        between.append(lowest)
        states.append(plant.advance(states[-1], command))
    position, velocity, acceleration = (
        np.array([getattr(state, name) for state in states]) for name in State._fields
    )
    driven = Trajectory(quiet, position, velocity, acceleration, received=run.received)
    assert (_least_between(driven)[:, 1:] <= np.array(between)[:, 1:] + 1e-9).all()


def test_a_leader_that_turns_between_samples_is_seen():
    """It brakes by 20 m/s and is fast again before the next sample: 4 m nearer meanwhile."""
    table = {
        "leader.times": (0.0, 10.1, 10.3, 10.7, 10.9, 12.0),
        "leader.speeds": (25.0, 25.0, 5.0, 45.0, 25.0, 25.0),
        "leader.profile": "csv",
    }
    slow = {"controller.time_headway": 4.0, "controller.k_v": 0.3, "controller.k_p": 0.05}
    settings = {"run.step": 1.0, "run.duration": 30.0, "platoon.followers": 2}
    scenario = Scenario.from_values({**table, **slow, **settings, "controller.k_a": 0.1})
    metrics = compute_metrics(simulate(scenario))
    nearest = 105.0 - 4.0
    assert metrics.min_gap[0] > nearest + 3.0
    assert metrics.sure_min_gap[0] <= nearest


def test_the_largest_acceleration_of_a_leader_is_that_of_its_profile():
    """All samples of this one are at constant speed, and yet there are errors."""
    table = {"leader.times": (0.0, 1.02, 1.05, 1.08), "leader.speeds": (25.0, 25.0, 26.0, 25.0)}
    rare = {"run.step": 0.1, "run.duration": 5.0, "leader.profile": "csv"}
    scenario = Scenario.from_values({**table, **rare, "platoon.followers": 1})
    run = simulate(scenario)
    metrics = compute_metrics(run)
    assert not run.acceleration[:, 0].any()
    assert metrics.max_abs_acceleration[0] == pytest.approx(1.0 / 0.03)
    certificate = judge(scenario).weakest.certificate
    assert certificate is not None
    error = certificate.worst_sure_error_gain.at_most
    assert 0.0 < metrics.max_abs_spacing_error[0] <= error * metrics.max_abs_acceleration[0]
    sine = {"run.duration": 30.0, "platoon.followers": 1, "leader.amplitude": -3.0}
    metrics = compute_metrics(simulate(Scenario.from_values({**sine, "run.step": 0.1})))
    assert metrics.max_abs_acceleration[0] == 3.0


def test_the_least_gap_is_looked_for_at_short_lags():
    """Design E: nearer at a hundredth of the lag than at a tenth."""
    gains = {"time_headway": 0.75, "k_a": 0.5, "k_v": 0.8, "k_p": 0.5}
    values = {f"controller.{name}": value for name, value in gains.items()}
    scenario = Scenario.from_values({**values, "v2v.rho": 5.0})
    found = worst_braking(scenario, judge(scenario))
    asked = Requirements(min_gap=4.0)
    designed = asked.worst_gap(assess(Gains(**gains), 5.0, 0.5, asked).certificate)
    tenth = worst_spacing(
        Gains(**gains), 0.05, 0.4, standstill_distance=5.0, speed=25.0, deceleration=8.0
    )[0]
    assert found is not None
    for gap in (found.gap, designed):
        assert gap < tenth - 0.08
        assert gap == pytest.approx(4.2, abs=0.03)


def test_the_scenario_with_cars_has_their_length():
    cars = load_scenario(ROOT / "config" / "cars.yaml")
    assert set(cars.lengths) == {4.5}
    run = simulate(cars)
    assert run.gap[0] == pytest.approx(6.5 - 4.5 + 1.0 * 25.0)
    assert not compute_metrics(run).collision


def test_the_worst_of_all_brakings_is_below_a_straight_stop():
    stop = {**BRAKING, "leader.hold": 3.125, "run.duration": 30.0, "run.step": 0.01}
    for values in ({}, {"vehicle.length": 2.0}):
        scenario = Scenario.from_values({**stop, **values})
        found = worst_braking(scenario, judge(scenario))
        assert found is not None
        assert (found.speed, found.deceleration, found.vehicles) == (25.0, 8.0, 3)
        stopped = compute_metrics(simulate(scenario, "expected"))
        assert found.gap <= stopped.min_gap.min() + 0.02
    unequal = Scenario.from_values(stop, {2: {"controller.k_v": 0.7}})
    assert worst_braking(unequal, judge(unequal)) is None


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({}, "in the mean and in continuous time, is below"),
        ({"latency": 0.01}, "continuous time without latency, is below"),
        ({"reception": 0.9}, "continuous time, is below"),
        (
            {"v2v_period": 0.02, "latency": 0.01, "reception": 0.9, "hold": True},
            "continuous time without latency, V2V period, losses, is below",
        ),
    ],
)
def test_a_gap_that_is_missed_says_what_it_leaves_out(asked, said):
    requirements = Requirements(min_gap=4.99, **asked)
    missed = assess(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5, requirements).unmet
    assert [text for text in missed if text.startswith("worst gap") and said in text]
