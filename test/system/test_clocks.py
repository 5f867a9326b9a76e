"""Vehicles by clocks of their own on real nodes: whoever stops, the others go on."""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from cacc_platoon.analysis import analyse
from cacc_platoon.analysis.analyse import Report
from cacc_platoon.analysis.standing import DataState
from cacc_platoon.model import ReceptionState
from cacc_platoon.runs.events import events_of
from cacc_platoon.scenario.run_event import RunEvent
from cacc_platoon.testing import Platoon
from msg_adapters.topics import VehicleTopics

WALL = (
    *("run.sync=wall", "platoon.followers=4", "run.duration=6", "leader.start=1"),
    *("leader.angular_frequency=1", "v2v.reception=fallback", "v2v.fallback_after=0.3"),
)

Start = Callable[..., Platoon]


def judged(run: Platoon) -> Report:
    """Return the report of a run in which every state is what was recorded makes of it."""
    report = analyse(run.folder.path)
    assert report.consistency.largest == 0.0
    assert report.recomputed.links.largest == 0.0
    return report


@pytest.mark.parametrize(
    ("hosts", "more"),
    [(2, ()), ("per_node", ("run.phases=random", "v2v.loss=0.2", "v2v.latency=0.03"))],
)
def test_a_run_by_clocks_is_worked_out_and_replayed_from_its_bag(
    platoon: Start, replay: Callable[..., Any], hosts: int | str, more: tuple[str, ...]
) -> None:
    run = platoon(*WALL, *more, hosts=hosts, report=True)
    result = run.result()
    assert result.exit_code == 0, result.errors
    assert result.info
    assert (result.info.wall_time or 0.0) >= 6.0
    assert "  by clocks, so not bit for bit the same again" in result.output
    report = judged(run)
    assert report.standing.state is DataState.INTACT
    assert report.consistency.steps == 4 * 600
    metrics = json.loads((run.folder.path / "metrics.json").read_text())
    assert [one["follower"] for one in metrics["clocks"]] == [1, 2, 3, 4]
    assert report.run.trajectory.timing is not None
    overruns = report.run.trajectory.timing.overrun.sum(axis=0)
    assert [one["overruns"] for one in metrics["clocks"]] == overruns.tolist()
    assert metrics["distance"]["largest"] == report.distance.largest
    for node in ("vehicle", "noise_relay"):
        answer = replay(run, 3, node)
        assert answer["identical"], answer


def test_a_frozen_vehicle_keeps_nobody_waiting_and_comes_back(platoon: Start) -> None:
    run = platoon(*WALL, "run.duration=8", hosts="per_node")
    run.wait_sample(200)
    run.freeze("vehicle_2/vehicle", 1.5)
    result = run.result()
    assert (result.exit_code, result.status) == (0, "finished"), result.errors
    report = judged(run)
    trajectory = report.run.trajectory
    assert trajectory.timing is not None
    overruns = trajectory.timing.overrun.sum(axis=0)
    assert overruns[1] >= 100
    for others in (0, 2, 3):
        assert overruns[others] < overruns[1]
    assert trajectory.timing.age[:, 2].max() >= 100
    behind = next(one for one in report.measured.fallback if one.follower == 3)
    assert behind.turns >= 1
    assert behind.shares[ReceptionState.FALLBACK] > 0.0
    assert report.measured.first_collision is None
    lines = (run.folder.path / "events.jsonl").read_text().splitlines()
    told = [json.loads(line) for line in lines]
    events = [RunEvent(e["kind"], e["sample"], e["node"], e["text"]) for e in told]
    assert events == events_of(trajectory)
    later = [(e.kind, e.node, e.text.split()[-1]) for e in events[1:-1] if e.sample >= 200]
    assert ("late", "vehicle_2/vehicle", "periods") in later
    assert ("reception", "vehicle_3/vehicle", "fallback") in later
    assert any("kept the command before" in reason for reason in report.verdict.void)


def test_a_killed_vehicle_is_named_and_the_others_go_on_to_the_end(platoon: Start) -> None:
    run = platoon(*WALL, hosts="per_node")
    run.wait_sample(200)
    pid = run.pid("vehicle_2/vehicle")
    run.kill("vehicle_2/vehicle", signal.SIGKILL)
    lost = run.wait_event("fault")
    assert f"process {pid}: vehicle_2/vehicle" in lost["text"].replace("host_3/recorder, ", "")
    result = run.result()
    assert (result.exit_code, result.status) == (1, "failed")
    assert f"(process {pid}:" in result.message
    report = judged(run)
    assert report.standing.state is DataState.FAILED
    there = np.isfinite(report.run.trajectory.position)
    assert there[:, [0, 1, 3, 4]].all()
    assert 100 <= there[:, 2].sum() < 601  # what was not flushed is gone with the process
    behind = next(one for one in report.measured.fallback if one.follower == 3)
    assert behind.shares[ReceptionState.FALLBACK] > 0.0


