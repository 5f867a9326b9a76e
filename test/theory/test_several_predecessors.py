"""Several predecessors, lost packets and mixed platoons, from their own equations."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cacc_platoon.model import Gains
from cacc_platoon.theory import (
    DesignError,
    Hop,
    certify,
    certify_chain,
    equivalent_gains,
    fallback_headway,
    first_followers_gains,
    frequency_response,
    hold_last_response,
    is_reception_string_stable,
    is_robustly_string_stable,
    is_string_stable,
    k_a_max,
    l2_gain,
    minimum_headway,
    multi_predecessor_bounds,
    multi_predecessor_gains,
    optimum,
    reception_interval,
    reception_minimum_headway,
    robust_string_stability_map,
    several_predecessors_growth,
)
from cacc_platoon.theory.several_predecessors import hop_responses

A = Gains(0.95, 0.5, 0.63, 0.009)
OMEGA = np.geomspace(1e-3, 30, 200)


@pytest.mark.parametrize("r", [1, 2, 3, 5])
def test_each_predecessor_carries_its_share_of_the_equivalent_hop(r):
    """The law with r predecessors, transformed term by term."""
    gains, tau, w = Gains(0.6, 0.8 / r, 0.9 / r, 0.1 / r), 0.4, 1.05
    h, k_a, k_v, k_p = gains
    for omega in (0.01, 0.3, 2.0, 11.0):
        s = 1j * omega
        own = tau * s**3 + s**2 + sum(k_v * s + k_p + k_p * j * h * s for j in range(1, r + 1))
        share = (k_a * w * s**2 + k_v * s + k_p) / own
        equivalent = equivalent_gains(gains, r)
        H = complex(frequency_response(equivalent, tau, equivalent.k_a * w, omega))
        assert r * share == pytest.approx(H, rel=1e-12)
    assert multi_predecessor_gains(equivalent_gains(gains, r), r) == pytest.approx(gains)


@pytest.mark.parametrize("r", [1, 2, 4])
def test_bounds_for_several_predecessors(r):
    k_a, rho, tau_max = 0.5 / r, 5.0, 0.5
    bounds = multi_predecessor_bounds(k_a, rho, tau_max, r)
    assert bounds.paper == pytest.approx(2 / (r + 1) * 0.9375)
    assert bounds.exact == pytest.approx(4 * tau_max / ((1 + r) * (1 + 0.8 * r * k_a)))
    assert bounds.exact == pytest.approx(2 / (r + 1) * minimum_headway(0.5, rho, tau_max))
    assert bounds.optimal_k_a == pytest.approx(optimum(rho, tau_max).k_a / r)
    assert bounds.k_a_max == pytest.approx(k_a_max(rho) / r)
    for factor, works in ((1.01, True), (0.99, False)):
        h, k, _, _ = equivalent_gains(Gains(factor * bounds.exact, k_a, 1, 1), r)
        k_v, k_p = np.geomspace(1e-2, 10, 800), np.geomspace(1e-2, 1e3, 200)[:, np.newaxis]
        stable = robust_string_stability_map(k, h, k_v, k_p, rho=rho, tau_max=tau_max)
        assert stable.any() == works


@given(st.floats(0, 1), st.floats(0.1, 0.8), st.floats(1.2, 50))
def test_lost_packets_widen_the_interval_and_lengthen_the_headway(p, share, rho):
    k_a = share * k_a_max(rho)
    low, high = reception_interval(k_a, rho, p)
    assert low == pytest.approx(p * (1 - 1 / rho) * k_a)
    assert high == pytest.approx((1 + 1 / rho) * k_a)
    headway = reception_minimum_headway(k_a, rho, 0.5, p)
    assert minimum_headway(k_a, rho, 0.5) <= headway * (1 + 1e-12)
    assert headway <= fallback_headway(0.5) == 1.0


def test_reception_certificate_covers_every_reception_above():
    gains = Gains(1.1, 0.5, 0.62, 0.05)
    assert is_reception_string_stable(gains, 5.0, 0.5, 0.9)
    for p in np.linspace(0.9, 1, 11):
        for w in (0.8, 1.0, 1.2):
            assert is_string_stable(gains, 0.5, float(p * w * gains.k_a))
    assert not is_reception_string_stable(gains, 5.0, 0.5, 0.3)


def test_hold_last_is_the_mean_of_simulated_receivers():
    p, period, omega = 0.6, 0.1, 2.0
    rng = np.random.default_rng(1)
    steps, runs = 300, 4000
    sent = np.exp(1j * omega * period * np.arange(steps))
    held, output = np.zeros(runs, complex), np.zeros(steps, complex)
    for i in range(steps):
        held = np.where(rng.random(runs) < p, sent[i], held)
        output[i] = held.mean()
    response = np.mean(output[100:] / sent[100:])
    assert response == pytest.approx(hold_last_response(p, period, omega), abs=0.005)
    assert hold_last_response(1.0, period, omega) == 1


def test_mixed_platoon_is_certified_link_by_link():
    links = [Hop(A, 0.5, 0.52), Hop(A, 0.2, 0.45), Hop(A, 0.5, 0.3)]
    certificate = certify_chain(links)
    assert not certificate.string_stable
    assert certificate.weakest == 3
    assert certificate.hop_gains == tuple(l2_gain(*link).gain for link in links)
    product = np.prod([np.abs(frequency_response(*link, OMEGA)) for link in links], axis=0)
    assert certificate.end_to_end_gain >= product.max()
    assert certificate.end_to_end_gain <= math.prod(certificate.hop_gains)
    assert certify_chain(links[:2]).string_stable
    assert certify_chain(links[:2]).end_to_end_gain == 1.0


def test_mixed_platoon_that_is_unstable_inside_has_no_finite_gain():
    unstable = Gains(0.2, 0.5, 0.01, 5.0)
    assert certify_chain([Hop(unstable, 0.5, 0.5)]).end_to_end_gain == math.inf
    with pytest.raises(DesignError, match="links"):
        certify_chain([])


def test_smaller_lags_keep_string_stability():
    assert all(certify(A, 5.0, tau).string_stable for tau in (0.01, 0.1, 0.3, 0.5))
    assert not certify(A, 5.0, 0.6).string_stable


def test_no_v2v_needs_twice_the_lag():
    assert is_robustly_string_stable(Gains(1.001, 0.0, 1.0, 0.3), 5.0, 0.5)
    k_v, k_p = np.geomspace(1e-2, 10, 800), np.geomspace(1e-3, 1e2, 200)[:, np.newaxis]
    assert not robust_string_stability_map(0.0, 0.999, k_v, k_p, rho=5, tau_max=0.5).any()


@pytest.mark.parametrize(
    "call",
    [
        lambda: equivalent_gains(A, 0),
        lambda: multi_predecessor_bounds(0.5, 5.0, 0.5, 2),
        lambda: reception_interval(0.5, 5.0, 1.1),
        lambda: reception_interval(0.5, 5.0, math.nan),
        lambda: hold_last_response(0.0, 0.1, 1.0),
        lambda: fallback_headway(0.0),
    ],
)
def test_refusals(call):
    with pytest.raises(DesignError, match=r" (Give|Lower) "):
        call()


@pytest.mark.slow
@given(st.integers(2, 4), st.floats(0.3, 1.2), st.floats(0.05, 0.7), st.floats(0.2, 1.5))
@settings(max_examples=25)
def test_growth_with_several_predecessors_is_that_of_the_recursion(r, h, k_total, k_v):
    """A wave along 600 vehicles, ``x_i = sum_j H_j x_{i-j}``, at the frequency that grows most."""
    gains = Gains(h, k_total / r, k_v / r, 0.4 / r)
    growth, total = several_predecessors_growth(gains, 0.5, [gains.k_a] * r)
    assert growth <= total + 1e-12
    omega = np.geomspace(0.02, 20, 3000)
    H = hop_responses(gains, 0.5, [gains.k_a] * r, omega)
    summed = frequency_response(equivalent_gains(gains, r), 0.5, k_total, omega)
    np.testing.assert_allclose(H.sum(axis=0), summed, rtol=1e-9)
    waves = [np.ones(omega.size, complex)] + [np.zeros(omega.size, complex)] * (r - 1)
    logs = []
    for _ in range(600):
        new = sum(h_j * wave for h_j, wave in zip(H, waves[::-1], strict=True))
        waves = [*waves[1:], new]
        logs.append(np.log(np.maximum(np.abs(new), 1e-250)))
    rate = (logs[-1] - logs[-201]) / 200
    assert np.exp(rate.max()) <= growth + 1e-3
    if growth > 1.02:
        assert np.exp(rate.max()) == pytest.approx(growth, rel=5e-3)


def test_the_exact_criterion_allows_what_the_sum_does_not():
    gains = Gains(0.5138, 0.15, 0.1419, 2.371)
    growth, total = several_predecessors_growth(gains, 0.5, [0.15, 0.15])
    assert growth == 1.0
    assert total == pytest.approx(1.167, abs=1e-3)
    single = several_predecessors_growth(A, 0.5, [0.5])
    assert single[0] == pytest.approx(single[1])


def test_the_first_followers_may_amplify_with_the_gains_of_the_others():
    design = equivalent_gains(Gains(0.4, 0.5 / 3, 0.25, 0.3), 3)
    gains = multi_predecessor_gains(design, 3)
    found = first_followers_gains(gains, 0.5, gains.k_a, 3)
    assert len(found) == 2
    for heard, gain in enumerate(found, start=1):
        omega = np.geomspace(1e-2, 30, 4000)
        H = hop_responses(gains, 0.5, [gains.k_a] * heard, omega).sum(axis=0)
        assert gain == pytest.approx(max(1.0, np.abs(H).max()), rel=1e-4)
    assert found[0] > found[1] > 1
