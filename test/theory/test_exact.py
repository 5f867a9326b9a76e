"""The exact test and both gains, against brute force, python-control and simulation."""

import math
import time
import timeit

import control
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from cacc_platoon.model import Gains
from cacc_platoon.theory import (
    TOLERANCE,
    certify,
    frequency_response,
    is_internally_stable,
    is_robustly_string_stable,
    is_string_stable,
    l2_gain,
    linf_gain,
    poles,
    propagation_margins,
    robust_string_stability_map,
    slowest_time_constant,
    string_stability_map,
    worst_l2_gain,
)
from cacc_platoon.theory.impulse import inverse_laplace

A = Gains(0.95, 0.5, 0.63, 0.009)
OMEGA = np.geomspace(1e-4, 1e3, 500)


def logs(low, high):
    return st.floats(math.log(low), math.log(high)).map(math.exp)


GAINS = st.builds(Gains, logs(0.2, 4), st.floats(0.0, 0.9), logs(5e-3, 5), logs(1e-4, 10))
TAUS = logs(0.02, 2)
RHOS = logs(1.05, 1e3)


def magnitudes(gains, tau, k):
    """Evaluate |N/D| straight from the polynomials."""
    h, _, k_v, k_p = gains
    s = 1j * OMEGA
    return np.abs(np.polyval([k, k_v, k_p], s) / np.polyval([tau, 1, k_v + h * k_p, k_p], s))


@given(GAINS, TAUS, st.floats(0.0, 1.2))
@settings(max_examples=15 * settings().max_examples)
@example(A, 0.5, 0.4)
@example(A, 0.5, 0.6)
def test_verdict_has_a_witness_or_survives_every_frequency(gains, tau, k):
    stable = is_string_stable(gains, tau, k)
    roots = np.roots([tau, 1, gains.k_v + gains.time_headway * gains.k_p, gains.k_p])
    if not is_internally_stable(gains, tau):
        assert not stable
        assert np.max(roots.real) > -1e-9
        return
    assert np.max(roots.real) < 1e-9
    if stable:
        assert magnitudes(gains, tau, k).max() <= 1 + 1e-10
        return
    gain, omega = l2_gain(gains, tau, k)
    _, C, margin = propagation_margins(gains, tau, k)
    assert gain > 1 or min(C / gains.k_p, margin) > -1e-6  # an excess below rounding
    if gain < 1e4:  # a resonance sharper than that is not resolved by rounded coefficients
        assert abs(frequency_response(gains, tau, k, omega)) == pytest.approx(gain, rel=1e-9)


@given(GAINS, TAUS, RHOS, st.floats(0.01, 1), st.floats(0, 1))
@settings(max_examples=15 * settings().max_examples)
def test_robust_verdict_holds_inside_and_fails_at_a_corner(gains, tau_max, rho, lag, place):
    low, high = (1 - 1 / rho) * gains.k_a, (1 + 1 / rho) * gains.k_a
    if is_robustly_string_stable(gains, rho, tau_max):
        k = low + place * (high - low)
        assert is_internally_stable(gains, lag * tau_max)
        assert magnitudes(gains, lag * tau_max, k).max() <= 1 + 1e-10
    else:
        corners = [is_string_stable(gains, tau_max, k) for k in (low, high)]
        assert high > 1 or not all(corners)


@given(GAINS, TAUS, RHOS)
@settings(max_examples=3 * settings().max_examples)
def test_worst_gain_is_the_worst_of_a_grid_of_lags_and_gains(gains, tau_max, rho):
    worst = worst_l2_gain(gains, rho, tau_max).gain
    low, high = (1 - 1 / rho) * gains.k_a, (1 + 1 / rho) * gains.k_a
    if not is_internally_stable(gains, tau_max):
        assert worst == math.inf
        return
    found = max(
        l2_gain(gains, tau, k).gain
        for tau in tau_max * np.array([0.003, 0.2, 0.6, 0.9, 1.0])
        for k in (low, (low + high) / 2, high)
    )
    assert found <= worst * (1 + 1e-12)


