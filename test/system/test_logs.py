"""What a run says of itself: a log for each process in its folder, and all of it when asked for."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from cacc_platoon.dds.domain import own_domain
from cacc_platoon.testing import Platoon

PAPER_A = Path(__file__).parents[2] / "config" / "paper_a.yaml"
SMALL = ("run.duration=1", "platoon.followers=3", "run.hosts=2")

Start = Callable[..., Platoon]

pytestmark = pytest.mark.usefixtures("nothing_left")


def run(folder: Path, *flags: str, settings: tuple[str, ...] = SMALL) -> str:
    """Run the command and return what it printed on standard error."""
    command = [sys.executable, "-m", "cacc_platoon", "run", str(PAPER_A), "-o", str(folder)]
    command += [*flags, "--no-report", *(f"--set={setting}" for setting in settings)]
    with own_domain() as domain:
        environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=120, check=False
        )
    return done.stderr


def test_every_process_has_a_log_in_the_run_folder(tmp_path: Path) -> None:
    errors = run(tmp_path / "run")
    logs = tmp_path / "run" / "logs"
    assert {file.name for file in logs.iterdir()} == {
        "supervisor.log",
        "host_0.log",
        "host_1.log",
    }
    supervisor = (logs / "supervisor.log").read_text()
    for message in ("looking around", "starting nodes", "connecting nodes", "running", "finished"):
        assert f" supervisor: {message}" in supervisor or f": {message}\n" in supervisor
    for message in ("host 0: up", "host 1: matched"):
        assert message in supervisor
    assert "host 0: closed" in supervisor or "ended with exit code 0" in supervisor
    for name in ("host_0", "host_1"):
        text = (logs / f"{name}.log").read_text()
        assert f" {name}: " in text
        for message in ("matching", "matched", "running", "finished", "closed"):
            assert f": {message}\n" in text
        assert len(text.splitlines()) < 12, "nothing is logged for every sample"
        assert text not in errors


def test_all_of_it_is_shown_when_asked_for(tmp_path: Path) -> None:
    errors = run(tmp_path / "run", "-v")
    for who in ("supervisor", "host_0", "host_1"):
        log = (tmp_path / "run" / "logs" / f"{who}.log").read_text()
        assert set(log.splitlines()) <= set(errors.splitlines())


def test_a_failure_is_in_the_log_too(tmp_path: Path) -> None:
    settings = (*SMALL, "run.manual_nodes=[vehicle_2/vehicle]", "run.start_timeout=2")
    errors = run(tmp_path / "run", settings=settings)
    (message,) = re.findall(r"^platoon: (failed: for 2 s nothing has come, .*)$", errors, re.M)
    assert "vehicle_2/vehicle" in message
    log = (tmp_path / "run" / "logs" / "supervisor.log").read_text()
    assert f": {message}\n" in log


def test_a_manually_started_node_logs_as_ros_nodes_do(platoon: Start, tmp_path: Path) -> None:
    logs = tmp_path / "ros"
    manual = "run.manual_nodes=[vehicle_2/vehicle]"
    run = platoon(*SMALL, manual, environment={"ROS_LOG_DIR": str(logs)})
    pid = run.start("vehicle_2/vehicle")
    assert run.result().exit_code == 0
    (file,) = logs.glob(f"*_{pid}_*.log")
    messages = re.findall(r"\[platoon\.vehicle_2\.vehicle\]: (.*)", file.read_text())
    assert messages[1] == "waiting for the supervisor"
    host = "host vehicle_2_vehicle"
    assert messages[0] == f"{host}: process {pid}, vehicle_2/vehicle"
    assert [message for message in messages if message.startswith(host)][1:] == [
        f"{host}: matched",
        f"{host}: closed",
    ]
