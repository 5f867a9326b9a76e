"""Scenario files: what is refused, in which words, what is accepted, and that nothing is lost."""

import math
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cacc_platoon.model import State, expected_factor
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario, load_scenario, parse_scenario
from cacc_platoon.scenario.parameter import ScenarioError
from cacc_platoon.scenario.table import TABLE
from cacc_platoon.scenario.v2v_parameters import PAPER_BITS

CONFIG = Path(__file__).parents[2] / "config"


def document(parameters: str, section: str = "/**") -> str:
    """Return a parameter file of one section, given in YAML flow style."""
    return f"{section}:\n  ros__parameters: {parameters}\n"


def refusal(text: str, *set_values: str) -> str:
    """Return the line with which a file is refused."""
    with pytest.raises(ScenarioError) as error:
        parse_scenario(text, "my.yaml", settings=set_values)
    line = str(error.value)
    assert "\n" not in line
    return line


# key, value as YAML, rule, remedy
WRONG_VALUES = [
    ("platoon.followers", "'12'", "must be a whole number", "the number of vehicles"),
    ("platoon.followers", "12.0", "must be a whole number", "the number of vehicles"),
    ("platoon.followers", "true", "must be a whole number", "the number of vehicles"),
    ("platoon.followers", "0", "must be >= 1 and <= 500", "the number of vehicles"),
    ("platoon.followers", "501", "must be >= 1 and <= 500", "the number of vehicles"),
    ("platoon.standstill_distance", "-0.1", "must be >= 0", "the spacing d at rest"),
    ("platoon.initial_speed", "-5", "must be >= 0", "the speed in equilibrium"),
    ("platoon.namespace", "platoon", "must be a ROS name", "the prefix of every topic"),
    ("platoon.namespace", "/a//b", "must be a ROS name", "the prefix of every topic"),
    ("platoon.namespace", "3", "must be a text", "the prefix of every topic"),
    ("vehicle.tau", "0", "must be > 0", "the actuation lag tau"),
    ("vehicle.tau", "'0.5'", "must be a number or a list of numbers", "the actuation lag tau"),
    ("vehicle.tau", "0.6", "must be <= vehicle.tau_max = 0.5 s", "the actuation lag tau"),
    ("vehicle.tau", "[0.5, 0.4]", "has 2 values for 12 followers", "one per follower"),
    ("controller.time_headway", "-1", "must be > 0", "the time headway h_w"),
    ("controller.time_headway", ".nan", "must be finite", "the time headway h_w"),
    ("controller.k_v", ".inf", "must be finite", "the gain on the velocity error"),
    ("controller.k_v", "null", "must be a number", "the gain on the velocity error"),
    ("controller.k_v", "[1.0]", "must be a number", "the gain on the velocity error"),
    ("controller.k_p", "0", "must be > 0", "the gain on the spacing error"),
    ("v2v.rho", "1", "must be > 1", "the linear signal-to-noise ratio"),
    ("v2v.rho", "0.5", "must be > 1", "the linear signal-to-noise ratio"),
    ("v2v.snr_db", "0", "must be > 0", "the signal-to-noise ratio"),
    ("v2v.snr_db", "1.0e+9", "must be > 0 and <= 300", "the signal-to-noise ratio"),
    ("v2v.noise", "gauss", "must be bits | expected | none", "random bits"),
    ("v2v.bit_probabilities", "[]", "must have 1 to 32 values", "the probabilities"),
    ("v2v.bit_probabilities", "[0.5, 1.0]", "must be > 0 and < 1", "the probabilities"),
    ("v2v.bit_probabilities", "[0.5, x]", "must be a list of numbers", "the probabilities"),
    ("v2v.hold", "0.015", "must be a multiple of 0.01 s", "the time one draw"),
    ("leader.profile", "zigzag", "must be sine | step | brake", "the leader's motion"),
    ("leader.times", "[0, 1]", "must be as many as leader.speeds", "the times of csv"),
    ("run.step", "1.0e-10", "must be a whole number of nanoseconds", "the control period T"),
    ("run.step", "1.0e-19", "must be a whole number of nanoseconds", "the control period T"),
    ("run.step", "0.0100000000001", "must be a whole number of nanos", "the control period T"),
    ("run.step", "1.5", "must be > 0 and <= 1", "the control period T"),
    ("run.duration", "0.015", "must be a whole number of steps of 0.01", "the simulated time"),
    ("run.duration", "1.0e-300", "must be a whole number of steps", "the simulated time"),
    ("run.duration", "1.0e+300", "must be at most 100000000 steps", "the simulated time"),
    ("run.seed", "-1", "must be >= 0", "the seed of all noise"),
    ("run.seed", "9223372036854775808", "must be < 2^63", "the seed of all noise"),
    ("run.hosts", "some", "must be auto, per_node or a whole number", "the number of processes"),
    ("run.hosts", "0", "must be >= 1", "the number of processes"),
    ("run.hosts", "2.0", "must be a whole number or a text", "the number of processes"),
    ("run.spawn", "1", "must be true or false", "whether the supervisor"),
    ("run.window", "0", "must be >= 1 and <= 1000", "how far the leader"),
    ("record.directory", "[a]", "must be a text", "the run folder"),
]