def test_above_the_cap_too_the_largest_lag_is_the_worst():
    gains = Gains(3.0, 1.2, 0.2, 0.1)
    worst = worst_l2_gain(gains, 5.0, 0.5)
    assert worst == l2_gain(gains, 0.5, 1.44)
    assert worst.gain > l2_gain(gains, 5e-4, 1.44).gain > 1.44


def test_thousands_of_designs_map_and_scalar_agree_with_frequency_sampling():
    rng = np.random.default_rng(7)
    n = 3000
    h, k_v, k_p, tau = (
        np.exp(rng.uniform(np.log(lo), np.log(hi), n))
        for lo, hi in ((0.3, 3), (0.02, 3), (1e-3, 5), (0.05, 1.5))
    )
    k = rng.uniform(0, 1, n)
    found = string_stability_map(h, k_v, k_p, tau, k)
    s = 1j * np.geomspace(1e-4, 1e3, 1500)[:, np.newaxis]
    H = ((k * s + k_v) * s + k_p) / (((tau * s + 1) * s + k_v + h * k_p) * s + k_p)
    internally = k_v + h * k_p > tau * k_p
    excess = np.abs(H).max(axis=0) - 1
    B = 1 - k**2 - 2 * tau * (k_v + h * k_p)
    C = k_p * (h * (2 * k_v + h * k_p) - 2 * (1 - k))
    margin = np.minimum(C / k_p, B + 2 * tau * np.sqrt(np.maximum(C, 0)))
    clear = np.abs(margin) > 1e-3  # sampled frequencies miss a peak narrower than their spacing
    assert np.array_equal(found[clear], (internally & (excess <= 1e-9))[clear])
    assert 500 < found.sum() < 2500
    assert clear.sum() > 2900
    scalar = [
        is_string_stable(Gains(*g), t, x) for *g, t, x in zip(h, k, k_v, k_p, tau, k, strict=True)
    ]
    assert found.tolist() == scalar


@pytest.mark.parametrize("seed", range(40))
def test_l2_gain_against_python_control(seed):
    rng = np.random.default_rng(seed)
    h, k_v, k_p, tau = np.exp(rng.uniform(np.log([0.3, 0.05, 1e-3, 0.1]), np.log([2, 2, 2, 1])))
    k = rng.uniform(0, 1)
    gains = Gains(h, k, k_v, k_p)
    system = control.tf([k, k_v, k_p], [tau, 1, k_v + h * k_p, k_p])
    gain, _ = l2_gain(gains, tau, k)
    if not is_internally_stable(gains, tau):
        assert gain == math.inf
        return
    reference = control.norm(system, p="inf", tol=1e-10, print_warning=False)
    assert gain == pytest.approx(reference, rel=1e-9)


def simulated_l1_norm(gains, tau, k):
    """Integrate |h| over steps of the matrix exponential, no modes and no zeros involved."""
    h, _, k_v, k_p = gains
    damping = k_v + h * k_p
    A = np.array([[0, 1, 0], [0, 0, 1], [-k_p / tau, -damping / tau, -1 / tau]])
    read = np.array([k_p, k_v, k]) / tau
    rates = -np.linalg.eigvals(A).real
    total, state, t = 0.0, np.array([0.0, 0.0, 1.0]), 0.0
    step, end = 1e-4 / np.abs(np.linalg.eigvals(A)).max(), 40 / rates.min()
    while t < end:  # the step doubles every 2000, as fast modes die
        move, half = expm(A * step), expm(A * step / 2)
        states = np.empty((2001, 3))
        for i in range(2001):
            states[i] = state
            state = move @ state
        state = states[-1]
        ends, middles = np.abs(states @ read), np.abs(states[:-1] @ half.T @ read)
        total += step / 6 * np.sum(ends[:-1] + 4 * middles + ends[1:])
        t += 2000 * step
        if 2 * step < 0.02 / np.abs(np.linalg.eigvals(A).imag + 0.05 * rates.min()).max():
            step *= 2
    return total


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gains", "tau", "k"),
    [
        (A, 0.5, 0.524),
        (A._replace(time_headway=0.65), 0.5, 0.6),
        (Gains(1.2, 0.5, 0.4, 2.0), 0.5, 0.7),
        (Gains(0.6, 0.5, 0.05, 0.8), 0.5, 0.9),
        (Gains(0.9, 0.5, 0.7, 1 / 3), 1 / 3, 0.5),  # one triple pole
        (Gains(1.0, 0.5, 0.75, 0.5), 0.2, 0.2),  # D = 0.2 (s + 0.5...)(...): real poles
    ],
)
def test_l1_norm_against_a_simulated_impulse_response(gains, tau, k):
    assert linf_gain(gains, tau, k) == pytest.approx(simulated_l1_norm(gains, tau, k), rel=2e-6)


