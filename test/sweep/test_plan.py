"""Plans: what varies, in which order, and what is refused before anything is evaluated."""

from pathlib import Path
from typing import Any

import pytest

from cacc_platoon.design import Requirements, paper_design, recommend
from cacc_platoon.errors import UserError
from cacc_platoon.scenario import Scenario
from cacc_platoon.sweep.plan import load_plan, parse_plan
from cacc_platoon.sweep.reading import MOST_ROWS

ROOT = Path(__file__).parents[2]
HEADWAY, RHO = "controller.time_headway", "v2v.rho"


def plan_of(**document):
    return parse_plan(document, "mine", ROOT / "config")


def settings_of(plan):
    return [point.settings for point in plan.points()]


def test_the_last_axis_varies_fastest_and_seeds_last_of_all():
    plan = plan_of(matrix={HEADWAY: [0.9, 1.0], RHO: [2, 5]}, seeds=[7, 8])
    assert plan.rows == 8
    assert plan.labels == (HEADWAY, RHO, "run.seed")
    found = [(one[HEADWAY], one[RHO], one["run.seed"]) for one in settings_of(plan)]
    assert found == sorted(found)
    assert [point.row for point in plan.points()] == [*range(8)]


def test_ranges_are_what_people_would_write():
    plan = plan_of(matrix={HEADWAY: {"from": 0.6, "to": 1.2, "count": 13}})
    assert [one[HEADWAY] for one in settings_of(plan)][:4] == [0.6, 0.65, 0.7, 0.75]
    decades = {"from": 1e-3, "to": 10, "count": 5, "scale": "log"}
    plan = plan_of(matrix={"controller.k_p": decades})
    assert [one["controller.k_p"] for one in settings_of(plan)] == [1e-3, 1e-2, 0.1, 1.0, 10.0]
    plan = plan_of(matrix={"platoon.followers": {"from": 2, "to": 8, "count": 4}})
    assert [one["platoon.followers"] for one in settings_of(plan)] == [2, 4, 6, 8]
    plan = plan_of(seeds={"from": 5, "count": 3})
    assert [one["run.seed"] for one in settings_of(plan)] == [5, 6, 7]


def test_channels_designs_and_single_vehicles_vary_too(tmp_path):
    (tmp_path / "own.yaml").write_text("/**: {ros__parameters: {controller: {k_a: 0.25}}}\n")
    document = {
        "designs": {"mine": "own.yaml", "given": {HEADWAY: 1.4}},
        "matrix": {"channel": ["ideal", "cam_lossy"], "vehicle_3.vehicle.tau": [0.1, 0.2]},
    }
    plan = parse_plan(document, "mine", tmp_path)
    assert plan.rows == 8
    first, *_, last = plan.points()
    assert first.labels == {"design": "mine", "channel": "ideal", "vehicle_3.vehicle.tau": 0.1}
    assert plan.scenario.with_values(first.settings).follower(2).gains.k_a == 0.25
    made = plan.scenario.with_values(last.settings)
    assert made.follower(2).gains.time_headway == 1.4
    assert made.follower(3).tau == 0.2
    assert made.follower(3).v2v.loss == 0.1


def test_recommended_designs_are_those_of_each_row():
    plan = plan_of(designs=["paper", "shortest"], matrix={RHO: [5.0, 20.0]})
    made = [point.of(plan.scenario).follower(1).gains for point in plan.points()]
    assert made[:2] == [paper_design(rho, 0.5) for rho in (5.0, 20.0)]
    assert made[2] == recommend(5.0, 0.5, Requirements(hold=True))["shortest"].gains
    assert made[3].time_headway < made[2].time_headway < made[0].time_headway


def test_a_list_can_be_a_value():
    plan = plan_of(matrix={"v2v.blackouts": [[], [10.0, 20.0]]})
    made = [plan.scenario.with_values(one) for one in settings_of(plan)]
    assert [tuple(one.follower(1).v2v.blackouts) for one in made] == [(), (10.0, 20.0)]


