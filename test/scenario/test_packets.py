"""Parameters of what packets say and how long they take: what is refused, what is left alone."""

import pytest

from cacc_platoon.cli import main
from cacc_platoon.model import Forgery, Lattice
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.parameter import ScenarioError

WATCH = {"v2v.monitor": "report"}
ISO = {"vehicle.limits": "iso15622"}
RULE = 'must be "BEGIN END WHAT"'


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"v2v.jitter": -0.1}, "v2v.jitter = -0.1 s must be >= 0 and <= 10"),
        ({"v2v.jitter": 11.0}, "v2v.jitter = 11.0 s must be >= 0 and <= 10"),
        ({"v2v.jitter_law": "normal"}, "v2v.jitter_law = 'normal' must be uniform | gamma"),
        ({"v2v.jitter_shape": 0}, "v2v.jitter_shape = 0 must be >= 1 and <= 100"),
        ({"v2v.jitter_shape": 1.5}, "v2v.jitter_shape = 1.5 must be a whole number"),
        ({"v2v.in_order": "often"}, "v2v.in_order = 'often' must be true or false"),
        ({"v2v.bias": float("nan")}, "v2v.bias = nan m/s^2 must be"),
        ({"v2v.noise_std": -1.0}, "v2v.noise_std = -1.0 m/s^2 must be >= 0"),
        ({"v2v.quantum": -0.1}, "v2v.quantum = -0.1 m/s^2 must be >= 0"),
        ({"v2v.quantum": 0.1, "v2v.saturation": 0.05}, "v2v.saturation = 0.05 m/s^2 must be at"),
        ({"v2v.false_data": ["20 40"]}, RULE),
        ({"v2v.false_data": ["20 40 lies"]}, RULE),
        ({"v2v.false_data": ["40 20 frozen"]}, RULE),
        ({"v2v.false_data": ["20 20 frozen"]}, RULE),
        ({"v2v.false_data": ["-1 20 frozen"]}, RULE),
        ({"v2v.false_data": ["0 20 frozen=1"]}, RULE),
        ({"v2v.false_data": ["0 20 factor"]}, RULE),
        ({"v2v.false_data": ["0 20 factor=inf"]}, RULE),
        ({"v2v.false_data": ["0 20 replay=-2"]}, RULE),
        ({"v2v.false_data": ["0 1e9 frozen"]}, RULE),
        ({"v2v.false_data": ["0 nan frozen"]}, RULE),
        ({"v2v.false_data": ["0 20 factor=2", "15 30 frozen"]}, "must not overlap, as they do at"),
        ({"v2v.false_data": [3.0]}, "v2v.false_data"),
        ({"v2v.send_rule": "often"}, "v2v.send_rule = 'often' must be periodic"),
        ({"v2v.send_rule": "cam", "v2v.period": 0.1}, "v2v.period = 0.1 s must be 0 where v2v.se"),
        ({"v2v.send_rule": "cam", "v2v.cam_check": 0.015}, "v2v.cam_check = 0.015 s must be a mul"),
        ({"v2v.send_rule": "cam", "v2v.phase": 0.1}, "v2v.phase = 0.1 s must be a multiple of"),
        ({"v2v.cam_check": 0.0}, "v2v.cam_check = 0.0 s must be > 0"),
        ({"v2v.reception": "wait"}, "v2v.reception = 'wait' must be hold"),
        ({"v2v.fallback_after": 0.0}, "v2v.fallback_after = 0.0 s must be > 0"),
        ({"v2v.fallback_blend": -1.0}, "v2v.fallback_blend = -1.0 s must be > 0"),
        ({"v2v.fallback_return": 0.0}, "v2v.fallback_return = 0.0 s must be > 0"),
        ({"v2v.fallback_headway": 1.0}, "v2v.fallback_headway = 1.0 s must be above 2 vehicle.ta"),
        ({"v2v.monitor": "loud"}, "v2v.monitor = 'loud' must be none | report | fallback"),
        ({"v2v.monitor": "fallback"}, "v2v.monitor = 'fallback' needs v2v.reception = fallback"),
        ({**WATCH, "v2v.monitor_window": 0.0}, "v2v.monitor_window = 0.0 s must be > 0"),
        ({**WATCH, "v2v.monitor_window": 0.005}, "must be above 0.01 s: packets are up to 0.01 s"),
        ({**WATCH, "v2v.latency": 2.0}, "v2v.monitor_window = 2.0 s must be above 2.01 s: packets"),
        (
            {**WATCH, "v2v.period": 2.5},
            "= 2.0 s must be above 2.5 s: packets are up to 2.5 s apart",
        ),
        (
            {**WATCH, "v2v.period": 1.0, "v2v.latency": 1.0},
            "must be above 2 s: packets are up to 1",
        ),
        (
            {**WATCH, "v2v.send_rule": "cam", "v2v.monitor_window": 1.0},
            "v2v.monitor_window = 1.0 s must be above 1 s: packets are up to 1 s apart and take",
        ),
        (
            {**WATCH, "v2v.send_rule": "cam", "v2v.cam_check": 0.8, "v2v.monitor_window": 1.5},
            "v2v.monitor_window = 1.5 s must be above 1.6 s: packets are up to 1.6 s apart",
        ),
        (
            {**WATCH, "run.timeline": ("3 link_2 v2v.latency=5",)},
            "must be above 5.01 s: packets are up to 0.01 s apart and take up to 5 s",
        ),
        ({**WATCH, "v2v.monitor_margin": -1.0}, "v2v.monitor_margin = -1.0 must be >= 0"),
        ({**WATCH, "v2v.monitor_jerk": float("inf")}, "v2v.monitor_jerk = inf m/s^3 must be fin"),
        ({"sensing.delay": -0.1}, "sensing.delay = -0.1 s must be >= 0"),
        ({"sensing.range_std": -0.1}, "sensing.range_std = -0.1 m must be >= 0"),
        ({"sensing.range_rate_std": "low"}, "sensing.range_rate_std = 'low' m/s must be a number"),
        ({"vehicle.limits": "iso"}, "vehicle.limits = 'iso' must be none"),
        ({"vehicle.max_jerk": 0.0}, "vehicle.max_jerk = 0.0 m/s^3 must be > 0"),
        ({**ISO, "leader.profile": "brake", "leader.deceleration": 6.0}, "it brakes with 6 m/s^2"),
        ({**ISO, "leader.profile": "step", "leader.acceleration": 4.5}, "accelerates with 4.5 m/s"),
    ],
)
def test_what_is_refused(values, words):
    with pytest.raises(ScenarioError) as caught:
        Scenario.from_values(values)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_nothing_starts(tmp_path, capsys):
    asked = ["simulate", "-o", str(tmp_path / "run"), "--set", 'v2v.false_data=["1 2 lies"]']
    assert main([*asked[:1], "config/paper_a.yaml", *asked[1:]]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_a_monitor_that_cannot_look_back_a_sample_starts_nothing(tmp_path, capsys):
    wrong = ["--set", "v2v.monitor=report", "--set", "v2v.monitor_window=0.001"]
    asked = ["simulate", "config/paper_a.yaml", "-o", str(tmp_path / "run"), *wrong]
    assert main(asked) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_times_are_samples():
    scenario = Scenario.from_values(
        {"v2v.false_data": ["4 5 frozen", "0.5 1.005 factor=-1", "2 3 replay=0.5"]}
    )
    assert scenario.follower(1).forgeries == [
        Forgery(50, 101, factor=-1.0),
        Forgery(200, 300, older=50),
        Forgery(400, 500, frozen=True),
    ]


@pytest.mark.parametrize(
    ("values", "counted"),
    [
        ({"v2v.bias": 0.1}, False),
        ({"v2v.quantum": 0.1, "v2v.saturation": 16.0}, False),
        ({"v2v.false_data": ["1 2 frozen"]}, False),
        ({"v2v.jitter": 0.02}, True),
        ({"v2v.jitter": 0.02, "v2v.in_order": True}, True),
        ({"v2v.in_order": True}, False),
    ],
)
def test_packets_are_counted_where_they_may_be_late(values, counted):
    assert Scenario.from_values(values).follower(1).counted is counted


def test_latency_in_the_mean_and_at_most():
    follower = Scenario.from_values({"v2v.latency": 0.02, "v2v.jitter": 0.04}).follower(1)
    assert (follower.latency_steps, follower.longest_latency_steps) == (4, 6)
    assert Scenario.from_values({"v2v.latency": 0.025}).follower(1).latency_steps == 3
    assert Scenario.from_values({"v2v.quantum": 0.1}).follower(1).lattice == Lattice(0.1, 0.0)
