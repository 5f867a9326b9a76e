"""Period, latency and loss at once: brute force, python-control, and waves in the time domain."""

import math

import control
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cacc_platoon.model import Gains
from cacc_platoon.simulation.brute_force import largest_growth, norm_ratios, response
from cacc_platoon.theory import (
    DesignError,
    exact_region,
    is_robustly_string_stable,
    is_sampled_string_stable,
    joint_critical_period,
    joint_latency_margin,
    latency_margin,
    minimum_headway,
)
from cacc_platoon.theory.joint_loop import joint_headroom

A = Gains(0.95, 0.5, 0.63, 0.009)
C = Gains(0.88, 0.318305009, 0.85, 0.003)
SHORT = Gains(0.684462, 0.791667, 0.0151766, 4.98292)
"""Once recommended for a period of 10 ms and a latency of 50 ms, which it does not bear."""


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


def test_the_brute_force_is_the_loop_of_python_control():
    """Solved from the closed loop's matrices, at some frequencies, ages and losses."""
    period, tau, k = 0.03, 0.4, 0.5
    h, _, k_v, k_p = A
    motion = control.ss(
        [[0, 1, 0], [0, 0, 1], [0, 0, -1 / tau]], [[0], [0], [1 / tau]], np.eye(3), 0
    )
    plant = control.c2d(motion, period, "zoh")
    for w, age, held in ((0.3, 0, 1.0), (2.0, 3, 1.0), (7.0, 2, 0.6)):
        z = np.exp(1j * w * period)
        sent = np.linalg.solve(z * np.eye(3) - plant.A, plant.B)
        heard = sent[2] * z**-age * held / (1 - (1 - held) / z)
        drive = k * heard + k_v * sent[1] + k_p * sent[0]
        closed = plant.A + plant.B @ np.array([[-k_p, -k_v - k_p * h, 0.0]])
        moved = np.linalg.solve(z * np.eye(3) - closed, plant.B * drive)
        mine = response(A, tau, k, period, w, age=age, held=held)
        assert mine == pytest.approx((moved[0] / sent[0])[0], rel=1e-8)


@given(STABLE, st.floats(-5, -1.5), st.floats(0, 1), st.floats(0.1, 1), st.floats(0, 1))
@settings(max_examples=3 * settings().max_examples)
def test_headroom_is_the_first_latency_that_amplifies(draw, size, place, held, end):
    """At one frequency, over latencies up to where the turn of the wave repeats."""
    gains, tau = design_in_the_region(draw)
    period, k = math.exp(size), gains.k_a * (0.8 + 0.4 * end)
    omega = math.pi / period * 10.0 ** (-4.0 * place)
    late = np.linspace(0, 2 * np.pi / omega, 2001)
    size = np.abs(response(gains, tau, k, period, omega, age=late / period, held=held))
    assume(size[0] < 1 - 1e-9)
    h, _, k_v, k_p = gains
    found = float(joint_headroom(h, k_v, k_p, tau, k, period=period, omega=omega, held=held))
    grown = np.flatnonzero(size > 1)
    if not math.isfinite(found):
        assert grown.size == 0
        return
    assert grown.size == 0 or late[grown[0]] >= found * (1 - 1e-6)
    around = found * np.array([1 - 1e-5, 1 + 1e-5]) / period
    early, after = np.abs(response(gains, tau, k, period, omega, age=around, held=held))
    assert early <= 1 + 1e-9
    assert after >= 1 - 1e-9


@pytest.mark.slow
@given(STABLE, st.floats(-6, -2).map(math.exp), st.sampled_from([1.0, 1.0, 0.7, 0.3]))
@settings(max_examples=15)
def test_margin_against_brute_force_on_the_unit_circle(draw, period, held):
    """41 lags, both ends of I, and every age in periods that the margin allows."""
    gains, tau = design_in_the_region(draw)
    margin = joint_latency_margin(gains, 5.0, tau, period, held=held)
    if not is_sampled_string_stable(gains, 5.0, tau, period, held=held):
        assert margin == 0.0
        return
    assume(0 < margin < 200 * period)
    lags = np.linspace(1e-4, 1.0, 41) * tau
    for age in {0, int(margin / period), int(0.5 * margin / period)}:
        growth, _ = largest_growth(gains, 5.0, lags, period, age=age, held=held)
        assert growth <= 1 + 1e-7
    growth, _ = largest_growth(gains, 5.0, lags, period, age=1.02 * margin / period, held=held)
    assert growth > 1