@pytest.mark.parametrize("method", ["latin_hypercube", "sobol"])
def test_random_places_fill_their_box_and_come_again(method):
    box = {HEADWAY: [0.8, 1.2], "v2v.loss": [0.0, 0.5]}
    drawn = {"method": method, "count": 16, "seed": 3, "over": box}
    plan = plan_of(random=drawn)
    assert plan.labels == ("sample", HEADWAY, "v2v.loss")
    for name, (low, high) in box.items():
        found = sorted(one[name] for one in settings_of(plan))
        assert low <= found[0] < found[-1] <= high
        shares = [int((value - low) / (high - low) * 16) for value in found]
        assert len(set(shares)) >= 15  # one in each sixteenth, but for rounding at its ends
    assert settings_of(plan) == settings_of(plan_of(random=drawn))
    assert settings_of(plan) != settings_of(plan_of(random={**drawn, "seed": 4}))


def test_values_of_the_command_line_replace_those_of_the_plan():
    document = {"settings": {"run.duration": 30.0}, "matrix": {HEADWAY: [0.9, 1.0]}}
    plan = parse_plan(document, "mine", ROOT, ["run.duration=20", "platoon.followers=3"])
    assert (plan.scenario.run.duration, plan.scenario.platoon.followers) == (20.0, 3)


def test_the_fingerprint_is_of_all_that_rows_depend_on():
    base: dict[str, Any] = {"matrix": {HEADWAY: [0.9, 1.0]}, "criteria": ["min_gap > 1"]}
    others: list[dict[str, Any]] = [
        {"matrix": {HEADWAY: [0.9, 1.1]}},
        {"settings": {"run.duration": 30.0}},
        {"settings": {"vehicle_2.controller.k_v": 0.7}},
        {"criteria": ["min_gap > 2"]},
        {"columns": ["min_gap"]},
        {"seeds": [1]},
    ]
    prints = [plan_of(**{**base, **other}).fingerprint for other in ({}, *others)]
    assert len(set(prints)) == len(prints)
    assert plan_of(**base).fingerprint == prints[0]


