"""The sampled-data certificate, against discretised loops of python-control and simulation."""

import itertools
import math

import control
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cacc_platoon.model import Gains, State, ThirdOrderPlant
from cacc_platoon.simulation.brute_force import largest_growth
from cacc_platoon.theory import (
    DesignError,
    critical_loss,
    critical_period,
    exact_region,
    is_robustly_string_stable,
    is_sampled_string_stable,
    is_string_stable,
    l2_gain,
    minimum_headway,
    sampled_stability_map,
)
from cacc_platoon.theory.noise_interval import effective_gains
from cacc_platoon.theory.sampled import lags_to_try, sampled_hop, stable_at

A = Gains(0.95, 0.5, 0.63, 0.009)
C = Gains(0.88, 0.318305009, 0.85, 0.003)


def discrete_plant(tau, period):
    """Zero-order hold of (position, velocity, acceleration) by python-control."""
    continuous = control.ss(
        [[0, 1, 0], [0, 0, 1], [0, 0, -1 / tau]], [[0], [0], [1 / tau]], np.eye(3), 0
    )
    plant = control.c2d(continuous, period, "zoh")
    return plant.A, plant.B


def hop_response(gains, tau, k, period, omega, *, held=1.0):
    """Frequency response from the predecessor's states, by linear solves of the closed loop."""
    h, _, k_v, k_p = gains
    A_d, B_d = discrete_plant(tau, period)
    own = np.array([[-k_p, -k_v - k_p * h, 0.0]])
    closed = A_d + B_d @ own
    result = []
    for w in omega:
        z = np.exp(1j * w * period)
        g = np.linalg.solve(z * np.eye(3) - A_d, B_d)  # states of the predecessor per command
        a = g[2] * held / (1 - (1 - held) / z)
        drive = k * a + k_v * g[1] + k_p * g[0]
        x = np.linalg.solve(z * np.eye(3) - closed, B_d * drive)
        result.append(x[0] / g[0])
    return np.abs(np.array(result)).ravel(), np.abs(np.linalg.eigvals(closed)).max()


DESIGNS = st.tuples(
    st.floats(0.4, 2),
    st.floats(0.05, 2),
    st.floats(-5, 1).map(math.exp),
    st.floats(0.05, 1),
    st.floats(0.0, 0.95),
    st.floats(-5, -0.5).map(math.exp),
)


