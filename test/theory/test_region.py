"""The exact region, its area, the headways and the paper's S inside it, against brute force."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cacc_platoon.model import Gains
from cacc_platoon.theory import (
    DesignError,
    conservatism,
    exact_region,
    frequency_response,
    headway_bound,
    in_paper_region,
    infimum_headway,
    is_robustly_string_stable,
    is_string_stable,
    k_a_max,
    minimum_headway,
    optimum,
    paper_region,
    robust_string_stability_map,
    stable_gain_range,
)
from cacc_platoon.theory.exact import propagation_margins
from cacc_platoon.theory.response_band import response_band
from cacc_platoon.theory.theorem2 import gamma_range

A = Gains(0.95, 0.5, 0.63, 0.009)


@st.composite
def questions(draw):
    """Draw k_a, headway, rho, tau_max with the headway around its bounds."""
    rho = math.exp(draw(st.floats(math.log(1.05), math.log(200))))
    tau_max = math.exp(draw(st.floats(math.log(0.05), math.log(2))))
    k_a = draw(st.floats(0.02, 0.97)) * k_a_max(rho)
    headway = minimum_headway(k_a, rho, tau_max) * draw(st.floats(0.8, 2.5))
    return k_a, headway, rho, tau_max


@pytest.mark.slow
@given(questions(), st.floats(-7, 3), st.floats(-0.3, 1.3))
@settings(max_examples=15 * settings().max_examples)
def test_boundaries_agree_with_the_exact_test(question, log_k_p, place):
    k_a, headway, rho, tau_max = question
    k_p = math.exp(log_k_p) / tau_max**2
    region = exact_region(*question)
    low, high = (float(x) for x in region.bounds(k_p))
    assert (low <= high) == (k_p >= region.k_p_min) or abs(k_p / region.k_p_min - 1) < 1e-9
    centre, width = (0.0, 1.0) if not region.nonempty else (low, high - low)
    k_v = centre + place * width
    if k_v > 1e-12:
        inside = low < k_v < high
        distance = min(abs(k_v - low), abs(k_v - high)) if region.nonempty else 1.0
        if distance > 1e-9 * (1 + abs(high)) or not region.nonempty:
            assert region.contains(k_p, k_v) == inside
            gains = Gains(headway, k_a, k_v, k_p)
            assert is_robustly_string_stable(gains, rho, tau_max) == inside


@given(questions(), st.integers(0, 2**32 - 1))
@settings(max_examples=3 * settings().max_examples)
def test_the_papers_region_lies_inside(question, seed):
    k_a, headway, rho, tau_max = question
    region = paper_region(*question)
    assert region.nonempty == (region.a1 > region.a2)
    assert region.nonempty == (headway > headway_bound(k_a, rho, tau_max)) or region.a1 == (
        pytest.approx(region.a2, rel=1e-12)
    )
    if not region.nonempty:
        assert region.area == 0
        return
    corners = np.array(region.polygon)
    weights = np.random.default_rng(seed).dirichlet(np.ones(len(corners)), 20)
    for k_p, k_v in weights @ corners:
        gains = Gains(headway, k_a, k_v, k_p)
        assert in_paper_region(gains, rho, tau_max)
        assert is_robustly_string_stable(gains, rho, tau_max)
    x, y = corners.T
    shoelace = 0.5 * abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1)))
    assert region.area == pytest.approx(shoelace, rel=1e-7)


@given(questions(), st.integers(0, 2**32 - 1))
def test_range_of_gamma_is_where_the_papers_margins_hold(question, seed):
    """B >= 0 and C >= 0 over a grid of k in I, at tau_0; smaller lags only enlarge B."""
    k_a, headway, rho, tau_max = question
    random = np.random.default_rng(seed)
    for _ in range(5):
        gains = Gains(headway, k_a, random.uniform(0.05, 2) / tau_max, random.uniform(1e-3, 2))
        grid = k_a * np.linspace(1 - 1 / rho, 1 + 1 / rho, 41)
        margins = [propagation_margins(gains, tau_max, float(k)) for k in grid]
        slack = min(min(one.B, one.C) for one in margins)
        low, high = gamma_range(k_a, gains.k_v, gains.k_p, rho, tau_max)
        value = gains.k_v + headway * gains.k_p
        if abs(slack) > 1e-9:
            assert (low <= value <= high) == (slack > 0)


def test_range_of_gamma_of_case_a():
    low, high = gamma_range(0.5, A.k_v, A.k_p, 5.0, 0.5)
    assert (round(low, 4), round(high, 4)) == (0.6385, 0.64)
    assert low < A.k_v + A.time_headway * A.k_p < high


@pytest.mark.slow
@pytest.mark.parametrize(
    ("question", "limit"),
    [
        ((0.5, 0.95, 5.0, 0.5), 0.02),
        ((0.5, 0.95, 5.0, 0.5), 4.0),
        ((0.5, 0.75, 5.0, 0.5), 8.0),
        ((0.7, 0.64, 20.0, 0.5), 20.0),
        ((0.1, 2.5, 2.0, 0.8), 5.0),
    ],
)
def test_area_against_counting_stable_designs(question, limit):
    k_a, headway, rho, tau_max = question
    region = exact_region(*question)
    top = float(region.bounds(limit)[1])
    k_p = (np.arange(2000) + 0.5) * limit / 2000
    k_v = (np.arange(1000) + 0.5) * top / 1000
    stable = robust_string_stability_map(
        k_a, headway, k_v, k_p[:, np.newaxis], rho=rho, tau_max=tau_max
    )
    assert region.area(limit) == pytest.approx(stable.mean() * limit * top, rel=4e-3)


def test_minimum_headway_is_attained_and_nothing_shorter_works():
    shortest = minimum_headway(0.5, 5.0, 0.5)
    region = exact_region(0.5, shortest, 5.0, 0.5)
    assert region.nonempty
    low, high = region.bounds(2 * region.k_p_min)
    assert float(low) == pytest.approx(float(high), abs=1e-7)
    assert region.contains(2 * region.k_p_min, (1 - 0.4**2) / (2 * 0.5))
    assert not exact_region(0.5, shortest * (1 - 1e-9), 5.0, 0.5).nonempty
    k_p, k_v = np.geomspace(1e-4, 1e4, 400)[:, np.newaxis], np.geomspace(1e-3, 1e2, 2000)
    below = robust_string_stability_map(0.5, 0.999 * shortest, k_v, k_p, rho=5, tau_max=0.5)
    assert not below.any()


@given(st.floats(1.01, 1e3), st.floats(0.01, 3), st.floats(0, 0.99))
@settings(max_examples=2 * settings().max_examples)
def test_order_of_the_headways(rho, tau_max, share):
    k_a = share * k_a_max(rho)
    exact, paper = minimum_headway(k_a, rho, tau_max), headway_bound(k_a, rho, tau_max)
    assert infimum_headway(rho, tau_max) < exact * (1 + 1e-12)
    assert exact <= paper * (1 + 1e-12)
    assert optimum(rho, tau_max).time_headway <= paper * (1 + 1e-12)
    best = headway_bound(optimum(rho, tau_max).k_a, rho, tau_max)
    assert optimum(rho, tau_max).time_headway == pytest.approx(best, rel=1e-9)


def test_conservatism_of_case_a():
    result = conservatism(0.5, 0.95, 5.0, 0.5)
    assert result.headway == pytest.approx(0.9375 * 1.4)
    assert result.area == pytest.approx(
        7.4646e-5 / exact_region(0.5, 0.95, 5, 0.5).area(0.0177285), rel=1e-4
    )
    assert result.area == pytest.approx(0.0603, abs=5e-5)
    assert conservatism(0.5, 0.8, 5.0, 0.5).area == 0
    assert not paper_region(0.5, 0.9375 * 0.999, 5.0, 0.5).nonempty
    assert paper_region(0.5, 0.9375 * 1.001, 5.0, 0.5).nonempty


def test_smallest_k_p_grows_as_the_headway_shrinks_and_vanishes_at_the_papers_bound():
    headways = np.linspace(minimum_headway(0.5, 5, 0.5), 1.0, 60)
    least = [exact_region(0.5, float(h), 5.0, 0.5).k_p_min for h in headways]
    assert np.all(np.diff(least) <= 0)
    assert exact_region(0.5, 0.9375 * (1 + 1e-12), 5.0, 0.5).k_p_min == 0
    assert exact_region(0.5, 0.93, 5.0, 0.5).k_p_min > 0


@given(questions(), st.floats(-5, 2), st.floats(0.01, 0.99))
@settings(max_examples=3 * settings().max_examples)
def test_tolerated_gains_are_exactly_the_stable_ones(question, log_k_p, place):
    k_a, headway, rho, tau_max = question
    k_p = math.exp(log_k_p) / tau_max**2
    low, high = exact_region(k_a, headway, rho, tau_max).bounds(k_p)
    k_v = float(low + place * (high - low)) if high > low else 0.5 / tau_max
    gains = Gains(headway, k_a, max(k_v, 1e-6), k_p)
    found = stable_gain_range(gains, tau_max)
    k = np.linspace(0, 1, 301)
    stable = np.array([is_string_stable(gains, tau_max, float(x)) for x in k])
    if found is None:
        assert not stable.any()
    else:
        inside = (k >= found[0] - 1e-9) & (k <= found[1] + 1e-9)
        edge = np.minimum(abs(k - found[0]), abs(k - found[1])) < 1e-7
        assert np.array_equal(stable[~edge], inside[~edge])


def test_edges_of_the_region():
    almost = 1.0 + 1e-9
    assert minimum_headway(0.3, almost, 0.5) == pytest.approx(1.0)
    assert not exact_region(0.5, 0.7, 5.0, 0.5).nonempty
    assert exact_region(0.5, 0.7, 5.0, 0.5).area(1.0) == 0
    low, high = exact_region(0.5, 0.7, 5.0, 0.5).bounds(1.0)
    assert low > high
    wide = exact_region(0.5, 0.95, 5.0, 0.5)  # unbounded in k_p
    assert wide.contains(1e6, float(np.mean(wide.bounds(1e6))))
    assert wide.area(1e6) > wide.area(1e5)
    assert paper_region(0.5, headway_bound(0.5, 5, 0.5), 5, 0.5).area == pytest.approx(0, abs=1e-20)
    assert exact_region(0.0, 2.0, 5.0, 0.5).nonempty
    assert exact_region(0.5, 1e3, 5.0, 0.5).k_p_min == 0
    assert stable_gain_range(A._replace(k_p=0.0), 0.5) is None
    assert exact_region(0.5, 2e-6, 5.0, 1e-6).nonempty


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: minimum_headway(1 / 1.2, 5, 0.5), ["0.833333", "Lower k_a"]),
        (lambda: minimum_headway(-0.1, 5, 0.5), ["-0.1", "outside [0"]),
        (lambda: headway_bound(0.5, 1.0, 0.5), ["rho = 1 ", "above 1"]),
        (lambda: headway_bound(math.nan, 5.0, 0.5), ["k_a = nan"]),
        (lambda: exact_region(0.5, 0.0, 5, 0.5), ["time_headway = 0 s"]),
        (lambda: paper_region(0.5, 0.9, math.nan, 0.5), ["rho = nan"]),
        (lambda: optimum(5.0, -1.0), ["tau_max = -1 s"]),
        (lambda: exact_region(0.5, 0.95, 5, 0.5).area(0.0), ["k_p_limit"]),
        (lambda: stable_gain_range(A._replace(k_v=math.nan), 0.5), ["not finite"]),
    ],
)
def test_refusals_say_value_rule_and_remedy(call, words):
    with pytest.raises(DesignError) as refusal:
        call()
    text = str(refusal.value)
    assert all(word in text for word in words), text
    assert "\n" not in text


def test_region_and_band_reach_down_to_the_gains_that_losses_leave():
    """S with p = 0.7 holds exactly the gains that pass Theorem 2 for [0.28, 0.6]."""
    region = paper_region(0.5, 1.3, 5.0, 0.5, reception=0.7)
    assert region.a2 == pytest.approx((1 - 0.28) / 1.3, rel=1e-14)
    assert region.a1 == paper_region(0.5, 1.3, 5.0, 0.5).a1
    for share in (0.1, 0.5, 0.9):
        k_v = region.a2 + share * (region.a1 - region.a2)
        assert in_paper_region(Gains(1.3, 0.5, k_v, 1e-6), 5.0, 0.5, reception=0.7)
    gains = Gains(1.3, 0.5, 0.62, 0.1)
    lossy, whole = (response_band(gains, 5.0, 0.5, reception=p) for p in (0.7, 1.0))
    assert (lossy.low < whole.low - 1e-3).any()
    least = np.abs(frequency_response(gains, 0.5, 0.28, lossy.omega))
    assert (lossy.low <= least).all()
