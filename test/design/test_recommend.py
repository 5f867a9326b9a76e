"""Recommended designs keep what they promise; impossible wishes are refused in words."""

import math
import time
import timeit

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cacc_platoon.design import Requirements, assess, paper_design, recommend
from cacc_platoon.design.candidates import Candidates, Estimates, sample_region
from cacc_platoon.design.pareto import pareto_front, spread_out
from cacc_platoon.model import Gains
from cacc_platoon.simulation.brute_force import largest_growth
from cacc_platoon.theory import (
    DesignError,
    certify,
    infimum_headway,
    is_robustly_string_stable,
    optimum,
)
from cacc_platoon.theory.multirate import estimated_growth


@pytest.mark.parametrize(
    ("rho", "tau_max", "ask"),
    [
        (5.0, 0.5, Requirements()),
        (5.0, 0.5, Requirements(period=0.05, latency=0.1)),
        (5.0, 0.5, Requirements(k_a=0.5, max_linf=1.001)),
        (5.0, 0.5, Requirements(time_headway=0.8, max_time_constant=10.0)),
        (1.01, 0.5, Requirements()),
        (1e9, 0.5, Requirements(max_headway=0.9)),
        (5.0, 0.5, Requirements(reception=0.5)),
        (5.0, 0.5, Requirements(reception=0.6, hold=True, latency=0.02, period=0.02)),
    ],
)
def test_every_design_is_certified_and_meets_the_requirements(rho, tau_max, ask):
    found = recommend(rho, tau_max, ask)
    assert [design.name for design in found.designs] == ["paper", "shortest", "robust", "balanced"]
    for design in (*found.front, *found.designs[1:]):
        assert design.unmet == ()
        assert is_robustly_string_stable(design.gains, rho, tau_max, reception=ask.counted_as_zero)
        assert not growth_of(design.gains, rho, tau_max, ask)
        assert design.certificate.linf_gain <= (ask.max_linf or math.inf)
        assert design.certificate.slowest_time_constant <= (ask.max_time_constant or math.inf)
        assert design.gains.time_headway <= (ask.max_headway or 2.5 * tau_max) * (1 + 1e-12)
        assert ask.k_a in (None, design.gains.k_a)
        assert ask.time_headway in (None, design.gains.time_headway)
    shortest = found["shortest"].gains.time_headway
    assert shortest == min(design.gains.time_headway for design in found.front)
    assert shortest > infimum_headway(rho, tau_max, reception=ask.counted_as_zero)
    costs = np.array([design.costs for design in found.front])
    assert len(pareto_front(costs)) == len(costs)


def test_the_shortest_beats_the_paper_when_the_exact_theory_allows():
    found = recommend(5.0, 0.5)
    assert found["shortest"].gains.time_headway < 0.66 < optimum(5.0, 0.5).time_headway
    robust, paper = found["robust"].certificate, found["paper"].certificate
    assert robust.joint_latency_margin > 5 * paper.joint_latency_margin


def test_the_papers_design_is_in_its_region_and_near_its_optimum():
    for rho in (1.001, 2.0, 5.0, 1e4):
        gains = paper_design(rho, 0.5)
        assert certify(gains, rho, 0.5).in_paper_region
        assert gains.time_headway == pytest.approx(optimum(rho, 0.5).time_headway * 1.01)


@pytest.mark.parametrize(
    ("rho", "tau_max", "ask", "words"),
    [
        (5.0, 0.5, Requirements(max_headway=0.6), ["0.6 s", "tau_0 (1 + 1/rho)", "Raise"]),
        (5.0, 0.5, Requirements(k_a=0.5, max_headway=0.71), ["0.714286 s", "(1 - 1/rho) k_a"]),
        (5.0, 0.5, Requirements(k_a=0.9), ["k_a = 0.9", "0.833333", "Lower k_a"]),
        (5.0, 0.5, Requirements(period=0.5), ["period = 0.5 s", "out of reach", "Relax"]),
        (5.0, 0.5, Requirements(k_a=0.5, latency=3.0), ["latency + period = 3.01 s", "best"]),
        (5.0, 0.5, Requirements(max_linf=0.9), ["max_linf = 0.9", ">= 1"]),
        (5.0, 0.5, Requirements(max_time_constant=0.1), ["max_time_constant = 0.1 s", "best"]),
        (5.0, 0.5, Requirements(max_headway=0.7, max_linf=1.0), ["max_linf = 1 ", "best"]),
        (5.0, 0.001, Requirements(), ["period = 0.01 s", "out of reach"]),
        (5.0, 0.5, Requirements(max_headway=0.6000001), ["0.6000001", "Raise max_headway"]),
        (math.inf, 0.5, Requirements(), ["finite SNR"]),
        (math.nan, 0.5, Requirements(), ["rho = nan"]),
        (5.0, math.nan, Requirements(), ["tau_max = nan"]),
        (5.0, 0.5, Requirements(latency=math.nan), ["latency = nan"]),
        (5.0, 0.5, Requirements(time_headway=-1.0), ["time_headway = -1"]),
    ],
)
def test_impossible_wishes_are_refused_in_words(rho, tau_max, ask, words):
    with pytest.raises(DesignError) as refusal:
        recommend(rho, tau_max, ask)
    text = str(refusal.value)
    assert all(word in text for word in words), text
    assert "\n" not in text