def test_a_lag_between_those_tried_may_be_the_first_to_bear_no_longer():
    """The lags of the grid bear 15.065 ms with an acceleration one period old."""
    gains, rho, tau = Gains(0.478423163, 0.798048327, 0.226812306, 18.6106393), 6.6751164, 0.1950527
    lags = np.linspace(0.004, 0.006, 100)
    assert largest_growth(gains, rho, lags, 0.015035, age=1)[0] > 1 + 1e-4
    found = joint_critical_period(gains, rho, tau)
    assert 0.014 < found < 0.015
    assert largest_growth(gains, rho, lags, 0.9999 * found, age=1)[0] <= 1 + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gains", "rho", "tau", "period", "lags"),
    [
        (
            Gains(0.183694117, 0.896384994, 0.323543098, 55.8518556),
            *(13.726676, 0.06334523, 0.005313363, (0.0011, 0.0018)),
        ),
        (
            Gains(1.40827234, 0.930541396, 0.0343620201, 1.22469744),
            *(32.7512556, 0.850203352, 0.0373465792, (0.008, 0.013)),
        ),
    ],
)
def test_the_worst_lag_is_in_a_valley_askew_to_lag_and_frequency(gains, rho, tau, period, lags):
    age = 0.9999 * joint_latency_margin(gains, rho, tau, period) / period
    between = np.linspace(*lags, 100)
    assert age > 1
    assert largest_growth(gains, rho, between, period, age=age)[0] <= 1 + 1e-9
    assert largest_growth(gains, rho, between, period, age=1.001 * age)[0] > 1


@pytest.mark.parametrize("gains", [A, C])
def test_without_a_period_it_is_the_margin_of_continuous_time(gains):
    limit = latency_margin(gains, 5.0, 0.5)
    for period in (1e-4, 1e-5):
        margin = joint_latency_margin(gains, 5.0, 0.5, period)
        assert limit - 1.5 * period < margin < limit


def test_a_design_that_grows_though_each_of_its_margins_is_kept():
    """0.0681 s of latency and 0.0169 s of period are borne, 0.01 s with 0.05 s are not."""
    assert latency_margin(SHORT, 5.0, 0.5) > 0.05 + 0.01
    assert joint_critical_period(SHORT, 5.0, 0.5) > 0.01
    growth, omega = largest_growth(SHORT, 5.0, [0.5], 0.01, age=5)
    assert growth == pytest.approx(1.014358, abs=1e-4)
    assert omega == pytest.approx(2.389, abs=0.01)
    assert 0.04 < joint_latency_margin(SHORT, 5.0, 0.5, 0.01) < 0.05
    assert joint_critical_period(SHORT, 5.0, 0.5, latency=0.05) < 0.01


@pytest.mark.slow
def test_what_grows_in_theory_grows_in_the_time_domain():
    wave, k = np.cos(2.38926 * 0.01 * np.arange(40_000)), 0.8 * SHORT.k_a
    known = {"vehicles": 12, "since": 40_000 - 10 * 263}  # ten waves
    grown = norm_ratios(SHORT, 0.5, k, 0.01, wave, age=5, **known)
    assert grown == pytest.approx(1.014358, abs=1.5e-4)
    assert np.prod(grown) == pytest.approx(1.014358**12, rel=1e-4)
    kept = norm_ratios(SHORT, 0.5, k, 0.01, wave, age=4, **known)
    assert kept.max() < 1


@given(STABLE, st.sampled_from([0.0, 0.02]), st.sampled_from([(1.0, 1.0), (0.8, 1.0), (1.0, 0.6)]))
@settings(max_examples=10)
def test_critical_period_is_the_first_loss(draw, latency, loss):
    gains, tau = design_in_the_region(draw)
    reception, held = loss
    assume(is_robustly_string_stable(gains, 5.0, tau, reception=reception))
    known = {"reception": reception, "held": held}
    longest = joint_critical_period(gains, 5.0, tau, latency=latency, **known)
    for share in np.linspace(0.05, 0.9999, 12) if longest else ():
        period = float(share * longest)
        margin = joint_latency_margin(gains, 5.0, tau, period, **known)
        assert margin >= (latency + period) * (1 - 1e-6)
    above = longest * (1 + 1e-5) or 1e-6 * tau
    assert joint_latency_margin(gains, 5.0, tau, above, **known) < latency + above


@pytest.mark.parametrize(("gains", "period"), [(A, 0.0443142), (C, 0.0196)])
def test_without_latency_the_acceleration_is_one_period_old(gains, period):
    """The loop of one period's age alone, found by halving with the oracle."""
    low, high = 0.5 * period, 2.0 * period
    lags = np.linspace(0.02, 1.0, 17) * 0.5
    while high - low > 1e-6 * high:
        middle = 0.5 * (low + high)
        growth, _ = largest_growth(gains, 5.0, lags, middle, age=1)
        low, high = (middle, high) if growth <= 1 + 1e-13 else (low, middle)
    assert joint_critical_period(gains, 5.0, 0.5) == pytest.approx(low, rel=2e-4)
    assert low == pytest.approx(period, rel=5e-3)


def test_nothing_communicated_can_come_late():
    deaf = Gains(1.2, 0.0, 0.8, 0.1)
    assert joint_latency_margin(deaf, 5.0, 0.5, 0.01) == math.inf
    assert 0.1 < joint_critical_period(deaf, 5.0, 0.5, latency=3.0) < 10
    assert joint_latency_margin(A, 5.0, 0.5, 0.01, held=0.0) == 0.0


def test_what_has_no_meaning_is_refused():
    with pytest.raises(DesignError, match=r"held = 1\.5 is not a probability"):
        joint_critical_period(A, 5.0, 0.5, held=1.5)
    with pytest.raises(DesignError, match="period = 0 s"):
        joint_latency_margin(A, 5.0, 0.5, 0.0)
