"""Lossy runs measured and judged: loss, age of information, and which system is judged."""

import dataclasses
import sys

import numpy as np
import pytest

from cacc_platoon.analysis import analyse, compute_metrics, judge
from cacc_platoon.analysis.age import information_age, link_reception
from cacc_platoon.model import ComposedChannel
from cacc_platoon.report import metrics_document, summary
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import Arrivals, simulate
from cacc_platoon.theory import certify, is_sampled_string_stable

SHORT = {"platoon.followers": 3, "run.duration": 20.0, "leader.start": 1.0}


def lossy(loss, reception="hold", **more):
    return Scenario.from_values({**SHORT, "v2v.loss": loss, "v2v.reception": reception, **more})


def test_the_age_of_the_newest_packet():
    """Packets of samples 0, 2, 1 arrive at samples 1, 2, 4; nothing has arrived at sample 0."""
    arrivals = Arrivals(np.array([0, 2, 1]), np.array([1, 2, 4]), np.zeros(3))
    np.testing.assert_array_equal(information_age(arrivals, 6), [np.nan, 1, 0, 1, 2, 3])


def test_loss_and_age_of_a_run():
    run = simulate(lossy(0.3))
    assert run.arrivals is not None
    link = link_reception(run)[1]
    gaps = np.diff(np.concatenate((run.arrivals[1].sample, [len(run.time)])))
    assert link.arrived == len(run.arrivals[1].sample)
    assert link.loss == pytest.approx(1 - link.arrived / len(run.time))
    assert link.age_max == pytest.approx((gaps.max() - 1) * 0.01)
    assert link.age_median == 0.0
    assert not link.loses_too_much


def test_more_loss_than_the_scenario_explains_voids_the_certificate():
    run = simulate(lossy(0.3, "zero"))
    mild = lossy(0.05, "zero", **{"controller.time_headway": 1.3})
    mild_run = dataclasses.replace(run, scenario=mild)
    verdict = judge(mild, None, None, link_reception(mild_run))
    assert any("lost more packets than v2v.loss explains" in reason for reason in verdict.void)


def test_lost_as_zero_is_judged_with_the_lower_interval():
    """At p = 0.7, k_p = 0.009 is below what both ends of [0.28, 0.6] need; at p = 1 it is not."""
    assert judge(lossy(0.0, "zero")).string_stable
    verdict = judge(lossy(0.3, "zero"))
    assert not verdict.string_stable
    certificate = verdict.weakest.certificate
    assert certificate is not None
    assert certificate.interval == pytest.approx((0.28, 0.6))


def test_held_packets_are_judged_by_the_sampled_mean_system():
    scenario = lossy(0.3)
    verdict = judge(scenario)
    gains = scenario.follower(1).gains
    assert verdict.string_stable is is_sampled_string_stable(gains, 5.0, 0.5, 0.01, held=0.7)
    hopeless = lossy(0.95, **{"run.step": 0.05, "run.duration": 20.0})
    assert certify(gains, 5.0, 0.5).string_stable
    failed = judge(hopeless)
    assert not failed.string_stable
    assert failed.weakest.failure is not None
    assert "the last one held" in failed.weakest.failure.condition


def test_noise_is_measured_on_what_arrived():
    run = simulate(lossy(0.5))
    links = compute_metrics(run).noise
    for link in links:
        assert 0.8 <= link.low <= link.high <= 1.2
        assert link.breaches == 0


def test_a_report_never_runs_code_that_a_scenario_names(bags, tmp_path, monkeypatch):
    """A bag from anywhere may name any module: reading it imports nothing."""
    (tmp_path / "trap.py").write_text("raise SystemExit('it was run')\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    harmless = bags.scenario({"v2v.loss": 0.2})
    own = {"v2v.channel": "trap:Channel", "controller.law": "trap:Law"}
    named = harmless.with_values(own)
    bag = bags.bag(tmp_path / "bag", named, bags.record(harmless))
    report = analyse(bag)
    assert "trap" not in sys.modules
    assert len([reason for reason in report.verdict.void if "trap:" in reason]) == 2
    text = summary(report, metrics_document(report))
    assert "VOID for this run: v2v.channel = trap:Channel" in text


def test_a_loop_that_is_sampled_too_slowly_is_not_blamed_on_loss():
    verdict = judge(lossy(0.001, **{"run.step": 0.2}))
    assert verdict.string_stable
    assert any("sampled every 0.2 s" in reason for reason in verdict.void)


def test_everything_lost_is_no_fault_of_the_bag(bags, tmp_path):
    scenario = bags.scenario({"v2v.loss": 1.0})
    report = analyse(bags.bag(tmp_path / "bag", scenario, bags.record(scenario)), runs=0)
    assert report.run.findings == ()
    assert all(link.loss == 1.0 for link in report.measured.reception)
    assert (report.run.trajectory.received == 0.0).all()


def test_what_a_receiver_that_holds_had_in_one_run_is_not_judged():
    run = simulate(lossy(0.3))
    verdict = judge(run.scenario, compute_metrics(run).noise)
    assert {one.realised_stable for one in verdict.followers} == {None}


def test_a_late_channel_is_not_blamed_for_packets_that_are_under_way(bags, tmp_path):
    """Packets of the last samples have not arrived when the run ends, none of them was lost."""
    scenario = bags.scenario()

    class Late:
        prompt = False
        longest_delay = 20

        def apply(self, packets):
            return packets._replace(delay=packets.delay + 20)

    named = scenario.with_values({"v2v.channel": "late_channels:Late"})
    run = simulate(named, channel=lambda _: ComposedChannel([Late()]))
    report = analyse(bags.bag(tmp_path / "bag", named, recording_of(run)), runs=0)
    assert all(link.arrived == link.sent - 20 for link in report.measured.reception)
    assert any("late_channels:Late" in reason for reason in report.verdict.void)
    assert not any("lost more packets" in reason for reason in report.verdict.void)
