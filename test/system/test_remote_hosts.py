"""Hosts that others start, or the supervisor through a command, on the machine of the tests."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from cacc_platoon.bags.digest import run_digest
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import simulate
from cacc_platoon.testing import Platoon
from msg_adapters.topics import Graph

Start = Callable[..., Platoon]

PATIENCE = 60.0
THREE = ("platoon.followers=3", "run.duration=2", "run.hosts=1", "run.remote_hosts=[east=2-3]")
PATHS = {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}


def host(platoon: Platoon, *words: str, name: str = "east") -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "cacc_platoon", "host", name, *words],
        env=platoon.environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def simulated(scenario: Scenario) -> str:
    return run_digest(recording_of(simulate(scenario)), Graph.of(scenario))


def test_a_host_is_started_through_a_command(platoon: Start, tmp_path: Path) -> None:
    (there := tmp_path / "no shell; here").mkdir()
    command = f"run.host_commands=['east=env -C \"{there}\"']"
    run = platoon(*THREE, command, environment=PATHS)
    result = run.result()
    assert result.status == "finished", result
    assert result.digest == simulated(run.scenario)
    log = (result.folder.logs / "host_east.log").read_text()
    assert "waits for a supervisor of /platoon" in log
    assert "the supervisor has what was recorded" in log
    assert list(there.rglob("host_*")) == []
    assert result.info is not None
    assert all(host.machine and not host.part for host in result.info.hosts)


def test_a_host_that_is_started_by_hand_records_where_the_supervisor_can_read(
    platoon: Start, tmp_path: Path
) -> None:
    parts = tmp_path / "parts"
    run = platoon(*THREE, f"record.parts={parts}")
    east = host(run, "--vehicles", "2-3", "--part", str(parts))
    result = run.result()
    _, said = east.communicate(timeout=PATIENCE)
    assert (result.status, east.returncode) == ("finished", 0), (result, said)
    assert result.digest == simulated(run.scenario)
    assert f"what was recorded is in {parts}/host_east" in said
    assert (parts / "host_east" / "topics.json").is_file()


def test_a_host_that_does_not_come_is_named(platoon: Start) -> None:
    run = platoon(*THREE, "run.start_timeout=2")
    north = host(run, name="north")
    _, said = north.communicate(timeout=PATIENCE)
    assert north.returncode == 2
    assert "has no host north, it waits for: host east (vehicles 2-3)" in said.splitlines()[-1]
    result = run.result()
    assert result.exit_code == 1
    assert "have not appeared: " in result.message
    assert "host east (vehicles 2-3). Start what is missing" in result.message


def test_a_host_that_was_started_for_other_vehicles_ends_the_run(platoon: Start) -> None:
    run = platoon(*THREE)
    east = host(run, "--vehicles", "1-2")
    result = run.result()
    east.communicate(timeout=PATIENCE)
    assert (result.exit_code, east.returncode) == (1, 1)
    assert "host east was started for the vehicles 1-2" in result.message


def test_a_command_that_fails_ends_the_run_with_its_last_words(platoon: Start) -> None:
    result = platoon(*THREE, "run.host_commands=['east=env /none/ssh']").result()
    assert result.exit_code == 1
    assert "host east (process " in result.message
    assert "ended with exit code 127: " in result.message
    assert "/none/ssh" in result.message


def test_a_host_does_not_outlive_a_supervisor_that_is_killed(platoon: Start) -> None:
    command = "run.host_commands=[east=env]"
    run = platoon(*THREE[:1], "run.duration=600", *THREE[2:], command, environment=PATHS)
    run.wait_sample(10)
    assert len({run.pid(f"vehicle_{i}/vehicle") for i in (1, 2, 3)}) == 2
    run.kill("supervisor")
    run.wait_gone()
