"""Mean-square growth, against quadrature, covariances of lifted platoons, and random phases."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cacc_platoon.model import Gains
from cacc_platoon.model.noise import expected_factor, factor_variance
from cacc_platoon.scenario.v2v_parameters import V2V
from cacc_platoon.simulation.brute_force import response
from cacc_platoon.theory import (
    DesignError,
    frequency_response,
    frozen_noise_margin,
    is_string_stable,
    mean_square_index,
    optimum,
    sampled_mean_square_index,
)
from cacc_platoon.theory.mean_square import NoiseStatistics
from cacc_platoon.theory.noise_growth import worst_frozen_noise_margin, worst_mean_square_index

RHO, TAU = 5.0, 0.5
BITS = V2V().bit_probabilities
MEAN, VARIANCE = expected_factor(RHO, BITS), factor_variance(RHO, BITS)
A = Gains(0.95, 0.5, 0.63, 0.009)
C = Gains(0.88, optimum(RHO, TAU).k_a, 0.85, 0.003)
D = Gains(0.95, 0.5, 0.75, 1.0)
E = Gains(0.75, 0.5, 0.8, 0.5)


@pytest.mark.parametrize(
    ("gains", "index", "over_white"),
    [
        (A, 6.434702e-5, (1.024, 1.051, 1.111)),
        (C, 4.183154e-5, (1.082, 1.189, 1.554)),
        (D, 5.337491e-5, (1.031, 1.066, 1.144)),
        (E, 9.770105e-5, (1.080, 1.182, 1.519)),
    ],
    ids="ACDE",
)
def test_known_values(gains, index, over_white):
    k = MEAN * gains.k_a
    exact = sampled_mean_square_index(gains, TAU, k, 0.01, variance=VARIANCE)
    assert exact == pytest.approx(index, rel=2e-7)
    for period, ratio in zip((0.01, 0.02, 0.04), over_white, strict=True):
        exact = sampled_mean_square_index(gains, TAU, k, period, variance=VARIANCE)
        white = mean_square_index(gains, TAU, k, variance=VARIANCE, redraw_period=period)
        assert exact / white == pytest.approx(ratio, abs=6e-4)


def test_known_values_of_noise_that_is_held():
    for hold, value in ((1, 0.238648), (2, 0.472033), (5, 1.147638), (10, 2.177937)):
        found = sampled_mean_square_index(
            E, TAU, MEAN * E.k_a, 0.04, variance=1 / E.k_a**2, hold=hold
        )
        assert found == pytest.approx(value, abs=2e-6)


@given(st.floats(0.6, 2.0), st.floats(0.1, 0.8), st.floats(0.3, 1.0), st.floats(0.05, 1.0))
@settings(max_examples=40)
def test_index_against_quadrature_on_the_unit_circle(h, k_a, k_v, k_p):
    gains, period = Gains(h, k_a, k_v, k_p), 0.02
    found = sampled_mean_square_index(gains, TAU, k_a, period, variance=1.0)
    assume(math.isfinite(found))
    omega = np.pi * (np.arange(20_000) + 0.5) / 20_000 / period
    H = response(gains, TAU, k_a, period, omega)
    G = response(gains, TAU, 2.0 * k_a, period, omega) - H
    expected = float(np.mean(np.abs(G) ** 2 / (1.0 - np.abs(H) ** 2)))
    assert found == pytest.approx(expected, rel=1e-3)


def test_energies_of_a_platoon_grow_where_the_index_says():
    """Exact second moments of acceleration sequences of 30 s, vehicle by vehicle."""
    hold, period, steps, k = 4, 0.05, 440, MEAN * E.k_a
    theta = 2 * np.pi * np.fft.rfftfreq(4096)
    omega = np.maximum(theta, 1e-9) / period
    H = np.fft.irfft(response(E, TAU, k, period, omega))[:steps]
    G = np.fft.irfft(response(E, TAU, k + E.k_a, period, omega))[:steps] - H
    lower = [np.array([[x[i - j] if i >= j else 0.0 for j in range(steps)] for i in range(steps)])
             for x in (H, G)]  # fmt: skip
    block = np.arange(steps) // hold
    same = block[:, np.newaxis] == block
    unit = sampled_mean_square_index(E, TAU, k, period, variance=1.0, hold=hold)
    for factor, grows in ((0.5, False), (2.5, True)):
        moment = np.zeros((steps, steps))
        moment[:20, :20] = 1.0
        energies = []
        for _ in range(16):
            noise = factor / unit * moment * same
            moment = lower[0] @ moment @ lower[0].T + lower[1] @ noise @ lower[1].T
            energies.append(np.trace(moment))
        assert (energies[-1] > energies[-4]) == grows


@given(st.floats(0.6, 2.0), st.floats(0.1, 0.8), st.floats(0.3, 1.0), st.floats(0.05, 1.0),
       st.floats(0.0, 0.3))  # fmt: skip
def test_frozen_noise_at_every_frequency(h, k_a, k_v, k_p, variance):
    """``E|H|^2 = |H_mean|^2 + Var k_a^2 |s^2/D|^2`` <= 1 iff the margin is not below 0."""
    gains, omega = Gains(h, k_a, k_v, k_p), np.geomspace(1e-3, 1e2, 4000)
    margin = frozen_noise_margin(gains, TAU, k_a, variance=variance)
    mean = frequency_response(gains, TAU, k_a, omega)
    heard = frequency_response(gains, TAU, k_a + 1.0, omega) - mean
    square = np.abs(mean) ** 2 + variance * k_a**2 * np.abs(heard) ** 2
    if margin >= 0:
        assert square.max() <= 1 + 1e-9
    elif is_string_stable(gains, TAU, k_a) and margin < -1e-3:
        assert square.max() > 1


def test_worst_over_lags():
    noise = NoiseStatistics(MEAN, VARIANCE, 0.02)
    k = MEAN * D.k_a
    worst = worst_mean_square_index(D, TAU, k, 0.01, noise)
    margin = worst_frozen_noise_margin(D, TAU, k, noise)
    for tau in np.linspace(0.01, TAU, 30):
        alone = sampled_mean_square_index(D, float(tau), k, 0.01, variance=VARIANCE, hold=2)
        assert alone <= worst * (1 + 1e-6)
        frozen = frozen_noise_margin(D, float(tau), k, variance=VARIANCE)
        assert frozen >= margin - 1e-12


def test_edges():
    unstable = A._replace(time_headway=0.5)
    question = (unstable, TAU, 0.5)
    assert sampled_mean_square_index(*question, 0.01, variance=0.1) == math.inf
    assert frozen_noise_margin(*question, variance=0.1) == -math.inf
    assert sampled_mean_square_index(A, TAU, 0.5, 0.01, variance=0.0) == 0.0
    assert sampled_mean_square_index(A, TAU, 0.5, 0.09, variance=0.1) < math.inf
    assert math.isnan(sampled_mean_square_index(A, TAU, 0.5, 0.01, variance=0.1, hold=400))
    with pytest.raises(DesignError, match="variance = -1"):
        sampled_mean_square_index(A, TAU, 0.5, 0.01, variance=-1.0)
    with pytest.raises(DesignError, match="hold = 0"):
        sampled_mean_square_index(A, TAU, 0.5, 0.01, variance=1.0, hold=0)
