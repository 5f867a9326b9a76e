"""Why a design fails, stated by value, rule, consequence and remedy; and the remedies work."""

import math
import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cacc_platoon.model import Gains
from cacc_platoon.theory import (
    Certificate,
    Failure,
    certify,
    critical_period,
    exact_region,
    explain_failure,
    explain_verdict,
    headway_bound,
    minimum_headway,
    propagation_margins,
    rounded_down,
)

A = Gains(0.95, 0.5, 0.63, 0.009)


def failure_of(gains: Gains, reception: float = 1.0) -> Failure:
    failure = explain_failure(certify(gains, 5.0, 0.5, reception=reception))
    assert failure is not None
    return failure


@pytest.mark.parametrize(
    ("gains", "words"),
    [
        (Gains(0.95, 0.9, 0.63, 0.009), ["k_a = 0.9", "0.833333", "Lower k_a"]),
        (Gains(0.7, 0.5, 0.63, 0.009), ["0.714286 s", "Raise time_headway", "0.9375 s"]),
        (Gains(0.8, 0.5, 0.63, 0.009), ["k_p = 0.009", "0.0395857", "Raise k_p", "0.9375 s"]),
        (Gains(0.95, 0.5, 0.5, 0.009), ["k_v = 0.5", "0.627304", "Raise k_v", "C = -0.002177"]),
        (Gains(0.95, 0.5, 0.8, 0.009), ["k_v = 0.8", "0.701188", "Lower k_v", "k_a E[w] = 0.6"]),
        (Gains(0.95, 0.5, 0.63, 0.0), ["k_p = 0", "not positive", "Give k_p"]),
    ],
)
def test_failures_name_value_rule_and_remedy_and_the_remedy_works(gains, words):
    certificate = certify(gains, 5.0, 0.5)
    assert not certificate.string_stable
    text = explain_verdict(certificate)
    assert all(word in text for word in words), text
    assert text == str(explain_failure(certificate))
    interval = re.search(r"into \[(.*), (.*)\]", text)
    if interval:
        low, high = (float(x) for x in interval.groups())
        region = exact_region(gains.k_a, gains.time_headway, 5.0, 0.5)
        assert region.contains(gains.k_p, (low + high) / 2)


def test_the_condition_named_as_broken_is_the_one_that_is():
    """C = k_p (h (2 k_v + h k_p) - 2 (1 - k)) at k = 0.4; at k = 0.6 only the other one breaks."""
    slow = failure_of(A._replace(k_v=0.5)).consequence
    assert "slow disturbances" in slow
    assert f"C = {0.009 * (0.95 * (1 + 0.95 * 0.009) - 1.2):.4g} < 0 at k_a E[w] = 0.4" in slow
    fast = failure_of(A._replace(k_v=0.8)).consequence
    margin = propagation_margins(A._replace(k_v=0.8), 0.5, 0.6).margin
    assert f"B + 2 tau_0 sqrt(C) = {margin:.4g} < 0 at k_a E[w] = 0.6" in fast
    assert margin < 0 <= propagation_margins(A._replace(k_v=0.8), 0.5, 0.4).margin


def test_a_design_that_holds_has_no_failure():
    assert explain_failure(certify(A, 5.0, 0.5)) is None
    assert "in the paper's region S" in explain_verdict(certify(A, 5.0, 0.5))
    low, high = exact_region(0.5, 0.8, 5.0, 0.5).bounds(np.float64(0.1))
    wider = certify(Gains(0.8, 0.5, float(low + high) / 2, 0.1), 5.0, 0.5)
    assert "exact test" in explain_verdict(wider)


def test_one_effective_gain_is_explained_at_its_own_lag():
    text = explain_verdict(
        certify(A._replace(time_headway=0.65), 5.0, 0.5, k_effective=0.524086844)
    )
    assert text.startswith("sup|H| = 1.00116372 at tau = 0.5 s and k_a E[w] = 0.524087 alone")
    assert "near 0.0379386 rad/s" in text
    inside = explain_verdict(certify(Gains(0.2, 0.5, 0.01, 5.0), 5.0, 0.5, k_effective=0.5))
    assert "= 1.01 is not above tau k_p = 2.5" in inside
    assert "Raise k_v" in inside


def test_lost_packets_enter_every_rule():
    """2 tau_0/(1 + p m k_a) with p = 0.5, m k_a = 0.4; the paper's bound with 1 - 0.2."""
    short = failure_of(A._replace(time_headway=0.8), reception=0.5)
    assert "below 0.833333 s = 2 tau_0/(1 + 0.5 (1 - 1/rho) k_a)" in short.condition
    assert f"above {2 * 0.5 * (1 - 0.2) / (1 - 0.36):.6g} s" in short.remedy
    none = failure_of(A._replace(time_headway=0.8), reception=0.0)
    assert none.condition == "time_headway = 0.8 s is below 1 s = 2 tau_0, the least without V2V"
    slow = failure_of(A._replace(k_p=0.2), reception=0.5)
    assert "k_a E[w] = 0.2" in slow.consequence
    held = certify(Gains(1.3, 0.5, 0.62, 0.1), 5.0, 0.5, reception=0.5)
    assert held.string_stable
    assert "with at least 0.5 of all packets received" in explain_verdict(held)