@pytest.mark.parametrize(
    "roots",
    [
        [-1.0, -1.0, -1.0],
        [-1.0, -1.0 - 1e-7, -1.0 + 2e-7],
        [-0.3, -0.7, -2.0],
        [-0.01, -5.0, -5.0],
        [-0.5 + 2j, -0.5 - 2j, -0.6],
        [-0.5 + 1e-6j, -0.5 - 1e-6j, -3.0],
    ],
)
def test_time_functions_against_the_matrix_exponential(roots):
    """Poles apart, in pairs and meeting: divided differences against a companion matrix."""
    numerator, t = np.array([0.7, -1.3, 0.4]), np.geomspace(1e-3, 30, 40)
    _, a2, a1, a0 = np.poly(roots).real
    companion = np.array([[0, 1, 0], [0, 0, 1], [-a0, -a1, -a2]])
    expected = [numerator[::-1] @ expm(companion * x) @ [0, 0, 1] for x in t]
    found = inverse_laplace(numerator[np.newaxis], np.array([roots], complex), t[np.newaxis])
    assert found[0] == pytest.approx(expected, rel=1e-9, abs=1e-11)


def test_a_geometric_tail_replaces_endless_ringing(monkeypatch):
    ringing = Gains(0.5, 0.5, 0.003, 1.0)  # gamma barely above tau k_p
    whole = linf_gain(ringing, 0.5, 0.5)
    monkeypatch.setattr("cacc_platoon.theory.impulse._MAX_HALF_PERIODS", 60)
    assert linf_gain(ringing, 0.5, 0.5) == pytest.approx(whole, rel=1e-10)
    assert whole > 100


def test_modes_too_far_apart_are_refused():
    assert is_string_stable(Gains(0.95, 0.5, 0.635, 1e-300), 0.5, 0.5)  # the test itself is exact
    with pytest.raises(ValueError, match="too far apart"):
        linf_gain(Gains(0.95, 0.5, 0.635, 1e-300), 0.5, 0.5)


def test_two_zeros_close_together_are_both_found():
    gains = Gains(2.8187722595837874, 0.7196066164883864, 2.433448772540675, 0.2702204772692205)
    norm = linf_gain(gains, 0.3580341798124778, gains.k_a)  # a grid alone gives 1.526945
    assert norm == pytest.approx(1.5269572, abs=1e-7)


@given(GAINS, TAUS, st.floats(0.0, 1.0))
def test_l_infinity_gain_is_at_least_the_l2_gain(gains, tau, k):
    assert linf_gain(gains, tau, k) >= l2_gain(gains, tau, k).gain * (1 - 1e-10)


@given(st.floats(-1e-7, 1e-7), st.floats(-1e-7, 1e-7), st.floats(0, 1))
@settings(max_examples=50)
def test_poles_about_to_meet_do_not_shake_the_l1_norm(d_tau, d_gain, k):
    exact = linf_gain(Gains(0.9, 0.5, 0.7, 1 / 3), 1 / 3, k)
    near = linf_gain(Gains(0.9, 0.5, 0.7 + d_gain, 1 / 3), 1 / 3 + d_tau, k)
    assert near == pytest.approx(exact, abs=1e-5)


def test_h_of_zero_is_one_and_that_is_stable():
    for k in (0.4, 0.5, 0.6):
        assert frequency_response(A, 0.5, k, 0.0) == 1
        assert l2_gain(A, 0.5, k) == (1.0, 0.0)


