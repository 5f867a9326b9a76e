"""Ratios of peaks: brute force, a run that attains the sure gain, and lags between the scan's."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import trapezoid
from scipy.linalg import expm

from cacc_platoon.model import Gains, State, ThirdOrderPlant
from cacc_platoon.theory import (
    DesignError,
    certify,
    is_internally_stable,
    linf_gain,
    optimum,
    sampled_sure_gain,
    sure_error_gain,
    sure_gain,
    worst_linf_gain,
    worst_sure_error_gain,
    worst_sure_gain,
)
from cacc_platoon.theory.peak_gains import SCAN_TOLERANCE

RHO, TAU = 5.0, 0.5
A = Gains(0.95, 0.5, 0.63, 0.009)
C = Gains(0.88, optimum(RHO, TAU).k_a, 0.85, 0.003)
D = Gains(0.95, 0.5, 0.75, 1.0)
E = Gains(0.75, 0.5, 0.8, 0.5)


@pytest.mark.parametrize(
    ("gains", "peaks", "errors"),
    [(A, 1.16319, 22.0583), (C, 1.14652, 43.632), (D, 1.21835, 0.39188), (E, 1.30435, 0.49763)],
    ids="ACDE",
)
def test_known_values(gains, peaks, errors):
    assert sure_gain(gains, RHO, TAU) == pytest.approx(peaks, abs=6e-6)
    assert sure_error_gain(gains, RHO, TAU) == pytest.approx(errors, rel=2e-5)


def responses(gains, tau, numerators, horizon, steps=200_000):
    """Impulse responses of numerators (n2, n1, n0) over D, by powers of a matrix exponential."""
    h, _, k_v, k_p = gains
    denominator = np.array([tau, 1.0, k_v + h * k_p, k_p])
    companion = np.array([[0, 1, 0], [0, 0, 1], *[-denominator[:0:-1] / tau]])
    step = expm(companion * horizon / steps)
    state, found = np.array([0.0, 0.0, 1.0 / tau]), np.empty((len(numerators), steps))
    rows = np.array([numerator[::-1] for numerator in numerators], dtype=float)
    for i in range(steps):
        found[:, i] = rows @ state
        state = step @ state
    return found


@pytest.mark.slow
@pytest.mark.parametrize("gains", [D, E], ids="DE")
@pytest.mark.parametrize("tau", [0.5, 0.1])
def test_sure_gain_is_the_integral_of_the_larger_end(gains, tau):
    h, k_a, k_v, k_p = gains
    ends = (0.8 * k_a, 1.2 * k_a)
    hops = [(k, k_v, k_p) for k in ends]
    errors = [(0.0, h * k - tau, k + h * k_v - 1.0) for k in ends]
    horizon = 60.0
    found = np.abs(responses(gains, tau, [*hops, *errors], horizon))
    peak, error = (
        trapezoid(np.maximum(*found[i : i + 2]), dx=horizon / found.shape[1]) for i in (0, 2)
    )
    assert sure_gain(gains, RHO, tau) == pytest.approx(peak, rel=2e-4)
    assert sure_error_gain(gains, RHO, tau) == pytest.approx(error, rel=2e-4)


def hop_of(gains, tau, period, sent, factors):
    """Accelerations of a follower whose predecessor has the accelerations `sent` at each step."""
    h, k_a, k_v, k_p = gains
    plant = ThirdOrderPlant(tau, period)
    decay = math.exp(-period / tau)
    ahead = me = State(0.0, 0.0, 0.0)
    moved = []
    for now, following, w in zip(sent, [*sent[1:], 0.0], factors, strict=True):
        delta = me.position - ahead.position + h * me.velocity
        u = k_a * w * now - k_v * (me.velocity - ahead.velocity) - k_p * delta
        moved.append(me.acceleration)
        me = plant.advance(me, float(u))
        ahead = plant.advance(ahead, float((following - decay * now) / (1.0 - decay)))
    return np.array(moved)


@pytest.mark.parametrize(("gains", "period"), [(D, 0.01), (E, 0.05)])
def test_some_noise_attains_the_sampled_sure_gain_and_none_exceeds_it(gains, period):
    """Sign of the acceleration and factor chosen at every step, so that all adds up at the end."""
    steps = int(40.0 / period)
    impulse = np.zeros(steps)
    impulse[1] = 1.0  # at rest before
    ends = [hop_of(gains, TAU, period, impulse, np.full(steps, w)) for w in (0.8, 1.2)]
    low, high = ends
    strongest = np.where(np.abs(low) > np.abs(high), low, high)[1:]
    factor = np.where(np.abs(low) > np.abs(high), 0.8, 1.2)[1:]
    sent = np.concatenate(([0.0], np.sign(strongest[::-1])))
    reached = hop_of(gains, TAU, period, sent, np.concatenate(([1.0], factor[::-1])))
    bound = sampled_sure_gain(gains, RHO, TAU, period, tau=TAU)
    assert np.max(np.abs(reached)) == pytest.approx(bound, rel=1e-3)
    assert np.max(np.abs(reached)) <= bound * (1 + 1e-8)
    rng = np.random.default_rng(3)
    for _ in range(5):
        random = hop_of(gains, TAU, period, rng.uniform(-1, 1, 800), rng.uniform(0.8, 1.2, 800))
        assert np.max(np.abs(random)) <= bound


def test_case_a_with_a_zero_order_hold_exceeds_the_gain_of_continuous_time():
    assert sure_gain(A, RHO, TAU) < 1.16352 < sampled_sure_gain(A, RHO, TAU, 0.01, tau=TAU)
    coarse, fine = (sampled_sure_gain(A, RHO, TAU, T, tau=TAU) for T in (1e-2, 1e-3))
    assert sure_gain(A, RHO, TAU) < fine < coarse < 1.17


def mean_gain(gains, tau):
    return max(linf_gain(gains, tau, share * gains.k_a) for share in (0.8, 1.2))


STABLE = st.builds(
    Gains,
    st.floats(0.5, 2.0),
    st.floats(0.05, 0.8),
    st.floats(0.05, 1.5),
    st.floats(-5, 1).map(math.exp),
)


@pytest.mark.slow
@given(STABLE, st.floats(0.05, 1.0), st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3))
@settings(max_examples=15)
def test_no_lag_exceeds_what_the_scan_says(gains, tau_max, places):
    assume(is_internally_stable(gains, 1.05 * tau_max))
    for worst, alone in (
        (
            worst_linf_gain,
            lambda tau: max(linf_gain(gains, tau, s * gains.k_a) for s in (0.8, 1.2)),
        ),
        (worst_sure_gain, lambda tau: sure_gain(gains, RHO, tau)),
        (worst_sure_error_gain, lambda tau: sure_error_gain(gains, RHO, tau)),
    ):
        found = worst(gains, RHO, tau_max)
        assert found.gain <= found.at_most
        assert found.gain == pytest.approx(alone(found.tau), rel=1e-6)
        for place in places:
            assert alone(tau_max * 10.0 ** (-4 * place)) <= found.at_most * (1 + 1e-9)


@pytest.mark.parametrize("gains", [A, C, D, E], ids="ACDE")
def test_the_scan_misses_little(gains):
    for worst in (worst_linf_gain, worst_sure_gain, worst_sure_error_gain):
        found = worst(gains, RHO, TAU)
        assert found.gain <= found.at_most <= found.gain * (1 + 2 * SCAN_TOLERANCE)


def test_a_lag_below_the_largest_may_be_the_worst():
    assert mean_gain(D, TAU) == pytest.approx(1.03204, abs=6e-6)
    assert mean_gain(D, 0.02 * TAU) == pytest.approx(1.08756, abs=6e-6)
    assert worst_linf_gain(D, RHO, TAU).gain == pytest.approx(mean_gain(D, 1e-6), rel=1e-3)


def test_sampled_too_a_lag_below_the_largest_may_be_the_worst():
    stiff = Gains(0.95, 0.5, 0.6, 2.0)
    alone = [sampled_sure_gain(stiff, RHO, TAU, 0.01, tau=TAU * share) for share in (0.05, 1.0)]
    assert alone[0] > alone[1] + 0.05
    assert sampled_sure_gain(stiff, RHO, TAU, 0.01) >= alone[0] - 0.01


def test_what_is_lost_or_late_widens_what_may_be_received():
    plain, lossy = sure_gain(A, RHO, TAU), sure_gain(A, RHO, TAU, reception=0.9)
    late = sure_gain(A, RHO, TAU, late=True)
    assert plain < lossy < late
    assert lossy == sure_gain(A, RHO, TAU, reception=0.1)
    assert certify(A, RHO, TAU, held=0.9).worst_sure_gain.gain >= late
    assert certify(A, RHO, TAU, latency=0.1).worst_sure_gain.gain >= late


def test_edges():
    unstable = Gains(0.2, 0.5, 0.01, 5.0)
    assert sure_gain(unstable, RHO, TAU) == worst_linf_gain(unstable, RHO, TAU).gain == math.inf
    assert sampled_sure_gain(unstable, RHO, TAU, 0.01) == math.inf
    with pytest.raises(DesignError, match="tau = 0 s"):
        sure_gain(A, RHO, 0.0)
    alone = certify(A, RHO, TAU, k_effective=0.55)
    assert alone.linf_gain == linf_gain(A, TAU, 0.55)
    assert alone.worst_sure_gain == (sure_gain(A, RHO, TAU), TAU, sure_gain(A, RHO, TAU))
