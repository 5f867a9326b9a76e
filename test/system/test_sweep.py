"""A study on real nodes: the table of the simulation, to the last bit."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import time
from pathlib import Path

from cacc_platoon.cli import main
from cacc_platoon.dds.domain import own_domain
from cacc_platoon.runs.info import EndStatus, RunInfo

PLAN = """
settings: {run.duration: 12.0, platoon.followers: 2, run.hosts: 1}
matrix: {v2v.loss: [0.0, 0.3], leader.profile: [sine, csv]}
criteria: [string_stable, min_gap > 20]
"""


SLOW = (
    "settings: {run.duration: 60.0, platoon.followers: 1, run.real_time_factor: 1.0}\nseeds: [1]\n"
)


def table_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "table.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_rows_on_nodes_are_those_of_the_simulation(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(PLAN)
    plan, study = str(tmp_path / "plan.yaml"), tmp_path / "nodes"
    command = [sys.executable, "-m", "cacc_platoon", "sweep", plan, "-o", str(study)]
    with own_domain() as domain:
        done = subprocess.run(
            [*command, "--backend", "run", "--json"],
            env=os.environ | {"ROS_DOMAIN_ID": f"{domain}"},
            capture_output=True,
            text=True,
            timeout=180.0,
            check=False,
        )
    assert (done.returncode, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    assert (found["evaluated"], found["failed"]) == (4, 2)
    assert main(["sweep", plan, "-o", str(tmp_path / "arrays")]) == 0
    on_nodes, in_arrays = table_of(study), table_of(tmp_path / "arrays")
    assert [row["row"] for row in on_nodes if row["failed"]] == ["1", "3"]
    assert "leader.file" in on_nodes[1]["failed"]
    for one, other in zip(on_nodes[::2], in_arrays[::2], strict=True):
        assert one == other
    info = RunInfo.read(study / "runs" / "0")
    assert info is not None
    assert info.status is EndStatus.FINISHED


def test_a_run_ends_with_its_study(tmp_path: Path) -> None:
    (tmp_path / "plan.yaml").write_text(SLOW)
    run = tmp_path / "study" / "runs" / "0"
    command = [sys.executable, "-m", "cacc_platoon", "sweep", str(tmp_path / "plan.yaml")]
    with own_domain() as domain:
        process = subprocess.Popen(
            [*command, "--backend", "run", "-o", str(tmp_path / "study")],
            env=os.environ | {"ROS_DOMAIN_ID": f"{domain}"},
            stderr=subprocess.DEVNULL,
        )
        assert became(run, EndStatus.RUNNING)
        process.kill()
        process.wait()
        assert became(run, EndStatus.INTERRUPTED)


def became(run: Path, status: EndStatus) -> bool:
    """Wait until a run says that it is in a state; return whether it does in time."""
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        info = RunInfo.read(run) if run.is_dir() else None
        if info and info.status is status:
            return True
    return False