def test_a_packet_that_nobody_can_have_sent_ends_the_run(platoon: Start) -> None:
    run = platoon(*WALL, "run.duration=20", hosts=2)
    run.wait_sample(100)
    run.publisher(VehicleTopics("/platoon", 2).received)(10**17, 0.1)
    result = run.result()
    assert (result.exit_code, result.status) == (1, "failed")
    seen = "/platoon/vehicle_2/v2v/accel has 2 publishers: /observer"  # sooner, on a busy machine
    assert "comes from another publisher" in result.message or seen in result.message


def test_every_vehicle_says_on_diagnostics_how_it_does(platoon: Start) -> None:
    run = platoon(*WALL, hosts=2)
    told: dict[str, list[DiagnosticStatus]] = {}

    def receive(message: DiagnosticArray) -> None:
        for status in message.status:
            told.setdefault(status.name, []).append(status)

    run.subscribe(DiagnosticArray, "/diagnostics", receive)
    run.wait(lambda: len(told) == 4 and min(map(len, told.values())) >= 3, 60.0, "diagnostics")
    assert sorted(told) == [f"/platoon/vehicle_{index}: clock" for index in range(1, 5)]
    samples = [{v.key: v.value for v in one.values}["samples"] for one in told[min(told)]]
    assert max(map(int, samples)) > 10
    assert run.result().exit_code == 0


def test_nodes_that_are_started_manually_begin_together_with_the_others(platoon: Start) -> None:
    manual = {"vehicle_2/vehicle": (), "vehicle_2/noise_relay": ()}
    run = platoon(*WALL, "platoon.followers=2", hosts=1, manual_nodes=manual)
    for node in manual:
        run.start(node)
    result = run.result()
    assert result.exit_code == 0, result.errors
    assert judged(run).standing.state is DataState.INTACT


AHEAD = """
import sys, time
real = time.time_ns
time.time_ns = lambda: real() + 30_000_000
from cacc_platoon.supervision.entry_points import vehicle
sys.exit(vehicle())
"""


def test_a_clock_that_is_ahead_is_measured_and_told(platoon: Start) -> None:
    ahead = {"vehicle_2/vehicle": [sys.executable, "-c", AHEAD]}
    lossy = "v2v.best_effort=true"
    run = platoon(*WALL, lossy, "run.duration=4", hosts=2, manual_nodes=ahead, report=True)
    result = run.result()
    assert result.exit_code == 0, result.errors
    assert result.info is not None
    offsets = dict(result.info.clock_offsets)
    offset = offsets.pop("vehicle_2_vehicle")
    assert abs(offset.offset - 0.03) <= offset.uncertainty
    assert {"0", "1"} <= set(offsets)
    for other in offsets.values():
        assert abs(other.offset) <= other.uncertainty
    told = "platoon: warning: host vehicle_2_vehicle: its clock is "
    warned = [line for line in result.errors.splitlines() if line.startswith(told)]
    assert len(warned) == (offset.least > 0.005)
    assert "(host vehicle_2_vehicle, to within" in result.output
    judged(run)


def test_nodes_that_are_started_again_go_on_from_what_was_recorded(
    platoon: Start, replay: Callable[..., Any]
) -> None:
    gentle = "leader.amplitude=0.1"  # three that stand still could collide otherwise
    again = ("run.duration=12", "run.restarts=1", gentle)
    run = platoon(*WALL, *again, hosts="per_node", report=True)
    killed = ["vehicle_2/vehicle", "vehicle_3/noise_relay", "vehicle_0/leader"]
    run.wait_sample(150)
    for node in killed:
        run.kill(node, signal.SIGKILL)
    result = run.result()
    assert (result.exit_code, result.status) == (0, "finished"), result.errors
    assert result.errors.count("was killed by SIGKILL, and is started again") == 3
    report = judged(run)
    assert report.standing.state is DataState.INTACT
    assert report.consistency.steps == 4 * 1200
    assert report.measured.first_collision is None
    lines = (run.folder.path / "events.jsonl").read_text().splitlines()
    told = [json.loads(line) for line in lines]
    for kind in ("fault", "restart"):
        texts = [one["text"] for one in told if one["kind"] == kind]
        assert all(sum(node in text for text in texts) == 1 for node in killed), texts
    assert len({json.dumps(one) for one in told}) == len(told)
    assert not (run.folder.path / "ended_parts").exists()
    timing = report.run.trajectory.timing
    assert timing is not None
    assert timing.overrun[:, 1].sum() > 20
    assert replay(run, 2, "vehicle")["identical"]


def test_a_node_that_ends_more_often_than_it_is_started_again_is_lost(platoon: Start) -> None:
    run = platoon(*WALL, "run.restarts=1", hosts="per_node")
    run.wait_sample(50)
    first = run.pid("vehicle_3/vehicle")
    run.kill("vehicle_3/vehicle", signal.SIGKILL)
    run.wait(lambda: run.pid("vehicle_3/vehicle") != first, 20.0, "the next process")
    run.kill("vehicle_3/vehicle", signal.SIGKILL)
    result = run.result()
    assert (result.exit_code, result.status) == (1, "failed"), result.errors
    assert "vehicle_3/vehicle) was killed by SIGKILL" in result.message
    kinds = [event["kind"] for event in run.events]
    assert (kinds.count("fault"), kinds.count("restart")) == (2, 1)