@given(
    st.builds(Gains, st.floats(0.2, 3), st.floats(0, 0.95), st.floats(1e-3, 3), st.floats(1e-4, 5)),
    st.sampled_from([1.5, 5.0, 100.0]),
    st.sampled_from([0.4, 1.0]),
)
@settings(max_examples=4 * settings().max_examples)
def test_every_failure_is_explained_in_one_line_and_the_gains_it_offers_hold(gains, rho, reception):
    certificate = certify(gains, rho, 0.5, reception=reception)
    failure = explain_failure(certificate)
    assert (failure is None) == certificate.string_stable
    if failure is None:
        return
    assert isinstance(failure, Failure)
    assert all(failure)
    assert "\n" not in str(failure)
    if interval := re.search(r"into \[(.*), (.*)\]", failure.remedy):
        low, high = (float(x) for x in interval.groups())
        mended = gains._replace(k_v=(low + high) / 2)
        assert certify(mended, rho, 0.5, reception=reception).string_stable or high - low < 1e-4
    if "whatever k_v and k_p are" in failure.consequence:
        assert gains.time_headway < minimum_headway(gains.k_a, rho, 0.5, reception=reception)
        assert gains.time_headway < headway_bound(gains.k_a, rho, 0.5, reception=reception)


@pytest.mark.slow
@given(
    st.floats(1.0, 2.0),
    st.floats(0.05, 0.8),
    st.floats(-4, 1).map(math.exp),
    st.sampled_from([0.0, 0.1, 0.5, 0.9, 1.0]),
    st.floats(-5, 0).map(math.exp),
    st.one_of(st.floats(0, 1), st.floats(-5, 0).map(math.exp)),
    st.floats(0.01, 1.0),
)
@settings(max_examples=3 * settings().max_examples)
def test_what_is_advised_where_packets_are_held_certifies(  # noqa: PLR0917
    longer, k_a, k_p, place, period, held, less
):
    """Gains that pass the exact test, on its edges too; each way out is followed by itself."""
    h = longer * minimum_headway(k_a, 5.0, 0.5)
    region = exact_region(k_a, h, 5.0, 0.5)
    k_p = max(k_p, region.k_p_min)
    low, high = (float(x) for x in region.bounds(np.float64(k_p)))
    gains = Gains(h, k_a, max(low + place * (high - low), 1e-3), k_p)
    certificate = certify(gains, 5.0, 0.5, period=period, held=held)
    failure = explain_failure(certificate)
    assert (failure is None) == certificate.string_stable
    if not certify(gains, 5.0, 0.5).string_stable:
        return
    if failure is None:
        if not certificate.sampled_string_stable and held < 1:
            shorter = less * float(rounded_down(certificate.critical_period))
            assert holds(replace(certificate, period=shorter))
        return
    for mended in followed(certificate, failure.remedy, less):
        assert holds(mended), failure


def holds(certificate: Certificate) -> bool:
    return certificate.string_stable and certificate.sampled_string_stable


def followed(certificate: Certificate, remedy: str, less: float) -> Iterator[Certificate]:
    """Yield a certificate for each way that a remedy offers, at a share `less` of its bound."""
    bound = re.search(r"control period below (\S+) s", remedy)
    period = less * float(bound[1]) * (1 - 1e-9) if bound else certificate.period
    if "Lose no packets, lower" in remedy:
        gains = certificate.gains
        if not bound:
            gains = gains._replace(time_headway=1.02 * gains.time_headway)
            period = 0.9 * critical_period(gains, certificate.rho, certificate.tau_max)
        yield replace(certificate, gains=gains, held=1.0, period=period)
        return
    if share := re.search(r"less than a share (\S+) of", remedy):
        yield replace(certificate, held=1 - less * float(share[1]) * (1 - 1e-9))
    else:
        assert remedy.startswith("Lose no packets")
        yield replace(certificate, held=1.0)
    if bound:
        yield replace(certificate, period=period)


def test_gains_that_fail_without_loss_are_mended_first_and_that_is_said():
    wrong = certify(A._replace(k_v=0.5), 5.0, 0.5, held=0.1)
    failure = explain_failure(wrong)
    assert failure is not None
    assert "Raise k_v into [0.627304, 0.701188], which mends the loop without loss" in str(failure)
    mended = certify(A._replace(k_v=0.66), 5.0, 0.5, held=0.1)
    assert replace(mended, held=1.0).string_stable


def test_a_design_that_holds_packets_is_explained_at_its_period():
    fast = explain_verdict(certify(A, 5.0, 0.5, held=0.5))
    assert "with a share 0.5 of all packets received and the last one held, the mean loop" in fast
    assert "sampled every 0.01 s is string stable" in fast
    slow = certify(A, 5.0, 0.5, held=0.5, period=0.2)
    assert slow.string_stable
    assert "sampled every 0.2 s is not string stable" in explain_verdict(slow)
    assert "held" not in explain_verdict(certify(A, 5.0, 0.5))


def test_a_design_that_is_sampled_too_slowly_is_so_in_continuous_time_alone():
    slow = explain_verdict(certify(A, 5.0, 0.5, period=0.2))
    assert slow.endswith("time alone: sampled every 0.2 s it is not string stable.")
    assert "sampled" not in explain_verdict(certify(A, 5.0, 0.5))
