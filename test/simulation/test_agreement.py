"""The test of a mean of noisy runs: what it rests on, that it is silent and that it speaks."""

import numpy as np
import pytest
from scipy.signal import fftconvolve

from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import mean_agreement, monte_carlo, simulate, simulate_mean
from cacc_platoon.simulation.agreement import pulse_responses
from cacc_platoon.simulation.draws import squared_ranges
from cacc_platoon.simulation.mean_links import mean_factor

SMALL = {"platoon.followers": 3, "run.duration": 12.0, "leader.start": 0.0, "run.step": 0.02}
CASES: dict[str, dict[str, object]] = {
    "noise": {},
    "held noise": {"v2v.hold": 0.2},
    "zero": {"v2v.loss": 0.3, "v2v.reception": "zero"},
    "hold": {"v2v.loss": 0.3, "v2v.reception": "hold"},
    "loss alone": {"v2v.loss": 0.3, "v2v.noise": "none"},
    "unequal": {
        "vehicle_2.controller.k_v": 0.9,
        "vehicle_3.v2v.rho": 2.0,
        "vehicle_1.v2v.loss": 0.5,
    },
}


def scenario_of(name, **more):
    return Scenario.from_values(SMALL).with_values({**CASES[name], **more})


def agreement_of(scenario, runs, mean, **more):
    found = mean_agreement(scenario, monte_carlo(scenario, runs), mean, **more)
    assert found is not None
    return found


def differences(run):
    """What each draw differs from its mean, given all that was drawn before it, (samples, L)."""
    result = np.empty_like(run.received)
    before = np.zeros(len(run.scenario.followers))
    for k, (sent, used) in enumerate(zip(run.sent, run.received, strict=True)):
        for j, follower in enumerate(run.scenario.followers):
            p = 1.0 - follower.v2v.loss
            other = before[j] if follower.v2v.reception == "hold" else 0.0
            result[k, j] = used[j] - p * mean_factor(follower) * sent[j] - (1 - p) * other
        before = used
    return result


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_a_noisy_run_is_the_mean_one_and_what_its_draws_differ(name):
    """What the bound rests on, sample by sample, and the widths of the differences."""
    scenario = scenario_of(name)
    run, mean = simulate(scenario), simulate_mean(scenario)
    drawn, responses = differences(run), pulse_responses(scenario)
    made = sum(
        fftconvolve(drawn[:, j, np.newaxis], responses[:, j], axes=0)[: len(drawn)]
        for j in range(3)
    )
    np.testing.assert_allclose(run.spacing_error - mean.spacing_error, made, atol=1e-9)
    assert np.abs(made).max() > 1e-4
    width = np.sqrt(squared_ranges(scenario, run.sent, run.received))
    assert (np.abs(drawn) <= width * (1 + 1e-9) + 1e-15).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_it_is_silent_of_the_mean_and_speaks_of_another_one(name):
    scenario = scenario_of(name)
    found = agreement_of(scenario, 100, simulate_mean(scenario))
    assert found.bound.shape == (601, 3)
    assert 0.01 < found.largest_share < 1.0
    changed = "v2v.loss" if name == "loss alone" else "v2v.noise"
    other = scenario.with_values({changed: 0.0 if changed == "v2v.loss" else "none"})
    assert agreement_of(scenario, 100, simulate_mean(other)).largest_share > 1.0


@pytest.mark.slow
def test_false_alarms_are_no_more_often_than_the_level_says():
    """At a level of one half, 60 ensembles of few runs and noise that is rarely drawn."""
    scenario = scenario_of("held noise", **{"run.duration": 4.0, "v2v.bit_probabilities": (0.98,)})
    mean = simulate_mean(scenario)
    alarms = 0
    for seed in range(60):
        seeded = scenario.with_values({"run.seed": 1000 * seed})
        alarms += agreement_of(seeded, 2, mean, level=0.5).largest_share > 1.0
    assert alarms <= 30


def test_the_bound_grows_with_the_confidence_and_shrinks_with_the_runs():
    scenario = scenario_of("noise")
    mean = simulate_mean(scenario)
    bound = agreement_of(scenario, 10, mean).bound.max()
    assert agreement_of(scenario, 10, mean, level=1e-6).bound.max() > 1.05 * bound
    assert agreement_of(scenario, 40, mean).bound.max() == pytest.approx(bound / 2, rel=0.02)


def test_no_test_where_draws_are_used_before_and_after_a_loss():
    scenario = scenario_of("hold", **{"v2v.hold": 0.2})
    assert mean_agreement(scenario, monte_carlo(scenario, 2), simulate_mean(scenario)) is None
    quiet = scenario.with_values({"v2v.noise": "expected"})
    assert mean_agreement(quiet, monte_carlo(quiet, 2), simulate_mean(quiet)) is not None


def test_there_is_no_such_test_where_parameters_change():
    """A draw has no one response then."""
    changing = ("5 link_1 v2v.loss=0.2", "8 vehicle_1 controller.time_headway=1.1")
    for timeline, tested in (((), True), (changing[:1], False), (changing[1:], False)):
        one = Scenario.from_values(
            {"platoon.followers": 2, "run.duration": 12.0, "run.timeline": timeline}
        )
        found = mean_agreement(one, monte_carlo(one, 3), simulate_mean(one))
        assert (found is not None) == tested
