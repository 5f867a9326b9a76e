"""The verdict is a theorem: right for the published cases, deaf to the noise of one run."""

import dataclasses
import re

import numpy as np
import pytest

from cacc_platoon.analysis import (
    analyse,
    check_consistency,
    compute_metrics,
    judge,
    warn_if_not_string_stable,
)
from cacc_platoon.analysis.document import verdict_document as metrics_of
from cacc_platoon.analysis.guarantee import noise_statistics
from cacc_platoon.design import Requirements, assess
from cacc_platoon.report import metrics_document
from cacc_platoon.reproduction.cases import CASES, case_scenario
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import simulate
from cacc_platoon.theory import NoiseStatistics, certify, exact_region


def warning_of(scenario: Scenario) -> str:
    warning = warn_if_not_string_stable(scenario)
    assert warning is not None
    return warning


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_published_cases(case):
    verdict = judge(case_scenario(case))
    assert verdict.string_stable == verdict.in_paper_region == case.string_stable
    assert verdict.equal_links
    assert "exact test" in verdict.basis
    assert "L2" in verdict.basis
    assert (verdict.weakest.l2_gain == 1.0) == case.string_stable


def test_both_definitions_are_named_and_differ():
    """docs/theory.md, section 5 (Gains between energies and between peaks): 1 and 1.0396."""
    verdict = judge(case_scenario(CASES[0]))
    assert verdict.weakest.l2_gain == 1.0
    assert verdict.weakest.linf_gain == pytest.approx(1.0396, abs=5e-5)
    assert judge(case_scenario(CASES[2])).weakest.linf_gain == pytest.approx(1.0661, abs=5e-5)


def test_one_noisy_run_does_not_decide():
    """Peaks of a noisy run of A grow at some hops; the verdict stays, and says void of nothing."""
    scenario = case_scenario(CASES[0])
    run = simulate(scenario)
    metrics = compute_metrics(run)
    assert (np.diff(metrics.max_abs_spacing_error) > 0).any()
    verdict = judge(scenario, metrics.noise, check_consistency(run))
    assert verdict.certified
    assert all(one.realised_stable for one in verdict.followers)


def test_exact_where_the_paper_is_only_sufficient():
    """h_w = 0.8 s is below the paper's 0.9375 s and robustly string stable for some gains."""
    low, high = exact_region(0.5, 0.8, rho=5.0, tau_max=0.5).bounds([0.1])
    k_v = float(low[0] + high[0]) / 2
    values = {
        "controller.time_headway": 0.8,
        "controller.k_p": 0.1,
        "controller.k_v": k_v,
    }
    verdict = judge(Scenario.from_values(values))
    assert verdict.string_stable
    assert not verdict.in_paper_region


def test_worst_case_over_lag_and_noise():
    """A lag of 0.3 s is driven, but tau0 = 0.9 s must be tolerated and is not."""
    values = {"vehicle.tau": 0.3, "vehicle.tau_max": 0.9}
    assert not judge(Scenario.from_values(values)).string_stable
    assert judge(Scenario.from_values({**values, "vehicle.tau_max": 0.5})).string_stable


def test_mixed_platoon_is_certified_on_accelerations():
    scenario = Scenario.from_values({}, {5: {"controller.time_headway": 0.65}})
    verdict = judge(scenario)
    assert not verdict.string_stable
    assert not verdict.equal_links
    assert verdict.weakest.follower == 5
    assert "a_i = H_i a_{i-1}" in verdict.basis
    assert [one.follower for one in verdict.followers if not one.string_stable] == [5]
    warning = warning_of(scenario)
    assert "vehicle 5" in warning
    assert "0.714286 s" in warning


def test_a_period_that_is_too_long_voids_the_certificate():
    """docs/theory.md, section 6 (Sampling): A loses robust string stability at T = 95.9 ms."""
    settings = {"run.step": 0.1, "run.duration": 20.0}
    verdict = judge(case_scenario(CASES[0], settings))
    assert verdict.string_stable
    assert not verdict.certified
    assert "sampled every 0.1 s" in verdict.void[0]
    assert "below 0.09586 s" in verdict.void[0]  # rounded down, so that it holds when followed
    assert "lower run.step" in warning_of(case_scenario(CASES[0], settings))
    assert judge(case_scenario(CASES[0], {**settings, "run.step": 0.08})).certified


def test_warning_is_one_line_and_only_where_due():
    assert warn_if_not_string_stable(case_scenario(CASES[0])) is None
    warning = warning_of(case_scenario(CASES[1]))
    assert "\n" not in warning
    assert "time_headway = 0.65 s is below 0.714286 s" in warning
    assert "sup|H| = 1.0035" in warning
    assert "0.9375 s" in warning


def test_certificate_is_void_where_the_channel_broke_its_word(scenario):
    run = simulate(scenario)
    received = run.received.copy()
    received[120, 1] = 1.3 * run.acceleration[120, 1]
    broken = dataclasses.replace(run, received=received)
    noise = compute_metrics(broken).noise
    verdict = judge(scenario, noise)
    assert verdict.string_stable
    assert not verdict.certified
    (why,) = verdict.void
    assert "link 1 -> 2 at 1.2 s" in why
    assert "VOID" in verdict.headline


