"""What a report says of monitors: alarms, delays, false ones, of bags as of simulations."""

import dataclasses
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from cacc_platoon.analysis import compute_metrics
from cacc_platoon.analysis.monitor import NO_ALARM, _use, monitor_line, monitor_use
from cacc_platoon.cli.simulate import simulate_run
from cacc_platoon.report import report_run, summary
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import simulate, simulate_mean
from cacc_platoon.simulation.monitoring import alarms

FALSE = ("2 3 factor=3", "12 14 factor=-1", "20 21 factor=1", "300 301 frozen")
WATCHED = {
    "platoon.followers": 3,
    "run.duration": 30.0,
    "leader.angular_frequency": 0.5,
    "v2v.monitor": "report",
    "vehicle_2.v2v.false_data": FALSE,
}


def scenario(more=None):
    return Scenario.from_values({}).with_values({**WATCHED, **(more or {})})


def test_delays_are_of_each_time_of_false_data_and_of_that_link_alone():
    first, second, third = monitor_use(simulate(scenario()))
    assert (first.follower, first.alarms, first.detections, first.spans) == (1, 0, (), ())
    assert math.isnan(first.begin)
    assert third.alarms == 0
    cruising, reversed_, unchanged = second.detections
    assert (cruising.begin, cruising.end) == (2.0, 3.0)
    assert math.isnan(cruising.delay)
    assert reversed_.delay == 0.01
    assert math.isnan(unchanged.delay)
    assert second.alarms == len(second.spans) >= 1
    assert second.false_alarms == 0
    assert second.begin == second.spans[0][0] == pytest.approx(12.01)
    assert second.spans[-1][1] == pytest.approx(second.end + 0.01)
    lasted = sum(end - begin for begin, end in second.spans)
    assert second.share == pytest.approx(lasted / 30.01)
    assert monitor_line(second).endswith(
        "false data from 2 s on not noticed; false data from 12 s on noticed after 0.01 s; "
        "false data from 20 s on not noticed"
    )


def test_alarms_outside_of_false_data_are_false_ones():
    noisy = {"sensing.range_rate_std": 0.1, "v2v.monitor_margin": 2.0}
    first, second, _ = monitor_use(simulate(scenario(noisy)))
    assert first.false_alarms == first.alarms > 10
    assert 10 < second.false_alarms < second.alarms
    usual = monitor_use(simulate(scenario({"sensing.range_rate_std": 0.1})))
    assert [one.false_alarms for one in usual] == [0, 0, 0]


@pytest.mark.parametrize("late", [0.0, 0.2])
@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_what_false_data_may_still_cause_is_not_false(late, delay):
    """Packets that are late, measured with a delay, are in the window that much longer."""
    values = {"v2v.latency": late, "sensing.delay": delay}
    one = scenario({"vehicle_2.v2v.false_data": ("2 3 factor=3",), **values})
    run, window = simulate(one), round(one.follower(2).v2v.monitor_window * 100)
    until = 300 + window + round(100 * (late + delay))
    for begin, false in ((199, 1), (200, 0), (until - 1, 0), (until, 1)):
        alarm = np.zeros(len(run.time), np.bool_)
        alarm[begin : begin + 1] = True
        used = _use(one.follower(2), alarm, run)
        assert (used.alarms, used.false_alarms) == (1, false)


def test_in_the_mean_there_is_no_packet_to_watch():
    assert monitor_use(simulate_mean(scenario())) == []
    assert monitor_use(simulate(scenario({"v2v.monitor": "none"}))) == []


@pytest.mark.parametrize(
    "more",
    [
        {"v2v.monitor": "fallback", "v2v.reception": "fallback", "v2v.loss": 0.2},
        {
            "v2v.receiver": "own_parts:Forgetting",
            "sensing.delay": 0.05,
            "sensing.range_rate_std": 0.02,
            "v2v.latency": 0.03,
        },
    ],
)
def test_a_bag_says_the_same_and_the_report_tells_it(more, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "system"))
    one = scenario(more)
    simulate_run(one, tmp_path / "run")
    simulated = compute_metrics(simulate(one))
    monkeypatch.setitem(sys.modules, "own_parts", None)  # a report runs no code of the user's
    report, document = report_run(tmp_path / "run", runs=0)
    assert report.run.findings == ()
    assert repr(report.measured.monitor) == repr(simulated.monitor)
    assert report.consistency.largest == 0.0
    assert document["monitor"][1]["detections"][0]["delay"] is None
    assert document["monitor"][1]["detections"][1]["delay"] > 0.0
    text = summary(report, document)
    assert "monitor, vehicle 2: " in text
    assert "monitor: no alarm of 2 followers, which proves nothing" in text
    page = (tmp_path / "run" / "report.html").read_text()
    assert "Assumption monitor" in page
    assert "That there is none proves nothing" in page
    assert (tmp_path / "run" / "figures" / "monitor.svg").is_file()


def test_errors_that_a_timeline_brings_are_allowed_for():
    changes = ("5 link_1 v2v.bias=0.4", "10 link_1 v2v.bias=0")
    changed = scenario({"vehicle_2.v2v.false_data": (), "run.timeline": changes})
    run = simulate(changed)
    assert not alarms(run)[1].any()
    unsaid = dataclasses.replace(run, scenario=changed.with_values({"run.timeline": ()}))
    assert alarms(unsaid)[1].any()


@pytest.mark.parametrize("bias", [0.4, -0.4])
@pytest.mark.parametrize("sensing", [{}, {"sensing.delay": 0.35}])
def test_what_a_scenario_says_of_errors_and_sensors_is_no_alarm(bias, sensing):
    """A bias of either sign, and a sensor that is late: the monitor knows of both."""
    values = {"vehicle_2.v2v.false_data": (), "v2v.bias": bias, "v2v.noise": "none", **sensing}
    quick = {"leader.angular_frequency": 3.0, "leader.amplitude": 3.0, "v2v.monitor_jerk": 0.0}
    used = monitor_use(simulate(scenario({**values, **quick})))
    assert [one.alarms for one in used] == [0, 0, 0]


def test_what_an_alarm_takes_for_granted_is_said():
    assert "no w within rho and jerk within v2v.monitor_jerk explains" in NO_ALARM