def test_the_fingerprint_is_of_code_of_ones_own_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    prints = []
    for text in ("x = 1", "x = 2"):
        (tmp_path / "own_law_of_a_plan.py").write_text(text)
        for name in ("own_law_of_a_plan:Law", ""):
            plan = plan_of(matrix={"controller.law": [name, "numpy:array"]})
            prints.append(plan.fingerprint)
    assert len(set(prints)) == 3


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ({}, "nothing varies"),
        ({"matrix": {}}, "nothing varies"),
        ({"matrix": {HEADWAY: []}}, "is no list of values"),
        ({"matrix": {HEADWAY: 0.9}}, "is no list of values"),
        ({"matrix": [HEADWAY]}, "is no group of names and values"),
        ({"matrx": {HEADWAY: [1.0]}}, "matrx is none of format, scenario"),
        ({"matrix": {"controller.headway": [1.0]}}, "controller.headway is no parameter"),
        ({"matrix": {HEADWAY: [0.9, -1.0]}}, r"time_headway = -1.0 s must be > 0"),
        ({"matrix": {RHO: [5, "five"]}}, "five"),
        ({"matrix": {HEADWAY: [0.9, 0.9]}}, "has a value twice"),
        ({"matrix": {HEADWAY: {"from": 1, "to": 2}}}, "count = None must be a whole number"),
        ({"matrix": {HEADWAY: {"from": 1, "to": 2, "count": 1}}}, "whole number >= 2"),
        ({"matrix": {HEADWAY: {"from": 1, "to": "x", "count": 3}}}, "must be a finite number"),
        ({"matrix": {HEADWAY: {"from": 1, "to": 2, "step": 3}}}, "step is none of from, to"),
        (
            {"matrix": {HEADWAY: {"from": 0, "to": 2, "count": 3, "scale": "log"}}},
            "a log scale has no place for 0",
        ),
        ({"matrix": {HEADWAY: {"from": 1, "to": 2, "count": 10**9}}}, "which no table holds"),
        (
            {
                "matrix": {HEADWAY: {"from": 1, "to": 2, "count": 10**5}},
                "seeds": {"from": 1, "count": 10**4},
            },
            f"has 1000000000 rows, more than {MOST_ROWS}",
        ),
        ({"matrix": {"channel": ["idle"]}}, "idle is no channel. Take"),
        ({"seeds": [1, 1]}, "has a value twice"),
        ({"seeds": {"from": 1, "count": 0}}, "must be a whole number >= 1"),
        ({"designs": {"mine": {"controller.k": 1.0}}}, "controller.k is no parameter"),
        ({"designs": {"mine": "nowhere.yaml"}}, "nowhere.yaml"),
        ({"designs": ["best"]}, "best is none of the recommended ones, paper"),
        ({"designs": {"a": {HEADWAY: 1.0}}, "matrix": {HEADWAY: [1.0]}}, "varies twice"),
        ({"random": {"count": 4}}, "over names no parameter"),
        ({"random": {"count": 4, "over": {HEADWAY: [1.0, 1.0]}}}, "is empty"),
        ({"random": {"count": 4, "over": {HEADWAY: 1.0}}}, "is no interval"),
        ({"random": {"count": 4, "over": {HEADWAY: [-1.0, 1.0]}}}, "must be > 0"),
        ({"matrix": {HEADWAY: [1, 1.0]}}, "has a value twice"),
        ({"matrix": {"channel": ["cam", "cam"]}}, "has a value twice"),
        ({"designs": ["paper", "paper"]}, "has a value twice"),
        (
            {
                "designs": {"x": {"controller.k_v": 0.7}, "y": {HEADWAY: 1.3}},
                "matrix": {HEADWAY: [0.9, 1.0]},
            },
            "time_headway varies twice",
        ),
        (
            {"matrix": {"channel": ["attacked"], "v2v.false_data": [[], ["1 2 factor=2"]]}},
            "v2v.false_data varies twice",
        ),
        (
            {"settings": {HEADWAY: 1.0}, "matrix": {HEADWAY: [0.9, 1.0]}},
            "varies, and is set to 1.0 for all rows",
        ),
        ({"random": {"method": ["sobol"], "count": 4, "over": {}}}, "is no text"),
        ({"random": {"method": "halton", "count": 4, "over": {}}}, "must be one of"),
        (
            {"random": {"method": "sobol", "count": 5, "over": {HEADWAY: [0.9, 1.0]}}},
            "2, 4, 8",
        ),
        ({"seeds": [1], "criteria": "min_gap > 1"}, "criteria is no list"),
        ({"seeds": [1], "criteria": ["min_gap > much"]}, "much is no number"),
        ({"seeds": [1], "columns": ["1 + 1"]}, "is no name of a number"),
        ({"seeds": [1], "format": 2}, "format 2 of a plan is newer than 1"),
        ({"seeds": [1], "scenario": 3}, "is no text"),
        ({"seeds": [1], "settings": {"run.duration": -1.0}}, "run.duration"),
    ],
)
def test_a_plan_with_a_mistake_is_one_line(document, words):
    with pytest.raises(UserError, match=words) as told:
        plan_of(**document)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("text", ["", "- 1\n", "a: [\n", "seeds: [1]\nseeds: [2]\n"])
def test_a_file_that_is_no_plan_is_one_line(tmp_path, text):
    (tmp_path / "plan.yaml").write_text(text)
    with pytest.raises(UserError) as told:
        load_plan(tmp_path / "plan.yaml")
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("path", sorted((ROOT / "config" / "plans").glob("*.yaml")), ids=str)
def test_ready_made_plans_can_be_read(path):
    plan = load_plan(path)
    assert 1 < plan.rows <= 2000
    first = next(plan.points())
    assert isinstance(first.of(plan.scenario), Scenario)
