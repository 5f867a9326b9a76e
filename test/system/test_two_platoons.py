"""Two platoons of one name: the first goes on to its digest, whatever the second one does."""

import os
import random
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from cacc_platoon.bags.digest import run_digest
from cacc_platoon.runs.info import RunInfo
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import simulate
from cacc_platoon.testing import Platoon
from msg_adapters.topics import Graph

SETTINGS = ("run.duration=20", "platoon.followers=3", "run.real_time_factor=10")
"""Two seconds of wall time."""
PATIENCE = 60.0
PLATOON = "import runpy; runpy.run_module('cacc_platoon', run_name='__main__')"
UNLOCKED = (
    "from cacc_platoon.dds.platoon_lock import PlatoonLock; "
    f"PlatoonLock.taken_by = lambda lock: ''; {PLATOON}"
)

Start = Callable[..., Platoon]
Process = subprocess.Popen[str]


def digest(scenario: Scenario) -> str:
    """Return the digest that nothing but the scenario decides."""
    return run_digest(recording_of(simulate(scenario)), Graph.of(scenario))


def second(run: Platoon, folder: Path, *, elsewhere: bool = False) -> Process:
    """Start a platoon like another; `elsewhere`, as on another machine, it has only the graph."""
    folder.mkdir()
    return subprocess.Popen(
        [
            *(sys.executable, "-c", UNLOCKED if elsewhere else PLATOON),
            *("run", str(run.scenario_file)),
            *("-o", str(folder / "run"), "--no-report"),
        ],
        env=run.environment(),
        stderr=subprocess.PIPE,
        text=True,
    )


def given_way(process: Process, folder: Path) -> str:
    """Wait for the end of a platoon that gives way, and return its one line."""
    _, errors = process.communicate(timeout=PATIENCE)
    lines = [line for line in errors.splitlines() if line.startswith("platoon: ")]
    assert process.returncode == 1, errors
    assert "Traceback" not in errors
    assert len(lines) == 2, errors
    assert "Another platoon" in lines[0]
    info = RunInfo.read(folder / "run")
    assert info is not None
    assert (info.status, info.samples) == ("failed", 0)
    return lines[0]


def wait(seconds: float) -> None:
    """Let some time pass, which is what is tried here."""
    threading.Event().wait(seconds)


@pytest.mark.parametrize("elsewhere", [False, True])
def test_the_first_finishes_with_its_digest(
    platoon: Start, tmp_path: Path, *, elsewhere: bool
) -> None:
    run = platoon(*SETTINGS, "run.duration=40", "run.real_time_factor=4", hosts=2)
    run.wait_state("running")
    process = second(run, tmp_path / "second", elsewhere=elsewhere)
    line = given_way(process, tmp_path / "second")
    assert ("of this machine runs it" in line) != elsewhere
    assert "/platoon" in line
    result = run.result()
    assert (result.status, result.digest) == ("finished", digest(run.scenario)), result.message


@pytest.mark.parametrize("seed", range(int(os.environ.get("CACC_PLATOON_TRIES", "2"))))
def test_one_of_two_finishes_whenever_the_second_starts(
    platoon: Start, tmp_path: Path, seed: int
) -> None:
    """The first try starts both at once; the first to hold the name is the one that finishes."""
    run = platoon(*SETTINGS, hosts=2)
    wait(random.Random(seed).uniform(0.0, 3.0) if seed else 0.0)
    process = second(run, tmp_path / "second")
    _, errors = process.communicate(timeout=PATIENCE)
    result, other = run.result(), RunInfo.read(tmp_path / "second" / "run")
    assert other is not None
    ends = {result.status: result.digest, other.status: other.digest}
    assert {"finished", "failed"} == ends.keys(), (result.errors, errors)
    assert ends["finished"] == digest(run.scenario)
    loser = result.errors if result.status == "failed" else errors
    assert "Another platoon" in loser
