"""Many noisy runs: their mean is the expectation run, and each is the run of its own seed."""

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import monte_carlo, simulate, simulate_mean

CONFIG = Path(__file__).parents[2] / "config"
SHORT = Scenario.from_values(
    {
        "platoon.followers": 3,
        "run.duration": 8.0,
        "run.step": 0.02,
        "leader.start": 0.0,
        "leader.angular_frequency": 1.0,
    }
)


@pytest.mark.slow
def test_the_mean_of_400_noisy_runs_is_the_expectation_run():
    # paper, E[X] = X-bar; 4 standard errors at every vehicle and time
    scenario = load_scenario(CONFIG / "paper_a.yaml", ["run.step=0.05", "run.duration=100"])
    ensemble = monte_carlo(scenario, runs=400)
    expected = simulate(scenario, "expected").spacing_error
    assert ensemble.runs == 400
    deviation = np.abs(ensemble.mean - expected)
    assert np.all(deviation <= 4.0 * ensemble.standard_error + 1e-12)
    assert np.max(ensemble.standard_error) > 1e-5


@pytest.fixture
def batches_of_seven(monkeypatch):
    """Let ensembles of SHORT be simulated seven runs at a time."""
    values = 7 * SHORT.samples * (SHORT.platoon.followers + 1)
    module = sys.modules["cacc_platoon.simulation.monte_carlo"]
    monkeypatch.setattr(module, "BATCH_VALUES", values)


@pytest.mark.slow
@pytest.mark.usefixtures("batches_of_seven")
def test_each_run_is_the_simulation_of_its_seed():
    ensemble = monte_carlo(SHORT, runs=60)
    errors = np.array(
        [simulate(SHORT.with_values({"run.seed": 1 + r})).spacing_error for r in range(60)]
    )
    np.testing.assert_array_equal(ensemble.max_abs_spacing_error, np.abs(errors).max(axis=1))
    np.testing.assert_array_equal(ensemble.low, errors.min(axis=0))
    np.testing.assert_array_equal(ensemble.high, errors.max(axis=0))
    np.testing.assert_allclose(ensemble.mean, errors.mean(axis=0), atol=1e-13)
    expected = errors.std(axis=0, ddof=1) / np.sqrt(60)
    np.testing.assert_allclose(ensemble.standard_error, expected, atol=1e-8)


@pytest.mark.usefixtures("batches_of_seven")
def test_the_first_runs_of_a_larger_ensemble_are_the_same():
    few, many = monte_carlo(SHORT, runs=3), monte_carlo(SHORT, runs=55)
    np.testing.assert_array_equal(few.max_abs_spacing_error, many.max_abs_spacing_error[:3])


@pytest.mark.slow
@pytest.mark.parametrize(
    "values",
    [
        {"v2v.noise": "none", "v2v.loss": 0.3, "v2v.reception": "zero"},
        {"v2v.noise": "none", "vehicle_1.v2v.noise": "bits"},
    ],
)
def test_an_ensemble_is_of_the_scenario_as_it_is(values):
    scenario = SHORT.with_values(values)
    ensemble, mean = monte_carlo(scenario, runs=200), simulate_mean(scenario).spacing_error
    known = ensemble.standard_error > 1e-9
    deviation = np.abs(ensemble.mean - mean)[known] / ensemble.standard_error[known]
    assert np.max(deviation) < 4.5


def test_an_ensemble_is_of_a_run_that_ended_before_a_change_that_was_planned():
    planned = SHORT.with_values({"run.timeline": ["6 link_2 v2v.loss=1"]})
    cut = dataclasses.replace(planned, run=dataclasses.replace(planned.run, duration=4.0))
    whole = SHORT.with_values({"run.duration": 4.0})
    np.testing.assert_array_equal(monte_carlo(cut, 5).low, monte_carlo(whole, 5).low)


def test_one_run_has_no_spread():
    ensemble = monte_carlo(SHORT, runs=1)
    assert np.all(ensemble.standard_error == 0.0)
    np.testing.assert_array_equal(ensemble.low, ensemble.high)


@pytest.mark.usefixtures("batches_of_seven")
def test_progress_is_reported():
    calls = []
    monte_carlo(SHORT, runs=17, progress=lambda *at: calls.append(at))
    assert calls == [(7, 17), (14, 17), (17, 17)]


@pytest.mark.parametrize("seed", [0, 2**63 - 1])
def test_another_seed_is_another_run_of_the_same_scenario(seed):
    other = SHORT.with_values({"run.seed": seed})
    assert dataclasses.replace(other, run=SHORT.run) == SHORT
    assert not np.array_equal(simulate(other).received, simulate(SHORT).received)