@pytest.mark.parametrize(("key", "value", "rule", "remedy"), WRONG_VALUES)
def test_a_wrong_value_is_refused_by_file_key_value_rule_and_remedy(key, value, rule, remedy):
    line = refusal(document(f"{{{key}: {value}}}"))
    assert line.startswith(f"my.yaml: {key} = ")
    shown = {".nan": "nan", ".inf": "inf", "'12'": "'12'"}.get(value, value.strip("'"))
    if not any(mark in value for mark in "e[.g/"):
        assert shown in line.partition(" must ")[0]
    assert rule in line
    assert f"Give {TABLE[key].meaning if key in TABLE else 'the signal'}" in line
    assert remedy in line.partition(". Give ")[2] or remedy in line
    assert line.endswith(".")


@pytest.mark.parametrize(
    ("key", "suggestion"),
    [
        ("controller.time_headways", "Did you mean controller.time_headway?"),
        ("controller.headway", "Did you mean controller.time_headway?"),
        ("platoon.folowers", "Did you mean platoon.followers?"),
        ("v2v.bit_probability", "Did you mean v2v.bit_probabilities?"),
        ("run.sede", "Did you mean run.seed?"),
        ("v2v.snr", "Did you mean v2v.snr_db?"),
        ("xyzzy", "See the parameter table"),
    ],
)
def test_an_unknown_key_is_refused_with_a_suggestion(key, suggestion):
    line = refusal(document(f"{{{key}: 1.0}}"))
    assert line.startswith(f"my.yaml: unknown key {key}, it would be ignored. ")
    assert suggestion in line


CONTRADICTIONS = {
    "{v2v: {rho: 5, snr_db: 14}}": "v2v.rho = 5 and v2v.snr_db = 14 dB are two values",
    "{leader: {profile: csv}}": "leader.file = '' must name a file",
    "{leader: {profile: csv, file: none.csv}}": "leader.file = 'none.csv': none.csv: cannot be",
    "{leader: {profile: brake, final_speed: 30}}": "must be below platoon.initial_speed = 25",
    "{leader: {profile: csv, times: [0, 0], speeds: [25, 25]}}": "must be two or more, increase",
    "{leader: {profile: csv, times: [0], speeds: [25]}}": "must be two or more",
    "{leader: {profile: csv, times: [1, 2], speeds: [25, 24]}}": "begin with 0",
    "{leader: {profile: csv, times: [0, 1], speeds: [20, 25]}}": "must be the first speed",
    f"{{vehicle: {{tau: {[0.5] * 13}}}}}": "has 13 values for 12 followers",
    "{vehicle: {tau: 0.5, tau_max: 0.4}}": "must be <= vehicle.tau_max = 0.4 s",
}


