"""What became of packets: lost, late, overtaken, in bursts; the same of a bag and of arrays."""

import dataclasses
import json
import math

import numpy as np
import pytest

from cacc_platoon.analysis import analyse, compute_metrics
from cacc_platoon.analysis.age_margin import AgeMargin, age_margins, describe_age
from cacc_platoon.analysis.link_packets import (
    Bursts,
    LinkPackets,
    link_packets,
    packets_over_time,
)
from cacc_platoon.analysis.verdict import judge
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.channel_presets import channel_settings
from cacc_platoon.simulation import Arrivals, simulate

SHORT = {"platoon.followers": 3, "run.duration": 12.0, "leader.start": 1.0}
FALLBACK = {"v2v.reception": "fallback", "v2v.blackouts": [4.0, 6.0], "v2v.fallback_after": 0.4}
LATE = {"v2v.period": 0.05, "v2v.latency": 0.1, "v2v.jitter": 0.2, "v2v.loss": 0.2}


def scenario_of(channel, **more):
    pairs = (setting.partition("=") for setting in channel_settings(channel))
    named = {key: json.loads(text) for key, _, text in pairs}
    return Scenario.from_values({**SHORT, **named, **more})


def packets_of(source, sample, dark=None):
    """Return packets sent and delivered at samples, -1 for lost ones."""
    none = np.zeros(len(source), np.bool_)
    given = none if dark is None else np.array(dark, np.bool_)
    return LinkPackets(0, 1, np.array(source), np.array(sample), none, given)


@pytest.mark.parametrize(
    ("sample", "dark", "bursts"),
    [
        ([0, 1, 2, 3], None, (0, 0, math.nan)),
        ([-1, 1, -1, -1], None, (2, 2, 1.5)),
        ([-1, -1, -1, -1], None, (1, 4, 4.0)),
        ([-1, -1, -1, 3], [0, 1, 0, 0], (2, 1, 1.0)),
        ([-1, -1, -1, -1], [1, 1, 1, 1], (0, 0, math.nan)),
    ],
)
def test_bursts_are_losses_of_consecutive_packets(sample, dark, bursts):
    np.testing.assert_equal(packets_of([0, 1, 2, 3], sample, dark).bursts, Bursts(*bursts))


def test_each_packet_of_a_run_worked_out_on_paper():
    """Sent at 0, 2, ..., 10; 0 is prompt, 4 overtakes 2, 6 is lost, 8 dark, 10 is out of reach."""
    values = {"v2v.period": 0.02, "v2v.jitter": 0.05, "v2v.blackouts": [0.08, 0.09]}
    one = Scenario.from_values({"platoon.followers": 1, "run.duration": 0.14, **values})
    run = simulate(one.with_values({"leader.start": 0.0}))
    arrived = Arrivals(np.array([0, 4, 2]), np.array([0, 5, 6]), np.zeros(3))
    found = link_packets(dataclasses.replace(run, arrivals=(arrived,)))[0]
    assert found.source.tolist() == [0, 2, 4, 6, 8]
    assert found.sample.tolist() == [0, 6, 5, -1, -1]
    assert found.lost.tolist() == [False, False, False, True, True]
    assert found.late.tolist() == [False, True, True, False, False]
    assert found.overtaken.tolist() == [False, True, False, False, False]
    assert found.dark.tolist() == [False, False, False, False, True]
    link = compute_metrics(dataclasses.replace(run, arrivals=(arrived,))).reception[0]
    assert (link.sent, link.arrived, link.lost, link.dark) == (4, 3, 1, 1)
    assert (link.late, link.overtaken, link.bursts) == (2, 1, Bursts(1, 1, 1.0))


def test_bursts_of_gilbert_are_as_long_as_theory_says():
    """In good times nothing is lost: after a lost packet, bad with 0.7 and lost with 0.95."""
    one = scenario_of("gilbert_tamu", **{"platoon.followers": 12, "run.duration": 100.0})
    bursts = [link.bursts for link in compute_metrics(simulate(one)).reception]
    again = (1.0 - 0.3) * 0.95
    number = sum(one.number for one in bursts)
    mean = sum(one.number * one.mean for one in bursts) / number
    deviation = math.sqrt(again) / (1.0 - again) / math.sqrt(number)
    assert abs(mean - 1.0 / (1.0 - again)) < 4.0 * deviation
    assert 15 < max(one.longest for one in bursts) < 60