def growth_of(gains, rho, tau_max, ask):
    """Brute force of what is asked, jointly: the largest excess of |H_T| over lags and ages."""
    lags = np.array([1e-3, 0.1, 0.3, 0.6, 1.0]) * tau_max
    oldest = math.floor(ask.latency / ask.period + 1e-9) + 1
    known = {"held": ask.held, "reception": ask.counted_as_zero}
    return (
        max(
            largest_growth(gains, rho, lags, ask.period, age=age, **known)[0] - 1
            for age in (0, oldest // 2, oldest)
        )
        > 1e-7
    )


A = Gains(0.95, 0.5, 0.63, 0.009)
STABLE = {"latency margin", "critical period", "headway", "L-infinity gain", "slowest"}


@pytest.mark.parametrize(
    ("ask", "missed"),
    [
        (Requirements(period=0.04, latency=0.0079), set()),
        (Requirements(period=0.04, latency=0.0081), {"latency margin", "critical period"}),
        (Requirements(period=0.0444), {"latency margin", "critical period"}),
        (Requirements(max_headway=0.949), {"headway"}),
        (Requirements(max_linf=1.0395), {"L-infinity gain"}),
        (Requirements(max_linf=1.0396, max_time_constant=69.3), {"slowest"}),
    ],
)
def test_requirements_read_the_certificate(ask, missed):
    """Case A: critical period 44.3 ms with the acceleration one period old of docs/theory.md,
    section 7 (V2V latency), L-infinity gain 1.0396 of docs/theory.md, section 5 (Gains between
    energies and between peaks), and a slowest mode of 69.36 s.
    """
    unmet = ask.unmet(ask.certify(A, 5.0, 0.5))
    assert {name for name in STABLE if any(line.startswith(name) for line in unmet)} == missed
    assert len(unmet) == len(missed)
    assert assess(A, 5.0, 0.5, ask).unmet == unmet


def test_a_design_that_is_not_string_stable_misses_that_first():
    unmet = Requirements().unmet(certify(A._replace(time_headway=0.65), 5.0, 0.5))
    assert unmet[0] == "not robustly string stable"


def test_a_name_that_is_not_recommended_is_refused():
    with pytest.raises(DesignError, match="paper, shortest, robust, balanced"):
        recommend(5.0, 0.5, Requirements(k_a=0.5))["best"]


@given(st.lists(st.tuples(*[st.integers(0, 4)] * 3), min_size=1, max_size=40))
@settings(max_examples=2 * settings().max_examples)
def test_front_is_what_nobody_dominates(rows):
    costs = np.array(rows, dtype=float)
    expected = [
        i
        for i, row in enumerate(costs)
        if not any(np.all(other <= row) and np.any(other < row) for other in costs)
    ]
    assert pareto_front(costs).tolist() == expected
    picked = {rows[i] for i in spread_out(costs, 5)}
    assert len(picked) == len(spread_out(costs, 5)) >= min(3, len(set(rows)))


def test_estimates_are_close_to_the_certificates():
    designs = [
        Gains(0.95, 0.5, 0.63, 0.009),
        Gains(1.2, 0.4, 0.6, 0.3),
        Gains(0.75, 0.6, 0.6, 1.5),
        Gains(0.88, 0.318305009, 0.85, 0.003),
    ]
    columns = Candidates(*(np.array(column) for column in zip(*designs, strict=True)))
    estimates = Estimates(5.0, 0.5)
    exact = [certify(gains, 5.0, 0.5) for gains in designs]
    periods = [one.joint_critical_period for one in exact]
    margins = [one.joint_latency_margin for one in exact]
    joint = estimates.joint_latency_margin(columns, 0.01)
    slowest = [one.slowest_time_constant for one in exact]
    pairs = (
        (estimates.latency_margin(columns), [one.latency_margin for one in exact], 0.05),
        (joint, margins, 0.05),
        (estimates.critical_period(columns, joint, 0.0, 0.01), periods, 0.3),
        (estimates.linf_gain(columns), [one.linf_gain for one in exact], 0.05),
        (estimates.slowest_time_constant(columns), slowest, 1e-9),
    )
    for estimate, value, tolerance in pairs:
        assert estimate == pytest.approx(value, rel=tolerance)


@pytest.mark.parametrize(("interval", "late"), [(2, 0.0), (30, 0.1), (100, 0.0)])
def test_candidates_bear_packets_at_every_lag_and_end(interval, late):
    """The search drops what the largest lag tells; here the other one decides of some."""
    k_p, fractions = np.geomspace(3e-3, 100.0, 12), np.array([0.03, 0.3, 0.6, 0.9])
    headways = np.array([0.75, 0.9, 1.1, 1.4])
    one = sample_region([0.2, 0.5, 0.7], headways, k_p, fractions, rho=5.0, tau_max=0.5)
    estimates = Estimates(5.0, 0.5)
    angle = estimates._frequencies(one, 32, np.pi / (0.01 * interval)) * 0.01 * interval
    growth = estimated_growth(
        tuple(column[:, np.newaxis] for column in one),
        np.array([0.15, 0.5])[:, np.newaxis, np.newaxis, np.newaxis],
        np.multiply.outer([0.8, 1.2], one.k_a)[:, :, np.newaxis],
        angle,
        period=0.01,
        interval=interval,
        latency=late,
        held=1.0,
    )
    at_each_lag = growth.max(axis=(1, 3)) <= 1.0 + 1e-9
    found = estimates.bears_packets(one, 0.01, interval, late)
    assert found.tolist() == at_each_lag.all(axis=0).tolist()
    assert found.sum() < at_each_lag[1].sum() < len(one)


def test_the_same_question_has_the_same_answer():
    ask = Requirements(k_a=0.5, period=0.02)
    assert recommend(5.0, 0.5, ask) == recommend(5.0, 0.5, ask)


def test_speed():
    assert timeit.timeit(lambda: recommend(5.0, 0.5), number=1, timer=time.process_time) < 5