@pytest.mark.parametrize("parameters", CONTRADICTIONS)
def test_values_that_contradict_each_other_are_refused(parameters):
    line = refusal(document(parameters))
    assert line.startswith("my.yaml: ")
    assert CONTRADICTIONS[parameters] in line


NOT_SCENARIOS = {
    "": "holds no parameters. Begin with /**",
    "a": "holds no parameters",
    "- 1": "holds no parameters",
    "/**: {}": "holds no parameters",
    "/**:\n  ros__parameters:\n": "ros__parameters of /** holds no parameters",
    "/**:\n  ros__parameters: 3\n": "ros__parameters of /** holds no parameters",
    "platoon: {followers: 3}": "/platoon has followers outside of ros__parameters",
    "ros__parameters: {run: {seed: 1}}": "the file has ros__parameters outside of",
    "/**: 3": "has /** outside of ros__parameters",
    "/**:\n  ros__parameters: {v2v: {rho: 5\n": "line 3 cannot be read as YAML: expected ','",
    "a:\n\t- b": "line 2 cannot be read as YAML: found character '\\t'",
    "a: b: c": "line 1 cannot be read as YAML: mapping values are not allowed here",
    "\x00": "cannot be read as YAML",
    "x: !!python/object:os.system {}": "cannot be read as YAML",
    "/**: {ros__parameters: {run: {seed: 1, seed: 2}}}": 'found duplicate key "seed"',
    document("{run.seed: 1}", "/other/node"): "section /other/node is for no node of the platoon",
    document("{run.seed: 1}", "/platoon/vehicle_*/vehicle"): "can be no node's name",
    document("{controller.k_v: 1.0}", "/platoon/vehicle_13/*"): "vehicle_13 has parameters of its",
    document("{controller.k_v: 1.0}", "/platoon/vehicle_0/*"): "vehicle_0 has parameters of its",
    document("{controller.k_v: 1.0}", "/platoon/vehicle_03/*"): "is for no node",
    document("{controller.k_v: 1.0}", "/platoon/supervisor"): "that reads controller.k_v",
    document("{v2v.rho: 4.0}", "/platoon/vehicle_3/vehicle"): "that reads v2v.rho",
    document("{controller.k_v: 1.0}", "/platoon/vehicle_3/noise_relay"): "reads controller.k_v",
    document("{run.seed: 1}", "/platoon/vehicle_3/*"): "vehicle_3: run.seed = 1 is common to the",
    document("{controller.kv: 1.0}", "/platoon/vehicle_3/*"): "vehicle_3: unknown key controller",
    document("{controller.k_v: -1.0}", "/platoon/vehicle_3/*"): "controller.k_v = -1.0 1/s must",
    document("{vehicle.tau: [0.5, 0.4]}", "/platoon/vehicle_3/*"): "must be one number in a vehic",
    document("{vehicle.tau: 0.9}", "/platoon/vehicle_3/*"): "vehicle_3: vehicle.tau = 0.9 s must",
}


@pytest.mark.parametrize("text", NOT_SCENARIOS)
def test_a_file_that_is_no_scenario_is_refused(text):
    line = refusal(text)
    assert line.startswith("my.yaml:")
    assert NOT_SCENARIOS[text] in line


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("controller.k_v", "--set controller.k_v: has no value. Write key=value."),
        ("controller.k_v=[", "--set controller.k_v=[: [ cannot be read as a YAML value."),
        ("controller.k_v=", "my.yaml: controller.k_v = '' 1/s must be a number"),
        ("controller.kv=1", "my.yaml: unknown key controller.kv"),
        ("vehicle_3.controller.kv=1", "my.yaml: vehicle_3: unknown key controller.kv"),
        ("vehicle_13.controller.k_v=1", "my.yaml: vehicle_13 has parameters of its own"),
        ("vehicle_3.run.seed=1", "my.yaml: vehicle_3: run.seed = 1 is common to the platoon"),
        ("controller={k_v: 1}", "my.yaml: unknown key controller"),
    ],
)
def test_a_wrong_setting_is_refused(setting, words):
    assert words in refusal(document("{}"), setting)


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00")
    for path, reason in (
        (tmp_path / "missing.yaml", "No such file or directory"),
        (tmp_path, "is a directory"),
        (binary, "is not a text file"),
    ):
        with pytest.raises(ScenarioError) as error:
            load_scenario(path)
        assert str(error.value) == f"{path}: cannot be read: {reason}. Give a scenario file."


