"""The certificate: each part against the worst of many lags and gains, computed when read."""

import dataclasses
import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cacc_platoon.model import Gains
from cacc_platoon.theory import (
    DesignError,
    NoiseStatistics,
    certify,
    critical_period,
    effective_interval,
    in_paper_region,
    is_internally_stable,
    is_reception_string_stable,
    is_sampled_string_stable,
    is_string_stable,
    joint_critical_period,
    joint_latency_margin,
    l2_gain,
    latency_margin,
    leader_error_gain,
    leader_error_norm,
    linf_gain,
    slowest_time_constant,
    stable_gain_range,
)
from cacc_platoon.theory.noise_growth import worst_mean_square_index

A = Gains(0.95, 0.5, 0.63, 0.009)
SHORT = Gains(0.65, 0.5, 0.63, 0.009)
FAST = Gains(0.75, 0.6, 0.6, 1.5)
DAMPED = Gains(1.3, 0.5, 0.62, 0.1)  # robust with half of the packets, too
STIFF = Gains(1.5, 0.5, 0.9, 0.01)
DESIGNS = [A, SHORT, FAST, DAMPED, STIFF]


@pytest.mark.parametrize("gains", DESIGNS)
@pytest.mark.parametrize("reception", [1.0, 0.5])
def test_every_part_is_the_worst_of_both_ends_of_the_interval(gains, reception):
    """The low end decides some designs and parts, the high end others."""
    certificate = certify(gains, 5.0, 0.5, reception=reception)
    ends = (reception * 0.8 * gains.k_a, 1.2 * gains.k_a)
    assert certificate.interval == pytest.approx(ends, rel=1e-15)
    ends = certificate.interval
    assert certificate.string_stable == all(is_string_stable(gains, 0.5, k) for k in ends)
    worst = max(l2_gain(gains, 0.5, k) for k in ends)
    assert (certificate.l2_gain, certificate.peak_frequency) == worst
    at_largest_lag = max(linf_gain(gains, 0.5, k) for k in ends)
    assert certificate.linf_gain >= at_largest_lag * (1 - 1e-12)
    assert certificate.internally_stable == is_internally_stable(gains, 0.5)
    lags = np.linspace(1e-9, 0.5, 60)
    errors = max(leader_error_norm(gains, tau, k) for k in ends for tau in lags)
    assert certificate.leader_error_norm == pytest.approx(errors, rel=1e-6)
    errors = max(leader_error_gain(gains, tau, k) for k in ends for tau in lags)
    assert errors <= certificate.leader_error_gain * 1.02
    assert certificate.slowest_time_constant == slowest_time_constant(gains, 0.5)
    assert certificate.gain_range == stable_gain_range(gains, 0.5)


MARGINS = ("latency_margin", "critical_period", "joint_latency_margin", "joint_critical_period")


def test_both_ends_matter_in_this_test():
    for part in (linf_gain, leader_error_norm, lambda *ask: l2_gain(*ask).gain):
        larger = {
            part(gains, 0.5, low) > part(gains, 0.5, high)
            for gains in DESIGNS
            for reception in (1.0, 0.5)
            for low, high in [effective_interval(gains.k_a, 5.0, reception=reception)]
            if part(gains, 0.5, low) != part(gains, 0.5, high)
        }
        assert larger == {True, False}


@pytest.mark.slow
@pytest.mark.parametrize(("gains", "reception"), [(DAMPED, 1.0), (DAMPED, 0.6), (FAST, 0.9)])
def test_margins_hold_at_every_gain_and_lag(gains, reception):
    """Each margin is that of the worst single gain and lag; the low end of I decides for FAST."""
    certificate = certify(gains, 5.0, 0.5, period=0.02, reception=reception)
    alone = [
        certify(gains, 5.0, tau, period=0.02, k_effective=k)
        for tau in np.linspace(0.02, 0.5, 9)
        for k in np.linspace(*certificate.interval, 5)
    ]
    for part in MARGINS:
        least = min(getattr(one, part) for one in alone)
        assert getattr(certificate, part) == pytest.approx(least, rel=0.02)
        assert getattr(certificate, part) <= least * (1 + 1e-6)
    assert certificate.sampled_string_stable
    assert all(one.sampled_string_stable for one in alone)


def test_losses_shrink_every_margin():
    whole, lossy = certify(FAST, 5.0, 0.5), certify(FAST, 5.0, 0.5, reception=0.9)
    assert lossy.string_stable
    for part in MARGINS:
        assert getattr(lossy, part) < getattr(whole, part)
    assert not certify(A, 5.0, 0.5, reception=0.9).string_stable
    assert certify(A, 5.0, 0.5, reception=1.0) == certify(A, 5.0, 0.5)