def test_counts_over_time_are_those_of_the_links():
    run = simulate(Scenario.from_values({**SHORT, **LATE, "v2v.blackouts": [4.0, 6.0]}))
    found, links = packets_over_time(run), compute_metrics(run).reception
    assert found.sent.sum(axis=1).tolist() == [link.sent + link.dark for link in links]
    assert found.lost.sum(axis=1).tolist() == [link.lost + link.dark for link in links]
    dark = (found.edges[:-1] >= 4.0) & (found.edges[1:] <= 6.0)
    assert (found.lost[:, dark] == found.sent[:, dark]).all()
    assert np.isnan(found.delay[:, dark]).all()
    light = found.delay[:, found.edges[1:] < 4.0]
    assert 0.1 < np.min(light) <= np.max(light) <= 0.31
    assert all(link.overtaken > 10 for link in links)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("channel", "foreign"), [("cam_lossy", True), ("gilbert_tamu", False), ("attacked", True)]
)
def test_a_bag_says_what_the_arrays_say(bags, tmp_path, channel, foreign):
    """Every number and every bin, to the last bit; a foreign bag has log times of its own."""
    one = scenario_of(channel, **FALLBACK)
    run = simulate(one)
    write = bags.foreign if foreign else bags.bag
    report = analyse(write(tmp_path / "bag", one, bags.record(one)), runs=0)
    assert report.run.findings == ()
    read = report.run.trajectory
    np.testing.assert_equal(_plain(compute_metrics(read)), _plain(compute_metrics(run)))
    np.testing.assert_equal(packets_over_time(read), packets_over_time(run))
    assert read.share is not None
    np.testing.assert_array_equal(read.share, run.share)
    np.testing.assert_equal(report.age_margins, age_margins(run, judge(one).followers))
    assert report.recomputed.links.largest == report.consistency.largest == 0.0


def _plain(metrics):
    return {field.name: getattr(metrics, field.name) for field in dataclasses.fields(metrics)}


def test_the_age_is_compared_with_the_margin():
    """Case A bears 0.073 s: every packet 0.07 s late is below, 0.08 s above all the time."""
    for late, share in ((0.07, 0.0), (0.08, 1.0)):
        one = Scenario.from_values({**SHORT, "v2v.latency": late})
        (found, *_) = age_margins(simulate(one), judge(one).followers)
        assert found.margin == pytest.approx(0.07336, abs=1e-5)
        assert found.share_above == share
    one = Scenario.from_values({**SHORT, "v2v.period": 0.1, "v2v.loss": 0.3})
    assert age_margins(simulate(one), judge(one).followers)[1].margin == found.margin
    silent = Scenario.from_values({**SHORT, "v2v.loss": 1.0})
    nothing = age_margins(simulate(silent), judge(silent).followers)
    assert describe_age(nothing) == "unknown"


def test_a_margin_that_is_not_known_is_not_the_largest():
    unknown = AgeMargin(0, 2, math.nan, math.nan)
    known = AgeMargin(1, 2, 0.05, 0.5)
    assert "for 50 % of the time (vehicle 2)" in describe_age([unknown, known])


def test_packets_of_a_run_whose_losses_and_latency_change():
    """Everything arrives at once, then nothing, then all of it 0.05 s late."""
    changes = ("4 link_1 v2v.loss=1", "6 link_1 v2v.loss=0", "6 link_1 v2v.latency=0.05")
    run = simulate(Scenario.from_values({**SHORT, "run.timeline": changes}))
    first, *others = compute_metrics(run).reception
    assert (first.sent, first.lost, first.late) == (1201 - 5, 200, 601 - 5)
    assert first.bursts == Bursts(1, 200, 200.0)
    assert first.loss_probability == pytest.approx(200 / 1196)
    assert not first.loses_too_much
    assert [link.lost for link in others] == [0, 0]
    verdict = judge(run.scenario)
    assert not verdict.certified
    assert verdict.followers == judge(run.scenario.with_values({"run.timeline": ()})).followers
    assert any("parameters change from 4 s on" in reason for reason in verdict.void)


@pytest.mark.parametrize(("in_order", "counted"), [(False, 1150 + 21), (True, 1150)])
def test_a_latency_that_comes_late_hides_no_packet_before(in_order, counted):
    """From 11.5 to 11.8 s packets come after the end, and later ones where these wait for them."""
    losses = ("4 link_1 v2v.loss=1", "5 link_1 v2v.loss=0")
    latencies = ("11.5 link_1 v2v.latency=9", "11.8 link_1 v2v.latency=0")
    values = {**SHORT, "v2v.in_order": in_order, "run.timeline": losses + latencies}
    link = compute_metrics(simulate(Scenario.from_values(values))).reception[0]
    assert (link.sent, link.lost) == (counted, 100)