def test_whole_numbers_are_accepted_where_numbers_are_meant():
    scenario = parse_scenario(
        document("{v2v: {rho: 5}, vehicle: {tau: 1, tau_max: 2}, run: {duration: 3}}"), "my.yaml"
    )
    assert (scenario.v2v.rho, scenario.vehicle.tau, scenario.run.duration) == (5.0, 1.0, 3.0)
    assert type(scenario.v2v.rho) is float
    assert type(scenario.follower(1).tau) is float
    assert scenario.samples == 301


def test_the_published_cases_are_the_papers():
    for letter, headway, k_v, k_p in (
        ("a", 0.95, 0.63, 0.009),
        ("b", 0.65, 0.63, 0.009),
        ("c", 0.88, 0.85, 0.003),
    ):
        scenario = load_scenario(CONFIG / f"paper_{letter}.yaml")
        gains = scenario.follower(12).gains
        assert gains[:1] + gains[2:] == (headway, k_v, k_p)
        # theory: k_a* = 0.318305009 for rho 5
        assert gains.k_a == pytest.approx(0.318305009 if letter == "c" else 0.5, abs=1e-9)
        assert (scenario.v2v.rho, scenario.v2v.bit_probabilities) == (5.0, PAPER_BITS)
        assert (scenario.vehicle.tau, scenario.platoon.standstill_distance) == (0.5, 5.0)
        assert (scenario.platoon.followers, scenario.platoon.initial_speed) == (12, 25.0)
        assert (scenario.samples, scenario.step_ns) == (20_001, 10_000_000)
        assert scenario.name == f"paper_{letter}"
        assert scenario.leader_profile().at(200.0).position == pytest.approx(5314.1592653589793)


def test_snr_in_decibel_is_20_log10_rho():
    scenario = parse_scenario(document("{v2v: {snr_db: 20}}"), "my.yaml")
    assert scenario.v2v.rho == pytest.approx(10.0, rel=1e-15)
    text = document("{v2v: {snr_db: 20}}") + document("{v2v: {rho: 4}}", "/platoon/vehicle_2/*")
    mixed = parse_scenario(text, "my.yaml", settings=["vehicle_3.v2v.snr_db=40"])
    assert [mixed.follower(i).v2v.rho for i in (1, 2, 3)] == pytest.approx([10.0, 4.0, 100.0])


def test_settings_replace_values_of_the_file():
    text = document("{controller: {k_v: 0.5}, v2v: {rho: 5}}")
    scenario = parse_scenario(
        text,
        "my.yaml",
        settings=["controller.k_v=0.7", "run.seed=9", "vehicle_2.controller.k_v=1", "v2v.snr_db=6"],
    )
    assert scenario.run.seed == 9
    assert [scenario.follower(i).gains.k_v for i in (1, 2, 3)] == [0.7, 1.0, 0.7]
    assert scenario.v2v.rho == pytest.approx(10.0**0.3)


def test_the_number_of_followers_may_be_set_where_wildcards_stand_for_all():
    text = document("{controller: {k_v: 0.7}}", "/**/vehicle")
    scenario = parse_scenario(text, "my.yaml", settings=["platoon.followers=3"])
    assert sorted(scenario.overrides) == [1, 2, 3]


