"""The latency margin, against brute force over latency, frequency, lag and gain."""

import math

import control
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cacc_platoon.model import Gains
from cacc_platoon.theory import (
    DesignError,
    exact_region,
    headway_for_latency,
    is_robustly_string_stable,
    k_a_max,
    latency_margin,
    minimum_headway,
)

A = Gains(0.95, 0.5, 0.63, 0.009)


def magnitude(gains, tau, k, delay, omega):
    h, _, k_v, k_p = gains
    s = 1j * omega
    numerator = k * s**2 * np.exp(-s * delay) + k_v * s + k_p
    return np.abs(numerator / (tau * s**3 + s**2 + (k_v + h * k_p) * s + k_p))


@st.composite
def designs(draw):
    rho = math.exp(draw(st.floats(math.log(1.5), math.log(100))))
    tau_max = math.exp(draw(st.floats(math.log(0.1), math.log(1))))
    k_a = draw(st.floats(0.05, 0.95)) * k_a_max(rho)
    headway = minimum_headway(k_a, rho, tau_max) * draw(st.floats(1.01, 2.0))
    region = exact_region(k_a, headway, rho, tau_max)
    k_p = max(region.k_p_min, 1e-4) * math.exp(draw(st.floats(0.1, 7)))
    low, high = region.bounds(k_p)
    k_v = float(low + draw(st.floats(0.02, 0.98)) * (high - low))
    assume(k_v > 1e-6)
    return Gains(headway, k_a, k_v, k_p), rho, tau_max


@given(designs())
@settings(max_examples=5 * settings().max_examples // 2)
def test_margin_holds_below_and_is_lost_above(design):
    gains, rho, tau_max = design
    assert is_robustly_string_stable(*design)
    margin = latency_margin(*design)
    omega = np.geomspace(1e-4, 1e3, 3000) / tau_max
    ends = [(1 - 1 / rho) * gains.k_a, (1 + 1 / rho) * gains.k_a]
    below = min(margin, 50 * tau_max)
    for share in (0.2, 0.7, 0.999):
        for tau in (0.05 * tau_max, 0.5 * tau_max, tau_max):
            for k in (*ends, sum(ends) / 2):
                found = magnitude(gains, tau, k, share * below, omega).max()
                assert found <= 1 + 1e-9
    if math.isfinite(margin):
        later = 1.01 * margin + 1e-9 * tau_max
        assert max(largest_excess(gains, tau_max, k, later) for k in ends) > 0


def largest_excess(gains, tau_max, k, delay):
    """Maximise (|N|^2 - |D|^2)/omega^2 over lag and frequency on grids that zoom in."""
    h, _, k_v, k_p = gains
    low, high = 1e-3 / tau_max, 1e3 / tau_max
    for _ in range(5):
        omega = np.geomspace(low, high, 3000)
        s = 1j * omega
        lags = np.minimum(tau_max, (k_v + h * k_p) / omega**2)
        numerator = k * s**2 * np.exp(-s * delay) + k_v * s + k_p
        denominator = lags * s**3 + s**2 + (k_v + h * k_p) * s + k_p
        excess = (np.abs(numerator) ** 2 - np.abs(denominator) ** 2) / omega**2
        best = int(np.argmax(excess))
        low, high = omega[max(best - 2, 0)], omega[min(best + 2, 2999)]
    return excess[best]


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_case_a_with_a_pade_delay_of_python_control(share):
    """The nominal margin at tau_0 and k = M k_a, with a delay of its own kind."""
    k = 0.6
    delay = share * latency_margin(A, 5.0, 0.5, k_effective=k)
    pade = control.tf(*control.pade(delay, 8))
    s = control.tf("s")
    damping = A.k_v + A.time_headway * A.k_p
    H = (k * s**2 * pade + A.k_v * s + A.k_p) / (0.5 * s**3 + s**2 + damping * s + A.k_p)
    omega = np.geomspace(1e-3, 20, 4000)
    peak = np.abs(H(1j * omega)).max()
    assert (peak > 1 + 1e-9) == (share > 1)


@given(st.floats(0.05, 0.9), st.floats(1.5, 50), st.floats(0.0, 0.5))
@settings(max_examples=3 * settings().max_examples // 2)
def test_headway_rule_is_sufficient(share, rho, latency):
    k_a, tau_max = share * k_a_max(rho), 0.5
    headway = 1.02 * headway_for_latency(k_a, rho, tau_max, latency)
    low, high = (1 - 1 / rho) * k_a, (1 + 1 / rho) * k_a
    floor, ceiling = (1 - low) / headway, (1 - high**2) / (2 * (tau_max + high * latency))
    assert floor < ceiling
    gains = Gains(headway, k_a, (floor + ceiling) / 2, 1e-7)
    assert latency_margin(gains, rho, tau_max) >= latency


def test_edges():
    assert latency_margin(A._replace(time_headway=0.65), 5.0, 0.5) == 0
    assert latency_margin(Gains(2.0, 0.0, 0.6, 0.3), 5.0, 0.5) == math.inf
    assert latency_margin(Gains(2.0, 0.01, 0.6, 0.3), 5.0, 0.5) == math.inf
    assert latency_margin(A, 5.0, 0.5, k_effective=0.4) > latency_margin(A, 5.0, 0.5)
    low = (1 - 0.4) / 0.95 - 0.95 * 0.009 / 2  # C = 0 at m k_a
    assert 0 <= latency_margin(A._replace(k_v=low), 5.0, 0.5) < 0.1
    assert headway_for_latency(0.5, 5.0, 0.5, 0.0) == pytest.approx(0.9375)
    for latency in (-1.0, math.inf, math.nan):
        with pytest.raises(DesignError, match="latency"):
            headway_for_latency(0.5, 5.0, 0.5, latency)
