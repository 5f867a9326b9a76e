"""The course of runs on real nodes: timelines, parameters set while they run, collisions."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

from cacc_platoon.analysis import analyse
from cacc_platoon.bags.digest import run_digest
from cacc_platoon.report import metrics_document
from cacc_platoon.runs import events as runs_events
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import simulate
from cacc_platoon.testing import Platoon
from msg_adapters.text import decode_string
from msg_adapters.topics import Graph

PAPER_A = Path(__file__).parents[2] / "config" / "paper_a.yaml"
SMALL = ("platoon.followers=4", "leader.start=1")
TIMELINE = (
    'run.timeline=["2 link_2 v2v.loss=1", "3.5 link_2 v2v.loss=0", '
    '"2.5 vehicle_3 controller.time_headway=1.2", "5 link_4 v2v.latency=0.04"]',
    *("run.duration=8", "v2v.reception=fallback", "v2v.fallback_after=0.3"),
    *("v2v.fallback_blend=0.3", "v2v.fallback_return=0.3"),
    *("vehicle_1.vehicle.limits=constant", "vehicle_1.vehicle.max_jerk=0.2"),
)
CRASH = (
    *("run.duration=40", "leader.profile=brake", "leader.deceleration=8", "vehicle.length=4.5"),
    *("platoon.standstill_distance=2", "vehicle_3.v2v.blackouts=[1, 20]"),
    *("vehicle_1.v2v.reception=fallback", "vehicle_1.v2v.loss=0.5"),
    *("vehicle_1.v2v.fallback_after=0.02", "vehicle_1.v2v.fallback_return=0.02"),
)
PROMPT_CRASH = (
    *("run.duration=40", "leader.profile=brake", "leader.deceleration=9", "vehicle.length=4.5"),
    *("platoon.standstill_distance=0.5", "controller.time_headway=0.3"),
)

Start = Callable[..., Platoon]


def simulated_digest(scenario: Path, *settings: str) -> str:
    one = load_scenario(scenario, settings)
    return run_digest(recording_of(simulate(one)), Graph.of(one))


def events_of(run: Platoon) -> list[tuple[str, int, str, str]]:
    """Return kind, sample, node and text of what events.jsonl tells."""
    lines = (run.folder.path / "events.jsonl").read_text().splitlines()
    return [(e["kind"], e["sample"], e["node"], e["text"]) for e in map(json.loads, lines)]


def events_in(bag: Path) -> list[tuple[int, str]]:
    """Return log time and text of the events in a bag."""
    with Reader(bag) as reader:
        wanted = [one for one in reader.connections if one.topic == "/platoon/events"]
        return [(time, decode_string(data)) for _, time, data in reader.messages(wanted)]


@pytest.mark.parametrize("hosts", [1, "per_node"])
def test_a_timeline_is_carried_out_at_its_samples(platoon: Start, hosts: int | str) -> None:
    run = platoon(*SMALL, *TIMELINE, hosts=hosts)
    result = run.result()
    assert result.exit_code == 0, result.errors
    assert result.digest == simulated_digest(PAPER_A, *SMALL, *TIMELINE)
    told = events_of(run)
    one = load_scenario(PAPER_A, (*SMALL, *TIMELINE))
    shown = runs_events.events_of(simulate(one))
    assert told == [(one.kind, one.sample, one.node, one.text) for one in shown]
    course = metrics_document(analyse(run.folder.path, runs=0))["events"]
    frame = ("start", "end")
    assert [one for one in told if one[0] not in frame] == [
        (one["kind"], one["sample"], one["node"], one["text"]) for one in course
    ]
    receptions = [one[2:] for one in told if one[0] == "reception"]
    states = ("degrading", "fallback", "recovering", "normal")
    assert receptions == [("vehicle_2/vehicle", state) for state in states]
    limits = [one for one in told if one[0] == "limit"]
    assert {text for *_, text in limits} == {"acts", "rests"}
    assert [one for one in told if one[0] not in ("reception", "limit")] == [
        ("start", 0, "supervisor", ""),
        ("change", 200, "vehicle_2/noise_relay", "v2v.loss=1.0"),
        ("change", 250, "vehicle_3/vehicle", "controller.time_headway=1.2"),
        ("change", 350, "vehicle_2/noise_relay", "v2v.loss=0.0"),
        ("change", 500, "vehicle_4/noise_relay", "v2v.latency=0.04"),
        ("end", 800, "supervisor", "finished"),
    ]
    lines = (run.folder.path / "events.jsonl").read_text().splitlines()
    stamps = [sample * 10_000_000 for _, sample, *_ in told]
    assert events_in(run.folder.bag) == list(zip(stamps, lines, strict=True))


def test_what_is_set_while_a_run_goes_on_is_in_its_record(platoon: Start) -> None:
    pace = ("run.adjustable=true", "run.duration=20", "run.real_time_factor=4")
    run = platoon(*SMALL, *pace, hosts=2)
    run.wait_sample(50)
    set_parameter = run.set_parameter
    assert set_parameter("vehicle_2/noise_relay", "v2v.loss", 1.0) == ""
    assert set_parameter("vehicle_3/vehicle", "controller.time_headway", 1.3) == ""
    assert "out of range" in set_parameter("vehicle_2/noise_relay", "v2v.loss", 1.5)
    assert "read-only" in set_parameter("vehicle_2/noise_relay", "v2v.rho", 3.0)
    assert "read-only" in set_parameter("vehicle_3/vehicle", "v2v.loss", 1.0)
    first = run.wait_event("change")
    run.wait_sample(first["sample"] + 100)
    assert set_parameter("vehicle_2/noise_relay", "v2v.loss", 0) == ""
    result = run.result()
    assert result.exit_code == 0, result.errors
    changes = [event for event in events_of(run) if event[0] == "change"]
    told = [(node, text) for _, _, node, text in changes]  # by hosts of their own, in any order
    assert told[-1] == ("vehicle_2/noise_relay", "v2v.loss=0.0")
    assert sorted(told[:-1]) == [
        ("vehicle_2/noise_relay", "v2v.loss=1.0"),
        ("vehicle_3/vehicle", "controller.time_headway=1.3"),
    ]
    record = run.folder.path / "scenario.yaml"
    planned = [(one.sample, one.name) for one in load_scenario(record).changes]
    assert sorted(planned) == sorted((one[1], one[3].partition("=")[0]) for one in changes)
    assert result.digest == simulated_digest(record)
    assert result.digest != simulated_digest(PAPER_A, *SMALL, *pace)
    report = analyse(run.folder.path, runs=0)
    assert report.consistency.largest == 0.0
    assert report.standing.stands
    assert any("parameters change from" in reason for reason in report.verdict.void)


@pytest.mark.parametrize(
    ("crash", "vehicle", "hosts"), [(CRASH, 3, "per_node"), (PROMPT_CRASH, 1, 2)]
)
def test_a_collision_ends_the_run_at_its_sample(
    platoon: Start, crash: tuple[str, ...], vehicle: int, hosts: int | str
) -> None:
    run = platoon(*SMALL, *crash, hosts=hosts)
    result = run.result()
    assert result.exit_code == 0, result.errors
    assert result.digest == simulated_digest(PAPER_A, *SMALL, *crash)
    (_, sample, node, _) = next(event for event in events_of(run) if event[0] == "collision")
    assert node == f"vehicle_{vehicle}/vehicle"
    shown = runs_events.events_of(simulate(load_scenario(PAPER_A, (*SMALL, *crash))))
    assert events_of(run) == [(one.kind, one.sample, one.node, one.text) for one in shown]
    assert result.info
    assert result.info.samples == sample + 1 < 4001
    report = analyse(run.folder.path, runs=0)
    assert report.measured.first_collision == (vehicle, sample * 0.01)
    assert report.headline.startswith("COLLISION, ")
    assert report.standing.stands
    assert report.run.findings == ()
