"""`colcon build` of a clean copy, and what `ros2 run` would then execute."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from cacc_platoon.dds.domain import own_domain
from cacc_platoon.scenario.file import load_scenario

ROOT = Path(__file__).parents[2]
EXECUTABLES = [
    "host",
    "leader",
    "markers",
    "noise_relay",
    "platoon",
    "recorder",
    "supervisor",
    "vehicle",
]


@pytest.fixture(scope="module")
def workspace(tmp_path_factory, copy_source):
    """Return a workspace in which the package is built."""
    return built(tmp_path_factory.mktemp("workspace"), copy_source)


def built(folder: Path, copy_source: Callable[[Path], None], *options: str) -> Path:
    """Return a folder as a workspace in which the package is built."""
    copy_source(folder / "src" / "cacc_platoon")
    environment = {
        **{name: value for name, value in os.environ.items() if name != "PYTHONPATH"},
        "HOME": str(folder / "home"),
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
    }
    command = [sys.executable, "-m", "colcon", "--log-base", "log"]
    command += ["build", "--event-handlers", "console_direct-", *options]
    build = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=120
    )
    assert build.returncode == 0, build.stdout + build.stderr
    assert "Finished <<< cacc_platoon" in build.stdout
    return folder


def in_workspace(
    workspace: Path, *command: str, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run a command in a shell that has sourced the workspace, away from the source."""
    script = '. "$0/install/setup.sh" && exec "$@"'
    return subprocess.run(
        ["bash", "-c", script, str(workspace), *command],
        cwd=workspace,
        env={**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF", **environment},
        capture_output=True,
        text=True,
        timeout=120,
    )


def test_executables_are_where_ros2_run_looks(workspace):
    folder = workspace / "install" / "cacc_platoon" / "lib" / "cacc_platoon"
    assert sorted(path.name for path in folder.iterdir()) == EXECUTABLES
    assert not (workspace / "install" / "cacc_platoon" / "bin").exists()


@pytest.mark.parametrize("name", EXECUTABLES)
def test_every_executable_answers_help(workspace, name):
    path = workspace / "install" / "cacc_platoon" / "lib" / "cacc_platoon" / name
    answer = in_workspace(workspace, str(path), "--help")
    assert answer.returncode == 0, answer.stderr
    assert name in answer.stdout
    assert len(answer.stdout.splitlines()) >= 3


def test_symlink_install_runs_what_is_in_the_source(tmp_path, copy_source):
    """Colcon then runs setup.py in a folder that has no pyproject.toml."""
    workspace = built(tmp_path, copy_source, "--symlink-install")
    (tmp_path / "src" / "cacc_platoon" / "cacc_platoon" / "new.py").write_text("WORDS = 'edited'\n")
    folder = workspace / "install" / "cacc_platoon" / "lib" / "cacc_platoon"
    assert sorted(path.name for path in folder.iterdir()) == EXECUTABLES
    answer = in_workspace(workspace, str(folder / "platoon"), "--version")
    assert answer.returncode == 0, answer.stderr
    script = "import cacc_platoon.new; print(cacc_platoon.new.WORDS)"
    answer = in_workspace(workspace, sys.executable, "-c", script)
    assert answer.stdout == "edited\n", answer.stderr


def test_a_misplaced_node_says_so_in_one_line_and_ends(workspace):
    path = workspace / "install" / "cacc_platoon" / "lib" / "cacc_platoon" / "vehicle"
    answer = in_workspace(workspace, str(path), "--ros-args", "-r", "__ns:=/elsewhere")
    assert answer.returncode == 2
    [line] = answer.stderr.splitlines()
    assert "vehicle_<i>" in line


@pytest.mark.parametrize("name", sorted(set(EXECUTABLES) - {"platoon", "host"}))
def test_a_missing_scenario_is_said_in_one_line_of_ours(workspace, name):
    path = workspace / "install" / "cacc_platoon" / "lib" / "cacc_platoon" / name
    answer = in_workspace(workspace, str(path), "--ros-args", "--params-file", "nowhere.yaml")
    assert answer.returncode == 2
    [line] = answer.stderr.splitlines()
    assert line == "nowhere.yaml: cannot be read: No such file or directory. Give a scenario file."


def test_what_is_installed_runs_by_the_python_that_built_it(workspace):
    """README: an environment in which colcon was run is needed afterwards, too."""
    folder = workspace / "install" / "cacc_platoon" / "lib" / "cacc_platoon"
    for path in folder.iterdir():
        assert path.read_text().splitlines()[0] == f"#!{sys.executable}"
    assert (workspace / "install" / "setup.sh").is_file()


MANUAL_PLATOON = """
nodes="$1"; shift
"$nodes/leader" --ros-args -r __ns:=/platoon/vehicle_0 "$@" &
"$nodes/noise_relay" --ros-args -r __ns:=/platoon/vehicle_1 "$@" -p record:=parts &
"$nodes/vehicle" --ros-args -r __ns:=/platoon/vehicle_1 "$@" -p record:=parts &
"$nodes/supervisor" --ros-args "$@" -p run.spawn:=false -p record.directory:=run \
  -p record.parts:=parts
"""


HAND_SCENARIO = """
/**:
  ros__parameters:
    platoon: {followers: 1}
    run: {duration: 2.0}
    leader: {profile: csv, file: tables/speed.csv}
/platoon/vehicle_1/*:
  ros__parameters: {controller: {k_v: 0.7}, v2v: {rho: 4.0}}
"""


def test_a_platoon_started_manually_from_the_installed_executables(workspace):
    """Also: a speed table is found beside the file, and a vehicle's own parameters count."""
    nodes = workspace / "install" / "cacc_platoon" / "lib" / "cacc_platoon"
    scenario = workspace / "scenarios" / "hand.yaml"
    (scenario.parent / "tables").mkdir(parents=True)
    scenario.write_text(HAND_SCENARIO)
    (scenario.parent / "tables" / "speed.csv").write_text("0,25\n0.5,25\n1.5,23\n")
    arguments = ["--params-file", str(scenario), "-p", "run.seed:=7"]
    with own_domain() as domain:
        run = in_workspace(
            workspace,
            *("bash", "-c", MANUAL_PLATOON, "manual_nodes", str(nodes), *arguments),
            ROS_DOMAIN_ID=str(domain),
            ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST",
        )
    assert run.returncode == 0, run.stdout + run.stderr
    command = ["simulate", str(scenario), "-o", "simulated", "--set", "run.seed=7"]
    simulation = in_workspace(workspace, str(nodes / "platoon"), *command)
    assert simulation.returncode == 0, simulation.stderr
    digests = {
        json.loads((workspace / folder / "run.json").read_text())["digest"]
        for folder in ("run", "simulated")
    }
    assert len(digests) == 1
    written = load_scenario(workspace / "run" / "scenario.yaml")
    assert written.overrides == {1: {"controller.k_v": 0.7, "v2v.rho": 4.0}}


def test_the_package_is_in_the_ament_index_and_shares_its_files(workspace):
    script = (
        "import cacc_platoon, pathlib, ament_index_python as index\n"
        "print(pathlib.Path(cacc_platoon.__file__).resolve())\n"
        "print(index.get_package_share_directory('cacc_platoon'))\n"
    )
    answer = in_workspace(workspace, sys.executable, "-c", script)
    assert answer.returncode == 0, answer.stderr
    module, share = (Path(line) for line in answer.stdout.splitlines())
    prefix = workspace / "install" / "cacc_platoon"
    assert module.is_relative_to(prefix / "lib")
    assert share.resolve() == (prefix / "share" / "cacc_platoon").resolve()
    assert (share / "package.xml").read_bytes() == (ROOT / "package.xml").read_bytes()
    assert (share / "launch" / "platoon.launch.py").is_file()
    installed = {path.name for path in (share / "config").iterdir()}
    assert installed == {path.name for path in (ROOT / "config").iterdir()}
    assert {"paper_a.yaml", "paper_b.yaml", "paper_c.yaml"} <= installed


def test_every_module_and_data_file_is_installed(workspace):
    prefix = workspace / "install" / "cacc_platoon"
    [installed] = prefix.glob("lib/python3.*/site-packages")
    for package in ("cacc_platoon", "msg_adapters"):
        source = {path.relative_to(ROOT) for path in files_below(ROOT / package)}
        assert source == {path.relative_to(installed) for path in files_below(installed / package)}


def files_below(folder: Path) -> list[Path]:
    return [p for p in folder.rglob("*") if p.is_file() and p.suffix != ".pyc"]
