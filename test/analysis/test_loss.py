"""Lossy runs measured and judged: loss, age of information, and which system is judged."""

import dataclasses
import math
import re
import sys

import numpy as np
import pytest

from cacc_platoon.analysis import (
    analyse,
    compute_metrics,
    judge,
    warn_if_not_string_stable,
)
from cacc_platoon.analysis.age import information_age, link_reception
from cacc_platoon.analysis.document import verdict_document
from cacc_platoon.model import ComposedChannel
from cacc_platoon.report import metrics_document, summary
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import Arrivals, simulate
from cacc_platoon.theory import certify, exact_region, is_sampled_string_stable

SHORT = {"platoon.followers": 3, "run.duration": 20.0, "leader.start": 1.0}


def lossy(loss, reception="hold", **more):
    common = {**SHORT, "v2v.loss": loss, "v2v.reception": reception}
    return Scenario.from_values(common).with_values(more)


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


def step_advised(text: str) -> float:
    found = re.search(r"below (\S+) s", text)
    assert found
    return float(found[1])


def sampled_below(scenario: Scenario, step: float) -> Scenario:
    """Return the scenario sampled just faster, for a whole number of steps."""
    microseconds = math.ceil(step * 1e6) - 1
    return scenario.with_values(
        {"run.step": microseconds / 1e6, "run.duration": microseconds / 1e3, "leader.start": 0.0}
    )


def test_a_step_that_is_lowered_as_advised_certifies_with_held_packets():
    """Vehicle 3 loses most and decides; 95.8 ms would do without loss and fails with it."""
    slow = lossy(0.2, **{"run.step": 0.2, "vehicle_3.v2v.loss": 0.5})
    verdict = judge(slow)
    assert verdict.headline == "STRING STABLE BY DESIGN, CERTIFICATE VOID"
    (reason,) = verdict.void
    assert "vehicle 3, sampled every 0.2 s with the last packet held" in reason
    assert "string stable; at periods below" in reason
    assert " s it is (3 vehicles in all): lower run.step" in reason
    advised = step_advised(reason)
    assert advised == pytest.approx(0.0444, abs=1e-4)
    assert judge(sampled_below(slow, advised)).certified
    assert judge(sampled_below(slow, 0.0958)).headline == "NOT STRING STABLE"


def test_one_vehicle_that_is_sampled_too_slowly_is_named_alone():
    """80 ms is short enough for k_v = 0.63 of the others, not for its own."""
    (reason,) = judge(lossy(0.0, **{"run.step": 0.08, "vehicle_3.controller.k_v": 0.7})).void
    assert reason.startswith("the loop of vehicle 3 alone, sampled every 0.08 s, is not")
    assert re.search(r"at periods below \S+ s it is: lower run.step$", reason)


def test_either_way_out_of_lost_packets_certifies():
    """Of two that fail the warning is about the one that loses most, so that both are mended."""
    worse = {"vehicle_2.v2v.loss": 0.97, "vehicle_3.v2v.loss": 0.99}
    failed = lossy(0.1, **worse)
    warning = warn_if_not_string_stable(failed)
    assert warning is not None
    assert (
        "is not string stable (vehicle 3), sup|H| = 1 of the loop without loss: with a" in warning
    )
    assert "share 0.01 of all packets received" in warning
    assert judge(sampled_below(failed, step_advised(warning))).certified
    share = re.search(r"less than a share (\S+) of the packets", warning)
    assert share
    loss = 0.999 * float(share[1])
    mended = {"vehicle_2.v2v.loss": loss, "vehicle_3.v2v.loss": loss}
    assert judge(lossy(0.1, **mended)).certified


def test_a_design_that_no_step_keeps_is_not_told_to_lower_it():
    """k_v on the upper edge of the exact region: every period loses what is just held."""
    region = exact_region(0.5, 1.3, 5.0, 0.5)
    edge = float(region.bounds(np.float64(0.1))[1])
    values = {"controller.time_headway": 1.3, "controller.k_p": 0.1, "controller.k_v": edge}
    scenario = Scenario.from_values({**SHORT, **values})
    (reason,) = judge(scenario).void
    assert "nor is it at any other run.step" in reason
    assert "raise time_headway and lower run.step" in reason
    mended = scenario.with_values({"controller.time_headway": 1.32})
    certificate = judge(mended).followers[0].certificate
    assert certificate is not None
    assert judge(sampled_below(mended, certificate.critical_period)).certified


def test_the_interval_that_is_named_is_the_one_that_is_judged():
    both = {"vehicle_2.v2v.reception": "zero", "vehicle_2.v2v.loss": 0.3}
    assert "I = [m k_a, M k_a]" in judge(lossy(0.0)).basis
    assert "I = [m k_a, M k_a]" in judge(lossy(0.3)).basis
    for scenario in (lossy(0.3, "zero"), lossy(0.1, **both)):
        assert "I = [m k_a, M k_a]" not in judge(scenario).basis
        assert "I = [p m k_a, M k_a]" in judge(scenario).basis
    mixed = judge(lossy(0.1, **both, **{"vehicle_3.v2v.loss": 0.2})).basis
    assert "p = 0.7 at vehicle 2, and p = 1 elsewhere" in mixed
    assert "count as zero at vehicle 2: judged" in mixed
    assert "held at vehicles 1, 3 while others are lost" in mixed
    assert "probability p of each (least 0.8, vehicle 3)" in mixed
    assert " at vehicle" not in judge(lossy(0.3)).basis


def test_whose_gains_are_of_the_loop_without_loss_is_said():
    damped = {"controller.time_headway": 1.3, "controller.k_p": 0.1, "controller.k_v": 0.62}
    mixed = {"vehicle_2.v2v.reception": "zero", "vehicle_3.v2v.loss": 0.0, **damped}
    verdict = judge(lossy(0.1, **mixed))
    assert [one.loop for one in verdict.followers] == ["without loss", "as judged", "as judged"]
    document = verdict_document(verdict)
    assert document["per_follower"][0]["loop"] == "without loss"
    assert (document["weakest_follower"], document["loop"]) == (2, "as judged")
    for basis in (document["paper"]["basis"], document["linf_basis"]):
        assert "of the loop without loss at vehicle 1" in basis
    zero = verdict_document(judge(lossy(0.1, "zero", **damped)))
    assert zero["loop"] == "as judged"
    assert "without loss" not in str(zero)
    held = verdict_document(judge(lossy(0.1, **damped)))
    assert held["linf_basis"].endswith("; of the loop without loss")


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


@pytest.mark.parametrize("headway", [0.95, 0.5])
def test_nothing_is_certified_of_another_law(headway):
    """Neither that it is string stable nor that it is not: its gains are not what drives."""
    scenario = Scenario.from_values(
        {**SHORT, "controller.law": "my_laws:Law", "controller.time_headway": headway}
    )
    verdict = judge(scenario)
    assert verdict.headline == "NOT CERTIFIED"
    assert not verdict.certified
    warning = warn_if_not_string_stable(scenario)
    assert warning is not None
    assert "my_laws:Law is another one than the certified one" in warning