def test_a_list_of_lags_is_one_per_follower():
    values = "{platoon: {followers: 3}, vehicle: {tau: [0.1, 0.2, 0.3]}}"
    scenario = parse_scenario(document(values), "my.yaml", settings=["vehicle_2.vehicle.tau=0.4"])
    assert [follower.tau for follower in scenario.followers] == [0.1, 0.4, 0.3]


def test_a_speed_table_is_found_beside_the_scenario(tmp_path):
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "speed.csv").write_text("time,speed\n0,25\n10,20\n")
    path = tmp_path / "my.yaml"
    path.write_text(document("{leader: {profile: csv, file: tables/speed.csv}}"))
    scenario = load_scenario(path)
    assert scenario.leader_profile().at(10.0) == State(225.0, 20.0, 0.0)
    resolved = parse_scenario(format_scenario(scenario), "resolved.yaml")
    assert resolved.leader_profile().at(7.0) == scenario.leader_profile().at(7.0)


def test_each_profile_is_what_its_parameters_say():
    def profile(values):
        return parse_scenario(document(values), "my.yaml").leader_profile()

    step = profile("{leader: {profile: step, acceleration: 2, hold: 3, start: 1}}")
    assert step.at(50.0).velocity == 31.0
    brake = profile("{leader: {profile: brake, deceleration: 2.5, final_speed: 5}}")
    assert brake.at(12.0).acceleration == -2.5
    assert brake.at(50.0).velocity == 5.0
    assert profile("{leader: {profile: constant}}").at(7.0) == State(175.0, 25.0, 0.0)


def test_each_kind_of_noise_has_its_channel():
    def first(values):
        return parse_scenario(document(values), "my.yaml").follower(2).noise().factors(0, 50)

    assert set(first("{v2v: {noise: none}}")) == {1.0}
    assert set(first("{v2v: {noise: expected}}")) == {expected_factor(5.0, PAPER_BITS)}
    assert len(set(first("{v2v: {noise: bits}}"))) > 40
    assert len(set(first("{v2v: {noise: bits, hold: 0.25}}"))) == 2
    assert first("{}").tolist() != first("{run: {seed: 2}}").tolist()


def test_times_are_whole_nanoseconds():
    for step, nanoseconds in ((0.01, 10_000_000), (1e-9, 1), (0.0333333333, 33_333_333)):
        values = {"run.step": round(step, 9), "run.duration": round(step, 9) * 30}
        scenario = Scenario.from_values(values)
        assert (scenario.step_ns, scenario.samples) == (nanoseconds, 31)


positive = st.floats(1e-6, 10.0)
own_values = st.fixed_dictionaries(
    {},
    optional={
        "controller.k_v": positive,
        "controller.time_headway": positive,
        "vehicle.tau": st.floats(1e-6, 0.5),
        "v2v.rho": st.floats(1.0, 1e6, exclude_min=True),
        "v2v.noise": st.sampled_from(["bits", "expected", "none"]),
    },
).filter(bool)
common_values = st.fixed_dictionaries(
    {"platoon.followers": st.just(5)},
    optional={
        "platoon.initial_speed": st.floats(1e-3, 60.0),
        "platoon.namespace": st.sampled_from(["/platoon", "/a/b_2"]),
        "vehicle.tau": st.lists(st.floats(1e-6, 0.5), min_size=5, max_size=5),
        "controller.k_a": st.floats(0.0, 2.0, allow_subnormal=False),
        "controller.k_p": st.floats(sys.float_info.min, 1e-3),
        "v2v.bit_probabilities": st.lists(st.floats(1e-9, 0.999), min_size=1, max_size=32),
        "leader.profile": st.sampled_from(["sine", "step", "brake", "constant"]),
        "leader.amplitude": st.floats(-5.0, 5.0, allow_subnormal=False),
        "run.seed": st.integers(0, 2**63 - 1),
        "run.hosts": st.sampled_from(["auto", "per_node", 1, 7]),
        "run.spawn": st.booleans(),
        "run.manual_nodes": st.sampled_from([["vehicle_3/vehicle"], ["vehicle_0/leader"], []]),
        "record.directory": st.sampled_from(["", "runs/x", "a b: c", "#1", "true", "12"]),
    },
)