@given(DESIGNS)
@settings(max_examples=2 * settings().max_examples // 2)
def test_certificate_against_the_closed_loop_of_python_control(design):
    h, k_v, k_p, tau, k, period = design
    gains = Gains(h, k, k_v, k_p)
    omega = np.geomspace(1e-3 / period**0.5, np.pi / period * (1 - 1e-9), 150)
    H, radius = hop_response(gains, tau, k, period, omega)
    stable = bool(sampled_stability_map(h, k_v, k_p, tau, k, period=period))
    if stable:
        assert radius < 1
        assert H.max() <= 1 + 1e-6  # the linear solves lose digits at low frequency
    elif radius < 1 - 1e-9:
        hop = sampled_hop(h, k_v, k_p, tau, k, period=period)
        theta = np.concatenate((np.geomspace(1e-6, np.pi, 4000), omega * period))
        d = (np.exp(1j * theta) - 1) / period
        n, m = (np.polynomial.polynomial.polyval(d, np.array(c)) for c in hop[:2])
        excess = np.abs(n / m) ** 2 - 1
        assert excess.max() > -1e-12
    else:
        assert radius > 1 - 1e-9


@given(DESIGNS, st.one_of(st.floats(0, 1), st.floats(-6, 0).map(math.exp)))
@settings(max_examples=3 * settings().max_examples // 2)
def test_held_packets_against_the_closed_loop_of_python_control(design, held):
    """Brute force over frequency, k filtered by p/(1 - (1 - p)/z) beside the loop."""
    h, k_v, k_p, tau, k, period = design
    gains = Gains(h, k, k_v, k_p)
    omega = np.geomspace(1e-2, np.pi / period * (1 - 1e-9), 400)
    H, radius = hop_response(gains, tau, k, period, omega, held=held)
    if sampled_stability_map(h, k_v, k_p, tau, k, period=period, held=held):
        assert radius < 1
        assert H.max() <= 1 + 1e-6
    elif radius < 1 - 1e-9:
        hop = sampled_hop(h, k_v, k_p, tau, k, period=period, held=held)
        theta = np.concatenate((np.geomspace(1e-6, np.pi, 4000), omega * period))
        d = (np.exp(1j * theta) - 1) / period
        n, m = (np.polynomial.polynomial.polyval(d, np.array(c)) for c in hop[:2])
        assert (np.abs(n) - np.abs(m)).max() > -1e-12 * np.abs(m).max()


STABLE = st.tuples(
    st.floats(1.0, 2.0),  # headway over the least
    st.floats(0.05, 0.8),
    st.floats(-4, 1).map(math.exp),
    st.floats(0.02, 0.98),  # place of k_v in the exact region
    st.floats(0.1, 0.8),
)


def design_in_the_region(draw):
    share, k_a, k_p, place, tau = draw
    h = share * minimum_headway(k_a, 5.0, tau)
    region = exact_region(k_a, h, 5.0, tau)
    k_p = max(k_p, region.k_p_min)
    low, high = (float(x) for x in region.bounds(np.float64(k_p)))
    return Gains(h, k_a, max(low + place * (high - low), 1e-3), k_p), tau


@pytest.mark.slow
@given(STABLE, st.floats(-4, 0).map(math.exp))
@settings(max_examples=30)
def test_critical_period_with_held_packets_is_the_first_loss(draw, held):
    """Every period below keeps string stability, just above it is lost."""
    gains, tau = design_in_the_region(draw)
    assume(is_robustly_string_stable(gains, 5.0, tau))
    longest = critical_period(gains, 5.0, tau, held=held)
    assert longest <= critical_period(gains, 5.0, tau) * (1 + 1e-6)
    for share in np.linspace(0.02, 0.9999, 30) if longest else ():
        assert is_sampled_string_stable(gains, 5.0, tau, share * longest, held=held)
    above = longest * (1 + 1e-5) or 1e-6 * tau
    assert not is_sampled_string_stable(gains, 5.0, tau, above, held=held)


@pytest.mark.slow
@given(STABLE, st.floats(-4, -1).map(math.exp))
@settings(max_examples=30)
def test_critical_loss_is_the_first_loss(draw, period):
    gains, tau = design_in_the_region(draw)
    most = critical_loss(gains, 5.0, tau, period)
    for loss in np.linspace(0.0, 0.9999, 30) * most if most else ():
        assert is_sampled_string_stable(gains, 5.0, tau, period, held=1 - loss)
    if most < 1 - 1e-4:
        above = most * (1 + 1e-5) or 1e-6
        assert not is_sampled_string_stable(gains, 5.0, tau, period, held=1 - above)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"held": -1.0}, "held = -1 is not a probability: .* Give held from 0 to 1"),
        ({"held": 1.5}, "held = 1.5 is not a probability"),
        ({"held": math.nan}, "held = nan is not a probability"),
    ],
)
def test_held_that_has_no_meaning_is_refused(change, words):
    unstable = A._replace(time_headway=0.1)  # refused whatever the answer would be
    for gains in (A, unstable):
        with pytest.raises(DesignError, match=words):
            is_sampled_string_stable(gains, 5.0, 0.5, 0.01, **change)
        with pytest.raises(DesignError, match=words):
            critical_period(gains, 5.0, 0.5, **change)
    with pytest.raises(DesignError, match=words):
        sampled_stability_map(0.95, 0.63, 0.009, 0.5, 0.5, period=0.01, **change)


@given(DESIGNS, st.floats(0.01, 1))
@settings(max_examples=50)
def test_coefficients_against_the_frequency_response(design, held):
    h, k_v, k_p, tau, k, period = design
    omega = np.linspace(0.05, 0.95, 7) * np.pi / period
    H, _ = hop_response(Gains(h, k, k_v, k_p), tau, k, period, omega, held=held)
    hop = sampled_hop(h, k_v, k_p, tau, k, period=period, held=held)
    d = (np.exp(1j * omega * period) - 1) / period
    n, m = (np.polynomial.polynomial.polyval(d, np.array(c)) for c in hop[:2])
    assert np.abs(n / m) == pytest.approx(H, rel=1e-6)


