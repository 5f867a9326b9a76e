"""Mean-square index, uniform bound and H2 norm, against second moments and Monte Carlo."""

import math
from typing import Any

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import toeplitz

from cacc_platoon.model import Gains, State, ThirdOrderPlant, factor_variance
from cacc_platoon.theory import (
    DesignError,
    is_internally_stable,
    largest_variance,
    leader_error_norm,
    mean_square_index,
    uniform_error_bound,
)

FAST = Gains(1.2, 0.5, 0.6, 0.3)  # no slow mode, so a short record holds all its energy
TAU, PERIOD, SAMPLES = 0.5, 0.05, 700


def acceleration_response(feedforward, feedback):
    """Impulse response, sampled, from a predecessor's acceleration to one's own."""
    h, _, k_v, k_p = FAST
    plant = ThirdOrderPlant(TAU, PERIOD)
    ahead, me, response = State(0.0, 0.0, 0.0), State(0.0, 0.0, 0.0), []
    for i in range(SAMPLES):
        received = 1.0 if i == 0 else 0.0
        delta = me.position + h * me.velocity - feedback * ahead.position
        error = me.velocity - feedback * ahead.velocity
        response.append(me.acceleration)
        me = plant.advance(me, feedforward * received - k_v * error - k_p * delta)
        ahead = State(
            ahead.position + PERIOD * ahead.velocity + PERIOD**2 / 2 * received,
            ahead.velocity + PERIOD * received,
            0.0,
        )
    return np.array(response)


def lower_toeplitz(response):
    return toeplitz(response, np.zeros(len(response)))


MEAN = lower_toeplitz(acceleration_response(FAST.k_a, 1.0))
NOISE = lower_toeplitz(acceleration_response(FAST.k_a, 0.0))
START = np.sin(0.8 * PERIOD * np.arange(SAMPLES)) * (np.arange(SAMPLES) * PERIOD < 7.85)


def variance_for(index):
    unit = mean_square_index(FAST, TAU, FAST.k_a, variance=1.0, redraw_period=PERIOD)
    return index / unit


def energies(index, vehicles):
    """Exact E||a_i||^2 from the recursion of the second moments along the platoon."""
    variance = variance_for(index)
    moment, result = np.outer(START, START), []
    for _ in range(vehicles + 1):
        result.append(np.trace(moment))
        moment = MEAN @ moment @ MEAN.T + variance * (NOISE * np.diag(moment)) @ NOISE.T
    return np.array(result) / result[0]


def test_energy_is_bounded_below_one():
    energy = energies(0.5, 8)
    assert energy.max() <= 1 / (1 - 0.5)
    assert energy[-1] < energy[2]


@pytest.mark.slow
def test_energy_grows_above_one():
    energy = energies(2.0, 8)
    assert np.all(np.diff(energy)[1:] > 0)
    assert energy[-1] > 4
    assert np.all(np.diff(np.log(energy))[3:] > 0.1)  # at a rate that does not die out


@pytest.mark.slow
def test_monte_carlo_agrees_with_the_second_moments():
    rng = np.random.default_rng(3)
    runs, vehicles = 4000, 3
    expected = energies(0.5, vehicles)
    a = np.tile(START, (runs, 1))
    total = []
    for _ in range(vehicles):
        factor = rng.choice([-1.0, 1.0], a.shape) * math.sqrt(variance_for(0.5))
        a = a @ MEAN.T + (factor * a) @ NOISE.T
        energy = np.sum(a * a, axis=1) / np.sum(START**2)
        total.append((energy.mean(), energy.std() / math.sqrt(runs)))
    for (mean, error), exact in zip(total, expected[1:], strict=True):
        assert abs(mean - exact) < 4.5 * error
        assert error < 0.1 * exact
        assert mean < 2.0


def test_index_is_infinite_without_string_stability_and_zero_without_noise():
    unstable = Gains(0.65, 0.5, 0.63, 0.009)
    assert mean_square_index(unstable, 0.5, 0.5, variance=0.1, redraw_period=0.01) == math.inf
    assert mean_square_index(FAST, 0.5, 0.5, variance=0.0, redraw_period=0.01) == 0
    for name, value in (("variance", -1.0), ("variance", math.nan), ("redraw_period", -0.1)):
        arguments = {"variance": 0.1, "redraw_period": 0.01, name: value}
        with pytest.raises(DesignError, match=name):
            mean_square_index(FAST, 0.5, 0.5, **arguments)


def test_fair_bits_have_the_largest_variance():
    assert factor_variance(5.0, [0.5] * 32) == pytest.approx(largest_variance(5.0))
    assert factor_variance(5.0, [0.3] * 32) < largest_variance(5.0)


@given(
    st.floats(0.3, 2), st.floats(0.1, 2), st.floats(0.001, 2), st.floats(0.1, 1), st.floats(0, 1)
)
@settings(max_examples=40)
def test_h2_norm_against_python_control(h, k_v, k_p, tau, k):
    gains = Gains(h, k, k_v, k_p)
    norm = leader_error_norm(gains, tau, k)
    if not is_internally_stable(gains, tau):
        assert norm == math.inf
        return
    if k_v + h * k_p > 1.01 * tau * k_p:
        Phi = control.tf([h * k - tau, k + h * k_v - 1], [tau, 1, k_v + h * k_p, k_p])
        reference = control.norm(Phi, p=2, print_warning=False)
        assert norm == pytest.approx(reference, rel=1e-6, abs=1e-9)


def test_uniform_bound_holds_in_a_simulated_platoon_and_is_not_idle():
    gains, period = Gains(0.95, 0.5, 0.63, 0.009), 0.01
    h, k, k_v, k_p = gains
    leader = 0.5 * np.sin(0.1 * np.arange(0, 20 * np.pi, period))
    leader = np.concatenate([leader, np.zeros(4000)])
    bound = uniform_error_bound(gains, 0.5, k, math.sqrt(np.sum(leader**2) * period))
    plant = ThirdOrderPlant(0.5, period)
    worst = []
    x, v = np.cumsum(np.cumsum(leader)) * period**2, np.cumsum(leader) * period
    ahead: list[Any] = list(zip(x, v, leader, strict=True))
    for _ in range(5):
        me, track, errors = State(0.0, 0.0, 0.0), [], []
        for position, velocity, acceleration in ahead:
            delta = me.position - position + h * me.velocity
            errors.append(abs(delta))
            track.append(me)
            command = k * acceleration - k_v * (me.velocity - velocity) - k_p * delta
            me = plant.advance(me, float(command))
        worst.append(max(errors))
        ahead = track
    assert max(worst) <= bound
    assert max(worst) > 0.3 * bound
    assert uniform_error_bound(gains._replace(time_headway=0.65), 0.5, 0.5, 1.0) == math.inf