@pytest.mark.parametrize("end", [0.4, 0.6])
@pytest.mark.parametrize("factor", [1 - 1e-9, 1 + 1e-9])
def test_rounding_at_the_boundary_is_tolerated_and_nothing_more(end, factor):
    h, k_p, tau = 0.95, 0.009, 0.5
    low = (1 - end) / h - h * k_p / 2
    top = (1 - end**2) / (2 * tau) + math.sqrt(2 * k_p * ((1 - end**2) / (2 * tau) * h - 1 + end))
    assert is_string_stable(Gains(h, end, low, k_p), tau, end)
    assert is_string_stable(Gains(h, end, top, k_p), tau, end)
    assert is_string_stable(Gains(h, end, low * factor, k_p), tau, end) == (factor > 1)
    assert is_string_stable(Gains(h, end, top * factor, k_p), tau, end) == (factor < 1)
    assert TOLERANCE <= 1e-11


def test_edges_have_answers_without_nan_or_warning():
    tiny = Gains(0.95, 0.5, 0.635, 1e-300)
    assert is_robustly_string_stable(tiny, 5, 0.5)
    assert math.isfinite(linf_gain(Gains(0.95, 0.5, 0.635, 1e-12), 0.5, 0.5))
    assert linf_gain(A, 1e-9, 0.5) == pytest.approx(1.0, abs=1e-9)
    assert l2_gain(A, 1e-12, 0.5) == (1.0, 0.0)
    assert not is_string_stable(A._replace(k_p=0.0), 0.5, 0.5)
    assert slowest_time_constant(A._replace(k_p=0.0), 0.5) == math.inf
    assert not is_robustly_string_stable(A._replace(k_a=1 / 1.2), 5, 0.5)  # at the cap
    assert is_robustly_string_stable(A._replace(k_a=0.0, time_headway=2.0), 1 + 1e-12, 0.5)
    assert is_robustly_string_stable(A, 1e300, 0.5)
    assert is_robustly_string_stable(A, math.inf, 0.5)
    unstable = Gains(0.2, 0.5, 0.01, 5.0)
    assert l2_gain(unstable, 0.5, 0.5).gain == linf_gain(unstable, 0.5, 0.5) == math.inf
    assert certify(unstable, 5, 0.5).latency_margin == 0.0


@pytest.mark.slow
@given(GAINS, TAUS, st.floats(1.0, 3.0, exclude_min=True))
@settings(max_examples=3 * settings().max_examples)
def test_no_gain_above_one_is_string_stable_at_any_lag(gains, tau, k):
    """Theorem 2(a), sharpened: one internally stable lag is enough."""
    assert not is_string_stable(gains, tau, k) or k < 1 + 1e-9
    assert not is_string_stable(gains, tau, -k)


@pytest.mark.parametrize("tau", [0.0, -1.0, math.nan, math.inf])
def test_a_lag_without_meaning_is_refused(tau):
    for function in (l2_gain, linf_gain):
        with pytest.raises(ValueError, match=r"tau = .* Give tau > 0"):
            function(A, tau, 0.5)
    with pytest.raises(ValueError, match="tau"):
        poles(A, tau)


def test_maps_broadcast():
    found = robust_string_stability_map(
        [[0.5], [0.9]], 0.95, 0.63, [0.009, 0.03, 9.0], rho=5, tau_max=0.5
    )
    expected = [
        [is_robustly_string_stable(Gains(0.95, a, 0.63, p), 5, 0.5) for p in (0.009, 0.03, 9.0)]
        for a in (0.5, 0.9)
    ]
    assert found.tolist() == expected


def cpu_time(call, number=1):
    """Return the CPU time of a call [s], that other processes lengthen little: the least of 5."""
    return min(timeit.repeat(call, number=number, repeat=5, timer=time.process_time)) / number


@pytest.mark.slow
def test_speed():
    assert cpu_time(lambda: is_robustly_string_stable(A, 5, 0.5), number=200) < 1e-4
    k_p, k_v = np.linspace(0, 1, 500)[:, np.newaxis], np.linspace(0, 1, 500)
    assert (
        cpu_time(lambda: robust_string_stability_map(0.5, 0.95, k_v, k_p, rho=5, tau_max=0.5)) < 0.1
    )
    assert cpu_time(lambda: certify(A, 5, 0.5).parts()) < 0.6