@pytest.mark.parametrize(("factor", "grows"), [(0.9, False), (1.1, True)])
def test_critical_period_against_a_simulated_loop(factor, grows):
    """Drive the model's own plant at the worst frequency and look whether the wave gains."""
    gains, tau, k = Gains(1.0, 0.5, 0.6, 0.4), 0.5, 0.6
    period = factor * critical_period(gains, 5.0, tau, k_effective=k)
    hop = sampled_hop(gains.time_headway, gains.k_v, gains.k_p, tau, k, period=period)
    theta = np.linspace(0.05, np.pi, 5000)
    d = (np.exp(1j * theta) - 1) / period
    n, m = (np.polynomial.polynomial.polyval(d, np.array(c)) for c in hop[:2])
    ratio = np.abs(n / m)
    worst = int(np.argmax(ratio))
    assert (ratio[worst] > 1 + 1e-6) == grows
    simulated = simulated_gain(gains, tau, k, period, theta[worst])
    assert simulated == pytest.approx(ratio[worst], rel=1e-6)


def simulated_gain(gains, tau, k, period, theta):
    """Amplitude ratio of v_2 to v_1 of a run in steady state."""
    h, _, k_v, k_p = gains
    plant = ThirdOrderPlant(tau, period)
    steps = int(200 / period)
    vehicles = [State(0.0, 0.0, 0.0)] * 3
    speeds = np.empty((steps, 3))
    for i in range(steps):
        received = [v.acceleration for v in vehicles]
        commands = [np.cos(theta * i)]
        for j, (ahead, me) in enumerate(itertools.pairwise(vehicles)):
            delta = me.position - ahead.position + h * me.velocity
            commands.append(k * received[j] - k_v * (me.velocity - ahead.velocity) - k_p * delta)
        speeds[i] = [v.velocity for v in vehicles]
        vehicles = [plant.advance(v, float(u)) for v, u in zip(vehicles, commands, strict=True)]
    last = np.arange(steps // 2, steps)
    wave = np.stack([np.cos(theta * last), np.sin(theta * last), np.ones(last.size), last], axis=1)
    fit = np.linalg.lstsq(wave, speeds[last], rcond=None)[0]
    amplitude = np.hypot(fit[0], fit[1])
    return amplitude[2] / amplitude[1]


@pytest.mark.parametrize("gains", [A, C], ids=["A", "C"])
def test_critical_period_is_where_the_certificate_flips(gains):
    period = critical_period(gains, 5.0, 0.5)
    assert is_sampled_string_stable(gains, 5.0, 0.5, period * (1 - 1e-5))
    assert not is_sampled_string_stable(gains, 5.0, 0.5, period * (1 + 1e-5))


def test_worst_lag_of_a_fine_grid_is_not_worse():
    period = critical_period(A, 5.0, 0.5) * (1 - 1e-4)
    lags = np.linspace(0.0, 0.5, 401)[:, np.newaxis]
    k = np.linspace(0.4, 0.6, 41)
    assert sampled_stability_map(A.time_headway, A.k_v, A.k_p, lags, k, period=period).all()


@pytest.mark.parametrize(
    ("gains", "rho", "period", "tau"),
    [
        (Gains(0.974782, 0.8100374, 0.3115179, 31.07279), 11.66363, 0.007729, 0.002868),
        (Gains(1.306197, 0.8269163, 0.3740929, 16.38683), 12.81614, 0.009669, 0.003362),
        (Gains(1.329293, 0.8720621, 0.1274103, 27.17265), 11.56674, 0.002876, 0.000805),
    ],
)
def test_a_lag_shorter_than_the_period_may_be_the_worst(gains, rho, period, tau):
    """By 0.7 % per hop, where evenly spaced lags up to 0.5 s and none find nothing."""
    omega = np.linspace(0.002, 0.99, 2000) * np.pi / period
    H, _ = hop_response(gains, tau, gains.k_a * (1 + 1 / rho), period, omega)
    assert H.max() > 1.005
    assert not is_sampled_string_stable(gains, rho, 0.5, period)


BETWEEN = [
    (Gains(0.5610381, 0.61560829, 0.15933707, 17.26166153), 1.7477295, 0.30792052, 0.005562727),
    (Gains(0.42542622, 0.9229516, 0.22763366, 48.2538564), 20.8362498, 0.23305628, 0.002711887),
    (Gains(0.47842316, 0.79804835, 0.22681231, 18.61063933), 6.6751164, 0.19505268, 0.016219612),
]
"""Designs with their SNR, largest lag, and the first period that all lags of the grid lose."""


@pytest.mark.slow
@pytest.mark.parametrize(("gains", "rho", "tau_max", "period"), BETWEEN)
def test_a_lag_between_those_tried_may_be_the_worst(gains, rho, tau_max, period):
    tried, ends = lags_to_try(tau_max, None), effective_gains(gains.k_a, rho)
    below = 0.998 * period
    assert stable_at(gains, ends, tried, np.array([below]), held=1.0)[0]
    lags = np.linspace(tried[1], tried[7], 200)
    assert largest_growth(gains, rho, lags, below)[0] > 1 + 1e-5
    assert not is_sampled_string_stable(gains, rho, tau_max, below)
    found = critical_period(gains, rho, tau_max)
    assert 0.9 * below < found < below
    assert largest_growth(gains, rho, lags, 0.9999 * found)[0] <= 1 + 1e-9
    loss = critical_loss(gains, rho, tau_max, 0.9 * found)
    held = {"held": 1 - 0.999 * loss}
    assert largest_growth(gains, rho, lags, 0.9 * found, **held)[0] <= 1 + 1e-9


@given(st.floats(0.5, 1.5), st.floats(0.2, 1.5), st.floats(-4, 0).map(math.exp), st.floats(0, 0.9))
@settings(max_examples=2 * settings().max_examples)
def test_a_short_period_changes_nothing(h, k_v, k_p, k):
    gains = Gains(h, k, k_v, k_p)
    margin = l2_gain(gains, 0.5, k).gain
    sampled = bool(sampled_stability_map(h, k_v, k_p, 0.5, k, period=1e-7))
    if margin > 1 + 1e-6:
        assert not sampled
    if is_string_stable(gains._replace(k_v=k_v * 0.999), 0.5, k) and is_string_stable(
        gains._replace(k_v=k_v * 1.001), 0.5, k
    ):
        assert sampled


def test_edges():
    unstable = A._replace(time_headway=0.65)
    assert critical_period(unstable, 5.0, 0.5) == 0
    assert not is_sampled_string_stable(unstable, 5.0, 0.5, 0.01)
    assert not is_sampled_string_stable(A, 5.0, 0.5, 1e6)
    assert is_sampled_string_stable(A, 5.0, 0.5, 1e-9)
    assert critical_period(A, 5.0, 0.5, k_effective=0.5) > critical_period(A, 5.0, 0.5)
    assert critical_period(A._replace(k_a=0.0, time_headway=3.0, k_v=0.4), 1.0001, 0.5) > 0.1
    tiny = Gains(9.5e-4, 0.5, 630.0, 9000.0)  # case A on a clock a thousand times faster
    assert critical_period(tiny, 5.0, 5e-4) == pytest.approx(critical_period(A, 5.0, 0.5) / 1e3)
    assert is_robustly_string_stable(tiny, 5.0, 5e-4)
    with pytest.raises(DesignError, match="period = 0 s"):
        is_sampled_string_stable(A, 5.0, 0.5, 0.0)


@pytest.mark.parametrize("gains", [(0.95, 0.5, 0.63, 1e200), (0.95, 1e200, 0.63, 0.009)])
def test_what_overflows_is_not_stable_and_warns_of_nothing(gains):
    headway, k_a, k_v, k_p = gains
    answer = sampled_stability_map(headway, k_v, k_p, 0.5, k_a, period=[0.01, 0.1])
    assert not answer.any()
