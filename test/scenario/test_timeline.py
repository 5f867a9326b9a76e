"""Timelines: texts that are read, texts that are refused, changes and the events they are."""

import numpy as np
import pytest

from cacc_platoon.scenario import Scenario, ScenarioError
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.scenario.timeline import CHANGEABLE, Change, change_of, read_change

WRONG = {
    "20 link_3": "must be",
    "20 link_3 v2v.loss": "must be",
    "soon link_3 v2v.loss=1": "must be",
    "-1 link_3 v2v.loss=1": "must be",
    "nan link_3 v2v.loss=1": "must be",
    "1e99 link_3 v2v.loss=1": "must be",
    "20 link_0 v2v.loss=1": "must be",
    "20 leader v2v.loss=1": "must be",
    "20 link_3 v2v.loss=much": "must be",
    "20 link_3 v2v.period=0.1": "must be",
    "20 vehicle_3 v2v.loss=1": "must be",
    "20 link_3 controller.time_headway=1": "must be",
    "20 vehicle_3 controller.time_headway=0": "controller.time_headway = 0",
    "20 link_3 v2v.loss=1.5": "v2v.loss = 1.5",
    "\u0662 link_3 v2v.loss=1": "must be",
    "20 link_3 v2v.loss=1_0e-1": "must be",
    "20 link_3 v2v.latency=-0.1": "v2v.latency = -0.1",
    "20 link_13 v2v.loss=1": "names no follower of this platoon",
    "200.01 link_3 v2v.loss=1": "must be within the run",
}


@pytest.mark.parametrize("text", WRONG)
def test_what_cannot_be_carried_out_is_refused_in_a_line(text):
    with pytest.raises(ScenarioError) as error:
        Scenario.from_values({"run.timeline": [text]})
    line = str(error.value)
    assert WRONG[text] in line
    assert "\n" not in line
    assert "run.timeline" in line


@pytest.mark.parametrize(
    ("own", "text"),
    [
        ({"controller.law": "module:Law"}, "20 vehicle_3 controller.time_headway=1"),
        ({"v2v.channel": "module:Channel"}, "20 link_3 v2v.loss=1"),
    ],
)
def test_custom_code_takes_no_changes(own, text):
    with pytest.raises(ScenarioError, match=r"which module:\w+ ignores"):
        Scenario.from_values({"run.timeline": [text]}, {3: own})


@pytest.mark.parametrize("step", [0.01, 0.003, 0.1])
@pytest.mark.parametrize("sample", [0, 1, 7, 1999, 123_457, 26_000_003])
def test_a_change_is_read_back_from_its_text(sample, step):
    for kind, names in CHANGEABLE.items():
        for name in names:
            change = Change(sample, 3, name, 1.0 / 3.0)
            assert change.kind == kind
            assert read_change(change.text(step), step, "test") == change


def test_a_time_between_samples_takes_effect_at_the_next():
    assert read_change("0.0101 link_1 v2v.loss=1", 0.01, "test").sample == 2


def test_changes_come_in_the_order_of_time_and_each_keeps_what_others_brought():
    texts = ["3 link_1 v2v.loss=0.3", "1 link_1 v2v.loss=0.1", "2 link_1 v2v.bias=0.2"]
    stages = Scenario.from_values({"run.timeline": texts}).follower(1).stages
    assert [(start, stage.v2v.loss, stage.v2v.bias) for start, stage in stages] == [
        (0, 0.0, 0.0),
        (100, 0.1, 0.0),
        (200, 0.1, 0.2),
        (300, 0.3, 0.2),
    ]


def test_of_changes_at_one_sample_the_last_counts_and_is_the_one_in_the_record():
    one = Scenario.from_values({"run.timeline": ["1 link_1 v2v.loss=0.1"]})
    done = one.with_changes([Change(100, 1, "v2v.loss", 0.2), Change(100, 1, "v2v.loss", 0.3)])
    assert done.run.timeline == ("1 link_1 v2v.loss=0.3",)
    assert Scenario.from_values(done.values()).run.timeline == done.run.timeline


