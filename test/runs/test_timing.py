"""Bags of runs by clocks: what is not known of the samples is named and never taken for well."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cacc_platoon.analysis import analyse
from cacc_platoon.analysis.clocks import clock_use
from cacc_platoon.analysis.standing import DataState
from cacc_platoon.bags.digest import run_digest
from cacc_platoon.runs.recorded_run import read_run
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.simulation import simulate
from cacc_platoon.simulation.timing import Timing
from msg_adapters.topics import Graph, VehicleTopics

TIMING = VehicleTopics("/platoon", 2).timing
DAMAGED = f"{TIMING.name}: lacks samples, or has some twice or damaged: poses count as new there"


@pytest.fixture
def clocked(bags: Any) -> Any:
    return bags.scenario({"run.sync": "wall", "run.real_time_factor": 2.0})


def with_timing(recording: Any, **values: Any) -> Any:
    """Return a recording in which rows of the second follower's timing are others."""
    kind, messages, delivered = recording[TIMING.name]
    rows = messages.copy()
    fields = TIMING.codec._fields(rows)
    for name, (sample, value) in values.items():
        fields[name][sample] = value
    rows = fields.view(np.uint8).reshape(messages.shape)
    return {**recording, TIMING.name: type(recording[TIMING.name])(kind, rows, delivered)}


@pytest.mark.slow
@pytest.mark.parametrize(
    "values",
    [
        {"x": (40, 0.5)},
        {"x": (40, 41.0)},
        {"x": (40, -1.0)},
        {"y": (40, np.nan)},
        {"y": (40, np.inf)},
        {"y": (40, 1e300)},
        {"nanosec": (40, 390_000_000)},
        {"nanosec": (40, 400_000_001)},
    ],
)
def test_a_sample_whose_timing_is_damaged_is_unknown(
    bags: Any, tmp_path: Path, clocked: Any, values: Any
) -> None:
    recording = with_timing(bags.record(clocked), **values)
    run = read_run(bags.bag(tmp_path / "bag", clocked, recording))
    assert DAMAGED in run.findings
    unknown = [one.unknown for one in clock_use(run.trajectory)]
    assert unknown == [index == 1 for index in range(len(unknown))]


def test_a_bag_without_timing_proves_nothing(bags: Any, tmp_path: Path, clocked: Any) -> None:
    recording = {k: v for k, v in bags.record(clocked).items() if k != TIMING.name}
    report = analyse(bags.bag(tmp_path / "bag", clocked, recording))
    assert f"{TIMING.name}: is not in the bag: poses count as new" in report.run.findings
    assert report.standing.state is not DataState.INTACT
    assert any("nothing tells when they came" in reason for reason in report.verdict.void)
    assert not report.proven


def test_timing_is_part_of_the_digest(clocked: Any) -> None:
    run, graph = simulate(clocked), Graph.of(clocked)
    late = np.zeros_like(run.position[:, 1:])
    late[40, 1] = 1.5
    other = dataclasses.replace(run, timing=Timing(np.zeros(late.shape, np.int64), late))
    digests = {run_digest(recording_of(one), graph) for one in (run, other)}
    assert len(digests) == 2


def test_lateness_is_told_in_seconds_of_the_clock(clocked: Any) -> None:
    run = simulate(clocked)
    late = np.zeros_like(run.position[:, 1:])
    late[40, 1] = 3.0
    timing = Timing((late > 2.0).astype(np.int64), late)
    used = clock_use(dataclasses.replace(run, timing=timing))
    step = clocked.run.step
    assert [one.overruns for one in used][:2] == [0, 1]
    assert (used[1].late_max, used[1].age_max) == pytest.approx((3.0 * step / 2.0, step))