def test_parts_agree_with_the_functions_of_their_names():
    noise = NoiseStatistics(1.048, 0.0092, 0.01)
    certificate = certify(A, 5.0, 0.5, period=0.05, noise=noise, latency=0.02)
    assert certificate.in_paper_region == in_paper_region(A, 5.0, 0.5)
    assert certificate.sampled_string_stable == is_sampled_string_stable(A, 5.0, 0.5, 0.05)
    assert certificate.critical_period == critical_period(A, 5.0, 0.5)
    assert certificate.joint_latency_margin == joint_latency_margin(A, 5.0, 0.5, 0.05)
    assert certificate.joint_critical_period == joint_critical_period(A, 5.0, 0.5, latency=0.02)
    assert certificate.latency_margin == latency_margin(A, 5.0, 0.5)
    index = worst_mean_square_index(A, 0.5, 0.5 * 1.048, 0.05, noise)
    assert dataclasses.replace(certificate, latency=0.0).mean_square_index == index
    assert math.isnan(certificate.mean_square_index)


def test_held_packets_shorten_the_critical_period():
    """Followed, it certifies; a period below the one without loss need not."""
    held = certify(A, 5.0, 0.5, period=0.2, held=0.5)
    whole = certify(A, 5.0, 0.5)
    assert held.critical_period == critical_period(A, 5.0, 0.5, held=0.5, lost_at=0.2)
    assert held.critical_period < 0.5 * whole.critical_period
    between = dataclasses.replace(held, period=0.99 * whole.critical_period)
    assert between.fails_held
    below = dataclasses.replace(held, period=0.99 * held.critical_period)
    assert below.string_stable
    assert below.sampled_string_stable
    assert held.joint_critical_period < held.critical_period


def test_a_loop_that_no_period_keeps_is_no_matter_of_sampling():
    """Without a single packet C = 0.009 (0.95 (1.26 + 0.00855) - 2) < 0 at k = 0."""
    lost = certify(A, 5.0, 0.5, period=0.2, held=0.0)
    assert lost.critical_period == 0.0
    assert not lost.string_stable
    assert lost.fails_held


@given(
    st.floats(0.3, 3), st.floats(0, 0.8), st.floats(0.05, 2), st.floats(1e-3, 2), st.floats(0, 1)
)
@settings(max_examples=2 * settings().max_examples)
def test_with_losses_it_agrees_with_the_theory_of_packet_loss(h, k_a, k_v, k_p, reception):
    gains = Gains(h, k_a, k_v, k_p)
    certificate = certify(gains, 5.0, 0.5, reception=reception)
    assert certificate.string_stable == is_reception_string_stable(gains, 5.0, 0.5, reception)
    if certificate.in_paper_region:  # sufficient for every interval I
        assert certificate.string_stable


def test_only_what_is_read_is_computed():
    certificate = certify(A, 5.0, 0.5)
    assert certificate.string_stable
    assert "worst_linf_gain" not in vars(certificate)
    first = certificate.worst_linf_gain
    assert vars(certificate)["worst_linf_gain"] is first
    assert certificate == certify(A, 5.0, 0.5)
    assert hash(certificate) == hash(certify(A, 5.0, 0.5))
    assert certificate != certify(A, 5.0, 0.5, reception=0.9)
    assert pickle.loads(pickle.dumps(certificate)).worst_linf_gain == first


def test_all_parts_at_once():
    parts = certify(A, 5.0, 0.5).parts()
    assert {"string_stable", "l2_gain", "peak_frequency", "linf_gain", "interval"} <= set(parts)
    assert len(parts) == 31
    assert not any(name.startswith("_") for name in parts)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"rho": 1.0}, "rho = 1"),
        ({"tau_max": 0.0}, "tau_max = 0"),
        ({"period": -1.0}, "period = -1"),
        ({"reception": 1.5}, "reception = 1.5"),
        ({"held": -1.0}, "held = -1 is not a probability"),
        ({"k_effective": -0.1}, "k_effective = -0.1"),
        ({"gains": A._replace(k_v=float("nan"))}, "k_v = nan"),
        ({"gains": A._replace(time_headway=0.0)}, "time_headway = 0"),
    ],
)
def test_a_question_without_meaning_is_refused_at_once(change, words):
    with pytest.raises(DesignError, match=words):
        certify(**{"gains": A, "rho": 5.0, "tau_max": 0.5, **change})