def test_what_contradicts_itself_or_has_no_end_is_refused():
    twice = ["1 link_1 v2v.loss=0.1", "1.0 link_1 v2v.loss=0.2"]
    with pytest.raises(ScenarioError, match="must be the only one of its time"):
        Scenario.from_values({"run.timeline": twice})
    many = [f"{k / 10} link_1 v2v.loss=0.1" for k in range(1001)]
    with pytest.raises(ScenarioError, match="must have 1000 entries at most, not 1001"):
        Scenario.from_values({"run.timeline": many})


def test_vehicles_that_touch_at_the_start_are_refused_before_anything_starts():
    touching = {"vehicle.length": 28.75}
    with pytest.raises(ScenarioError, match=r"vehicle_1 28\.75 m .* more than its length"):
        Scenario.from_values(touching)
    Scenario.from_values({**touching, "run.stop_on_collision": False})
    Scenario.from_values({"vehicle.length": 28.7})


@pytest.mark.parametrize(
    ("node", "text"),
    [
        ("vehicle_3/vehicle", "v2v.loss=1.0"),
        ("vehicle_3/noise_relay", "controller.time_headway=1.0"),
        ("vehicle_3/noise_relay", "v2v.latency=0.1"),
        ("vehicle_3/noise_relay", "v2v.loss=2.0"),
        ("vehicle_3/noise_relay", "v2v.loss=nan"),
        ("vehicle_3/noise_relay", "v2v.loss"),
        ("leader", "v2v.loss=1.0"),
    ],
)
def test_an_event_of_no_change_is_refused(node, text):
    with pytest.raises((ValueError, ScenarioError)):
        change_of(RunEvent(EventKind.CHANGE, 5, node, text))


@pytest.mark.slow
@pytest.mark.parametrize("jitter", [0.0, 0.2])
@pytest.mark.parametrize("size", [1, 30, 101])
def test_packets_wait_for_earlier_ones_across_a_change(jitter, size):
    """Those of 1 s on take no time, and wait for those before, which take 0.5 s."""
    changes = ("1 link_1 v2v.latency=0", "4 link_1 v2v.latency=0.1")
    late = {"v2v.latency": 0.5, "v2v.jitter": jitter, "v2v.in_order": True}
    one = Scenario.from_values({**late, "run.timeline": changes}).follower(1)
    whole = one.channel().delivery(0, 600)
    assert (np.diff(whole.source) > 0).all()
    waiting = whole.sample[(whole.source >= 100) & (whole.source < 149)]
    assert (waiting >= 149).all()
    parts = [one.channel().delivery(k, min(k + size, 600)) for k in range(0, 600, size)]
    for column in ("source", "sample"):
        joined = np.concatenate([getattr(part, column) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole, column))


def test_a_change_keeps_earlier_ones_of_other_names():
    texts = ["1 link_1 v2v.loss=0.1", "2 link_1 v2v.bias=0.5", "2 link_1 v2v.latency=0.3"]
    *_, (start, last) = Scenario.from_values({"run.timeline": texts}).follower(1).stages
    assert (start, last.v2v.loss, last.v2v.bias, last.v2v.latency) == (200, 0.1, 0.5, 0.3)


def test_each_vehicle_moves_its_headway_at_its_own_rate():
    texts = ["0 vehicle_1 controller.time_headway=2", "0 vehicle_2 controller.time_headway=2"]
    quick = {"controller.headway_rate": 0.5}
    scenario = Scenario.from_values(
        {"run.timeline": texts, "controller.headway_rate": 0.1}, {2: quick}
    )
    for index, rate in ((1, 0.1), (2, 0.5)):
        headways = scenario.follower(index).headways(50)
        assert headways is not None
        assert np.diff(headways) == pytest.approx(rate * scenario.run.step)
