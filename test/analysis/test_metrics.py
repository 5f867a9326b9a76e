"""The numbers: those of theory, those of a slow recomputation, and the same from every road."""

import dataclasses
import math

import numpy as np
import pytest

from cacc_platoon.analysis import analyse, check_consistency, compute_metrics, link_noise
from cacc_platoon.analysis.noise import noise_factor
from cacc_platoon.model import expected_factor, factor_variance
from cacc_platoon.reproduction.cases import CASES, case_scenario
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import Trajectory, simulate


def same(one, two):
    if isinstance(one, np.ndarray):
        return one.tobytes() == two.tobytes()
    return one == two or repr(one) == repr(two)  # NaN is NaN


def test_metrics_of_a_bag_are_those_of_the_arrays(whole_run, scenario):
    from_bag = analyse(whole_run, runs=0).measured
    from_arrays = compute_metrics(simulate(scenario))
    for field in dataclasses.fields(from_bag):
        assert same(getattr(from_bag, field.name), getattr(from_arrays, field.name)), field.name


# docs/theory.md, section 1 (Setting): max|delta_1| and max|delta_12| [m] of the mean system at
# 100 Hz, platoon length at rest, at its largest [m]
THEORY = {
    "A": (1.596227, 1.544609, 345.0, 436.729),
    "B": (0.882905, 0.888412, 255.0, None),
    "C": (0.926459, 0.921985, 324.0, 416.683),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_published_cases(case):
    metrics = compute_metrics(simulate(case_scenario(case, {"v2v.noise": "expected"})))
    first, last, initial, longest = THEORY[case.name]
    assert metrics.max_abs_spacing_error[0] == pytest.approx(first, abs=5e-7)
    assert metrics.max_abs_spacing_error[-1] == pytest.approx(last, abs=5e-7)
    growing = np.diff(metrics.max_abs_spacing_error) > 0
    assert growing.all() if case.name == "B" else not growing.any()
    assert metrics.platoon_length.initial == pytest.approx(initial, abs=1e-9)
    if longest:
        assert metrics.platoon_length.max == pytest.approx(longest, abs=5e-4)
    assert not metrics.collision


def test_against_a_slow_recomputation(scenario):
    """Loops over samples and vehicles, written from the definitions."""
    run = simulate(scenario)
    metrics, step = compute_metrics(run), scenario.run.step
    x, v, a = run.position, run.velocity, run.acceleration
    for i in range(1, 4):
        delta = [x[k][i] - x[k][i - 1] + 5.0 + 0.95 * v[k][i] for k in range(301)]
        peak = max(abs(d) for d in delta)
        energy = math.sqrt(step * sum(d * d for d in delta))
        assert metrics.max_abs_spacing_error[i - 1] == pytest.approx(peak, rel=1e-12)
        assert metrics.time_of_max[i - 1] == step * max(range(301), key=lambda k: abs(delta[k]))
        assert metrics.l2_spacing_error[i - 1] == pytest.approx(energy, rel=1e-12)
        rms = energy / math.sqrt(301 * step)
        assert metrics.rms_spacing_error[i - 1] == pytest.approx(rms, rel=1e-12)
        assert metrics.final_spacing_error[i - 1] == pytest.approx(delta[-1], rel=1e-9)
        gaps = [x[k][i - 1] - x[k][i] for k in range(301)]
        assert metrics.min_gap[i - 1] == min(gaps)
        kept = [(gaps[k] - 5.0) / v[k][i] for k in range(301)]
        assert metrics.min_time_headway[i - 1] == pytest.approx(min(kept), rel=1e-12)
        assert metrics.mean_time_headway[i - 1] == pytest.approx(sum(kept) / 301, rel=1e-12)
        closing = [
            gaps[k] / (v[k][i] - v[k][i - 1]) for k in range(301) if v[k][i] - v[k][i - 1] > 1e-9
        ]
        assert metrics.min_time_to_collision[i - 1] == pytest.approx(min(closing, default=math.inf))
        jerk = max(abs(a[k + 1][i] - a[k][i]) / step for k in range(300))
        assert metrics.max_abs_jerk[i] == pytest.approx(jerk, rel=1e-12)
        if i > 1:
            before = metrics.l2_spacing_error[i - 2]
            assert metrics.hop_ratio_l2[i - 2] == pytest.approx(energy / before, rel=1e-12)


def straight(gap_speed, samples=101):
    """A leader at 10 m/s and one follower whose gap of 20 m shrinks at `gap_speed` [m/s]."""
    scenario = Scenario.from_values(
        {"platoon.followers": 1, "run.step": 0.1, "run.duration": 10.0, "platoon.initial_speed": 10}
    )
    time = np.arange(samples) * 0.1
    position = np.stack([10.0 * time, -20.0 + (10.0 + gap_speed) * time], axis=1)
    velocity = np.tile([10.0, 10.0 + gap_speed], (samples, 1))
    zero = np.zeros((samples, 2))
    return Trajectory(scenario, position, velocity, zero, zero[:, :1])


def test_collision_and_time_to_collision():
    metrics = compute_metrics(straight(3.0))
    assert metrics.collision
    assert metrics.first_collision == (1, pytest.approx(6.7))  # 20 m / 3 m/s, next sample
    assert metrics.min_time_to_collision[0] == 0.0
    safe = compute_metrics(straight(1.0))
    assert not safe.collision
    assert safe.min_time_to_collision[0] == pytest.approx(10.0)  # 10 m left after 10 s
    assert compute_metrics(straight(-1.0)).min_time_to_collision[0] == math.inf


def test_settling_time():
    """delta = exp(-t): within 5 % of its peak after ln 20 = 2.996 s."""
    run = straight(0.0)
    position = run.position.copy()
    position[:, 1] = position[:, 0] - 5.0 - 0.95 * 10.0 + np.exp(-run.time)
    metrics = compute_metrics(dataclasses.replace(run, position=position))
    assert metrics.settling_time[0] == pytest.approx(3.0)
    assert metrics.max_abs_spacing_error[0] == pytest.approx(1.0)
    position[:, 1] += 0.5
    assert np.isnan(compute_metrics(dataclasses.replace(run, position=position)).settling_time[0])


@pytest.mark.slow
def test_noise_of_a_long_run():
    """Every w on the lattice of 16 bits, its mean and variance within 4 standard errors."""
    scenario = case_scenario(CASES[0], {"platoon.followers": 4})
    run = simulate(scenario)
    factors = noise_factor(run)
    lattice = (factors[np.isfinite(factors)] - 0.8) * 5.0 * 2.0**15
    assert np.abs(lattice - np.rint(lattice)).max() < 1e-6
    bits = scenario.v2v.bit_probabilities
    for link in link_noise(run):
        assert link.low >= 0.8 - 1e-15
        assert link.high <= 1.199993896484375 + 1e-15
        assert link.breaches == 0
        error = math.sqrt(factor_variance(5.0, bits) / link.samples)
        assert abs(link.mean - expected_factor(5.0, bits)) < 4 * error
        assert link.expected_mean == pytest.approx(1.048173687744, abs=1e-12)
        assert link.expected_variance == pytest.approx(0.009215195660, abs=1e-12)
        assert 13.979 < link.snr_db < 14.2  # a realised run has SNR >= rho
        assert link.snr_db == pytest.approx(-20 * math.log10(max(link.high - 1, 1 - link.low)))


def test_breach_of_the_channel_is_timed(scenario):
    run = simulate(scenario)
    received = run.received.copy()
    received[120, 1] = 1.2001 * run.acceleration[120, 1]
    link = link_noise(dataclasses.replace(run, received=received))[1]
    assert (link.breaches, link.first_breach) == (1, pytest.approx(1.2))
    received[10, 2] = 0.1  # its predecessor does not accelerate yet
    assert link_noise(dataclasses.replace(run, received=received))[2].breaches == 1


def test_no_noise_has_no_limit_of_snr(scenario):
    assert {link.snr_db for link in link_noise(simulate(scenario, "none"))} == {math.inf}


def test_consistency_names_the_vehicle_that_departs(scenario):
    run = simulate(scenario)
    assert check_consistency(run).largest == 0.0
    assert check_consistency(run).steps == 300 * 3
    other = simulate(
        dataclasses.replace(scenario, overrides={2: {"controller.k_v": 0.7}})
    )  # vehicle 2 had another gain than the scenario says
    found = check_consistency(dataclasses.replace(other, scenario=scenario))
    assert [follower for follower, *_ in found.departures] == [2]


def test_missing_samples_are_left_out(scenario):
    run = simulate(scenario)
    position = run.position.copy()
    position[100, 1] = np.nan
    metrics = compute_metrics(dataclasses.replace(run, position=position))
    whole = compute_metrics(run)
    assert metrics.max_abs_spacing_error[2] == whole.max_abs_spacing_error[2]
    assert np.isfinite(metrics.max_abs_spacing_error).all()
    assert metrics.l2_spacing_error[0] < whole.l2_spacing_error[0]
