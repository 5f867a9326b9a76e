"""Gaps: of points and of vehicles with a length, at samples and between them."""

import math
from pathlib import Path

import numpy as np
import pytest

from cacc_platoon.analysis import compute_metrics, judge
from cacc_platoon.analysis.braking import worst_braking
from cacc_platoon.model import State, ThirdOrderPlant
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import simulate

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
    near = {**BRAKING, "platoon.standstill_distance": 3.0, "platoon.initial_speed": 1.0}
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