def test_certificate_is_void_where_a_vehicle_had_other_gains(bags, tmp_path, scenario):
    other = dataclasses.replace(scenario, overrides={2: {"controller.k_v": 0.7}})
    bag = bags.bag(tmp_path / "bag", scenario, bags.record(other))
    report = analyse(bag, runs=0)
    assert report.verdict.string_stable
    assert not report.verdict.certified
    assert "vehicle 2 alone departs from its scenario's equations" in report.verdict.void[0]


def test_expectation_run_is_the_mean_of_noisy_runs(whole_run):
    """docs/theory.md, section 1 (Setting): within 4 standard errors at every vehicle and time."""
    report = analyse(whole_run, runs=400)
    assert metrics_document(report)["ensemble"]["max_standard_errors_from_expectation"] < 4.0
    assert metrics_document(report)["ensemble"]["runs"] == 400


def test_no_ensemble_where_nothing_is_random(bags, tmp_path):
    calm = bags.scenario({"v2v.noise": "expected"})
    report = analyse(bags.run(tmp_path / "run", calm).path)
    assert report.ensemble is None
    assert report.measured.max_abs_spacing_error.tolist() == (
        report.expected.max_abs_spacing_error.tolist()
    )


def test_verdict_and_design_read_the_same_certificate():
    scenario = case_scenario(CASES[0])
    gains, rho = scenario.followers[0].gains, scenario.v2v.rho
    own = judge(scenario).weakest.certificate
    noise = noise_statistics(scenario.followers[0], scenario.run.step)
    assert (noise.mean, noise.variance) == pytest.approx((1.04817, 0.00921520), rel=1e-5)
    assert own == certify(
        gains, rho, scenario.vehicle.tau_max, period=scenario.run.step, noise=noise
    )
    calm = dataclasses.replace(own, noise=NoiseStatistics(redraw_period=0.01))
    assert calm == assess(gains, rho, scenario.vehicle.tau_max).certificate
    assert Requirements(max_linf=1.03).unmet(own) == ("L-infinity gain 1.03956 is above 1.03",)


def test_equal_followers_share_one_certificate():
    own = {2: {"controller.k_v": 0.7}}
    followers = judge(Scenario.from_values({"platoon.followers": 50}, own)).followers
    assert len({id(one.certificate) for one in followers}) == 2
    second = Scenario.from_values({}, own).followers[1]
    noise = noise_statistics(second, 0.01)
    assert followers[1].certificate == certify(second.gains, 5.0, 0.5, noise=noise)


def test_reason_of_a_follower_is_the_condition_of_its_failure():
    verdict = judge(Scenario.from_values({}, {3: {"controller.k_v": 0.5}}))
    assert verdict.weakest.reason == "k_v = 0.5 1/s is below 0.627304"
    assert metrics_of(verdict)["per_follower"][2]["reason"] == verdict.weakest.reason
    assert metrics_of(verdict)["per_follower"][2]["decided"]
    warning = warn_if_not_string_stable(Scenario.from_values({"controller.k_v": 0.5})) or ""
    assert "C = -0.002177 < 0 at k_a E[w] = 0.4" in warning
    assert "Raise k_v into [0.627304, 0.701188]" in warning


def test_what_overflows_is_never_certified():
    """k_a^2 and C overflow: a relative tolerance of infinity would let anything pass."""
    for name in ("k_a", "k_v", "k_p", "time_headway"):
        verdict = judge(Scenario.from_values({f"controller.{name}": 1e200}))
        assert not verdict.string_stable
        assert not verdict.followers[0].sampled
        assert not verdict.certified


def test_a_follower_that_fails_outweighs_one_that_is_undecided():
    own = {2: {"controller.k_p": 1e6}, 4: {"controller.time_headway": 0.65}}
    scenario = Scenario.from_values({}, own)
    verdict = judge(scenario)
    assert verdict.headline == "NOT STRING STABLE"
    assert verdict.weakest.follower == 4
    assert np.isnan(verdict.linf_gain)
    assert "vehicle 4" in warning_of(scenario)


def test_the_weakest_of_stable_followers_has_the_least_margin():
    """sup|H| is 1 of each; vehicle 2 is next to the edge."""
    near = {"vehicle_2.controller.k_v": 0.6305, "vehicle_3.controller.k_v": 0.632}
    verdict = judge(Scenario.from_values({"platoon.followers": 4}).with_values(near))
    assert [one.l2_gain for one in verdict.followers] == [1.0] * 4
    least = [min(one.margins) for one in verdict.followers]
    assert verdict.weakest.follower == 1 + least.index(min(least))
    assert least[1] != least[0]
    C, margin = verdict.weakest.margins
    assert (
        f"margins C = {C:.4g} 1/s^2 and B + 2 tau0 sqrt(C) = {margin:.4g}" in verdict.weakest.gain
    )


@pytest.mark.parametrize(
    "settings",
    [
        {"controller.time_headway": 0.65},
        {"controller.k_a": 0.9},
        {"controller.k_v": 0.3},
        {"controller.k_v": 2.0},
        {"v2v.loss": 0.99, "v2v.reception": "hold"},
        {"v2v.loss": 0.3, "v2v.reception": "zero"},
    ],
)
def test_every_failure_has_a_remedy(settings):
    verdict = judge(Scenario.from_values({"platoon.followers": 2, **settings}))
    assert not verdict.string_stable
    assert re.match(r"(Raise|Lower|Lose|Give) ", verdict.weakest.remedy)
