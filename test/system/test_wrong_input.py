"""Wrong input to real commands and nodes: one clear line, exit code 2, nothing started."""

import contextlib
import fcntl
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from cacc_platoon.cli import main
from cacc_platoon.dds.domain import own_domain

PAPER_A = Path(__file__).parents[2] / "config" / "paper_a.yaml"


def platoon(*arguments: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "cacc_platoon", *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def executable(kind: str, *arguments: str) -> "subprocess.CompletedProcess[str]":
    module = "cli.supervisor" if kind == "supervisor" else "supervision.entry_points"
    name = "main" if kind == "supervisor" else kind
    code = f"import sys; from cacc_platoon.{module} import {name} as run; sys.exit(run())"
    return subprocess.run(
        [sys.executable, "-c", code, "--ros-args", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"},
    )


def assert_refused(done: "subprocess.CompletedProcess[str]", *words: str) -> None:
    assert done.returncode == 2, done
    """Refused in one line; Fast DDS may complain of a port that another takes at that moment."""
    assert [line for line in done.stdout.splitlines() if "RTPS" not in line] == []
    own = [line for line in done.stderr.splitlines() if "RTPS" not in line]
    assert len(own) == 1, done.stderr
    for word in words:
        assert word in done.stderr


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("controller.time_headwy=1", ("unknown key", "Did you mean controller.time_headway?")),
        ("controller.time_headway=-1", ("must be > 0", "-1 s")),
        ("controller.k_v=fast", ("must be a number", "'fast'")),
        ("v2v.rho=1", ("must be > 1",)),
        ("v2v.rho=.nan", ("must be finite",)),
        ("vehicle.tau=[0.5, 0.4]", ("2 values for 12 followers",)),
        ("run.step=0.0100000001", ("whole number of nanoseconds",)),
        ("run.hosts=many", ("auto, per_node or a whole number",)),
        ("run.manual_nodes=[vehicle_13/vehicle]", ("no node of this platoon",)),
        ("leader.profile=csv", ("must name a file",)),
        ("vehicle_13.controller.k_v=1", ("followers 1 to 12",)),
        ("no_equals_sign", ("key=value",)),
    ],
)
def test_a_wrong_setting(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], setting: str, words: tuple[str, ...]
) -> None:
    output = tmp_path / "run"
    for verb in ("run", "simulate"):
        arguments = [verb, str(PAPER_A), "-o", str(output), "--set", setting]
        code = main(arguments)
        assert_refused(subprocess.CompletedProcess(arguments, code, *capsys.readouterr()), *words)
        assert not output.exists()


def test_rho_and_snr_db_together(tmp_path: Path) -> None:
    text = PAPER_A.read_text().replace("rho: 5.0", "rho: 5.0\n      snr_db: 14.0")
    (tmp_path / "both.yaml").write_text(text)
    assert_refused(platoon("run", str(tmp_path / "both.yaml")), "Give one of them")


@pytest.mark.parametrize("verb", ["run", "simulate"])
def test_a_missing_file(tmp_path: Path, verb: str) -> None:
    assert_refused(platoon(verb, str(tmp_path / "absent.yaml")), "absent.yaml", "cannot be read")


@pytest.mark.parametrize("verb", ["run", "simulate"])
def test_an_existing_folder_is_never_overwritten(tmp_path: Path, verb: str) -> None:
    (tmp_path / "precious").write_text("data")
    done = platoon(verb, str(PAPER_A), "-o", str(tmp_path))
    assert_refused(done, "exists already")
    assert [path.name for path in tmp_path.iterdir()] == ["precious"]


@pytest.mark.parametrize("verb", ["run", "simulate"])
def test_a_folder_that_cannot_be_written(tmp_path: Path, verb: str) -> None:
    (tmp_path / "file").write_text("")
    done = platoon(verb, str(PAPER_A), "-o", str(tmp_path / "file" / "run"))
    assert_refused(done, "cannot be written", "Not a directory")


def test_too_many_processes(tmp_path: Path) -> None:
    settings = ["--set", "platoon.followers=60", "--set", "run.hosts=per_node"]
    done = platoon("run", str(PAPER_A), "-o", str(tmp_path / "run"), *settings)
    assert_refused(done, "121 processes", "fewer than 100")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("kind", ["leader", "vehicle", "noise_relay"])
def test_a_node_outside_of_a_vehicle_namespace(kind: str) -> None:
    assert_refused(executable(kind), "takes its index from its namespace", "__ns:=")


@pytest.mark.parametrize("kind", ["vehicle", "supervisor"])
@pytest.mark.parametrize(
    ("parameter", "words"),
    [
        ("controller.k_vv:=1.0", ("unknown key controller.k_vv", "Did you mean controller.k_v?")),
        ("controller.k_v:=fast", ("must be a number",)),
        ("controller.time_headway:=0.0", ("must be > 0",)),
        ("vehicle.tau:=0.7", ("tau_max",)),
    ],
)
def test_a_wrong_parameter_of_a_node(kind: str, parameter: str, words: tuple[str, ...]) -> None:
    namespace = ("-r", "__ns:=/platoon/vehicle_1") if kind == "vehicle" else ()
    assert_refused(executable(kind, *namespace, "-p", parameter), *words)


def test_a_parameter_file_that_is_none(tmp_path: Path) -> None:
    (tmp_path / "broken.yaml").write_text("/**:\n  ros__parameters: [1, 2\n")
    done = executable(
        "vehicle", "-r", "__ns:=/platoon/vehicle_1", "--params-file", str(tmp_path / "broken.yaml")
    )
    lines = [line for line in done.stderr.splitlines() if "[rcl]" not in line]
    assert done.returncode == 2
    assert len(lines) == 1
    assert "broken.yaml" in lines[0]


def test_a_recorder_without_a_folder() -> None:
    assert_refused(executable("recorder", "-r", "__ns:=/platoon"), "record:=DIR")


@pytest.mark.parametrize(
    "kind", ["leader", "vehicle", "noise_relay", "recorder", "markers", "supervisor"]
)
def test_help_of_the_executables(kind: str) -> None:
    done = executable(kind, "--help")
    assert done.returncode == 0
    assert "ros2 run cacc_platoon" in done.stdout


def test_doctor_finds_this_machine_well() -> None:
    done = platoon("doctor", "--json")
    findings = json.loads(done.stdout)
    assert done.returncode == 0, findings
    assert findings["DDS"]["ok"]


def test_complaints_of_dds_do_not_get_into_the_answer_of_doctor() -> None:
    """Fast DDS writes on standard output that a port of its was being opened by somebody else."""
    with own_domain() as domain, contextlib.ExitStack() as stack:
        for port in range(7400 + 250 * domain, 7420 + 250 * domain):
            for kind in ("el", "sl"):
                path = Path(f"/dev/shm/fastrtps_port{port}_{kind}")
                stack.callback(path.unlink, missing_ok=True)
                fcntl.flock(stack.enter_context(path.open("w")), fcntl.LOCK_EX)
        done = platoon("doctor", "--json", ROS_DOMAIN_ID=str(domain))
    assert "open_and_lock_file failed" in done.stderr
    assert done.returncode == 0
    assert json.loads(done.stdout)["DDS"]["ok"]
