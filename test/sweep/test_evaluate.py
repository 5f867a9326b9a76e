"""A scenario as a row: the numbers of a report, the same in other processes, no state."""

from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

from cacc_platoon.analysis import compute_metrics
from cacc_platoon.scenario import Scenario, ScenarioError
from cacc_platoon.simulation import simulate
from cacc_platoon.sweep import evaluate

SHORT = Scenario.from_values({"run.duration": 20.0, "platoon.followers": 3})


def test_a_row_has_the_numbers_of_the_run():
    scenario = SHORT.with_values({"v2v.loss": 0.2, "v2v.reception": "zero"})
    row, metrics = evaluate(scenario), compute_metrics(simulate(scenario))
    assert row.first_peak == metrics.max_abs_spacing_error[0]
    assert row.min_gap == np.min(metrics.min_gap)
    assert row.collided == metrics.collision
    assert 0.15 < row.loss < 0.25
    assert "packet reception probability from p = 0.8 to 1" in row.basis


@pytest.mark.slow
def test_other_processes_give_the_same_rows():
    scenarios = [SHORT.with_values({"run.seed": seed}) for seed in (1, 2)]
    with ProcessPoolExecutor(1) as pool:
        rows = list(pool.map(evaluate, scenarios))
    assert rows == [evaluate(scenario) for scenario in scenarios]
    assert rows[0] != rows[1]


def test_values_are_checked_before_anything_is_evaluated():
    with pytest.raises(ScenarioError, match=r"v2v\.loss = 1\.5"):
        SHORT.with_values({"v2v.loss": 1.5})


def test_a_value_for_all_replaces_those_of_single_followers():
    own = SHORT.with_values({"vehicle_2.controller.k_v": 0.7, "vehicle_2.v2v.loss": 0.5})
    assert own.follower(2).gains.k_v == 0.7
    again = own.with_values({"controller.k_v": 0.6})
    assert again.follower(2).gains.k_v == 0.6
    assert again.follower(2).v2v.loss == 0.5
    assert own.with_values({}).values() == own.values()
    assert own.with_values({}).overrides == own.overrides