@pytest.mark.slow
@settings(max_examples=3 * settings().max_examples // 2)
@given(common=common_values, own=st.dictionaries(st.integers(1, 5), own_values, max_size=3))
def test_a_written_scenario_reads_back_the_same(common, own):
    scenario = Scenario.from_values(common, own, source="written.yaml")
    assert parse_scenario(format_scenario(scenario), "written.yaml") == scenario


def test_what_is_written_holds_every_parameter_and_no_file():
    text = format_scenario(Scenario())
    left_out = {"leader.file", *(name for name, row in TABLE.items() if row.default == ())}
    for name in TABLE.keys() - left_out:
        assert f"{name.partition('.')[2]}: " in text


def test_every_default_is_within_its_own_range():
    for row in TABLE.values():
        if row.default != ():
            assert row.check(row.default, "table") == row.default
    assert math.isclose(20.0 * math.log10(Scenario().v2v.rho), 13.979, abs_tol=1e-3)


def test_a_former_name_is_still_read_and_not_beside_the_new_one():
    text = document("{platoon: {followers: 3}, run: {by_hand: [vehicle_3/vehicle]}}")
    assert parse_scenario(text, "old.yaml").run.manual_nodes == ("vehicle_3/vehicle",)
    both = document("{run: {by_hand: [vehicle_3/vehicle], manual_nodes: [vehicle_2/vehicle]}}")
    assert "run.by_hand is the former name of run.manual_nodes" in refusal(both)


def test_values_may_be_arrays_and_leave_no_empty_section():
    scenario = Scenario().with_values(
        {"vehicle.tau": np.full(12, 0.25), "vehicle_3.controller.k_v": np.float64(0.7)}
    )
    assert scenario.follower(12).tau == 0.25
    assert scenario.follower(3).gains.k_v == 0.7
    assert scenario.with_values({"controller.k_v": 0.6}).overrides == {}


def test_a_name_that_is_no_text_is_refused():
    with pytest.raises(ScenarioError, match=r"3 is no name of a parameter.*run\.seed"):
        Scenario().with_values({3: 1.0})  # type: ignore[dict-item]


@pytest.mark.parametrize(
    ("name", "value", "period"),
    [("run.step", 0.0005, "0.0005"), ("run.real_time_factor", 20.0, "0.0005")],
)
def test_clocks_that_no_process_keeps_are_refused(name: str, value: float, period: str) -> None:
    values = {"run.duration": 1.0, name: value}
    Scenario.from_values(values)
    with pytest.raises(ScenarioError, match=f"{name} = .* a sample every {period} s of its clock"):
        Scenario.from_values({**values, "run.sync": "wall"})
    Scenario.from_values({**values, "run.sync": "wall", "run.step": 0.02})


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"run.sync": "wall", "run.pause_at": 2.0}, "run.pause_at = 2.0 s must be -1 by clocks"),
        ({"run.restarts": 1}, "run.restarts = 1 must be 0 in lockstep"),
        (
            {"run.restarts": 1, "run.sync": "wall", "run.adjustable": True},
            "run.restarts = 1 must be 0 with run.adjustable",
        ),
        (
            {"run.restarts": 1, "run.sync": "wall", "run.remote_hosts": ("east=1-6",)},
            "run.restarts = 1 must be 0 with run.remote_hosts",
        ),
        ({"v2v.best_effort": True}, "v2v.best_effort = true must be false in lockstep"),
    ],
)
def test_what_belongs_to_one_way_of_keeping_time_is_refused_in_the_other(
    values: dict[str, object], why: str
) -> None:
    with pytest.raises(ScenarioError, match=re.escape(why)):
        Scenario.from_values(values)
