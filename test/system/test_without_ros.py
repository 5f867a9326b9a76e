"""Everything but nodes and the harness works where ROS is not installed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NEEDS_ROS = (
    "cacc_platoon.campaign",
    "cacc_platoon.nodes",
    "cacc_platoon.supervision",
    "cacc_platoon.testing",
    "cacc_platoon.__main__",
)
DECISIONS = [
    f"cacc_platoon.supervision.{name}"
    for name in (
        *("protocol", "json_fields", "run_machine", "run_state", "run_events", "pacing"),
        *("agreement", "outcome", "stall_diagnosis", "host_machine", "host_plan", "log"),
        "replay_machine",
    )
]
"""What decides in a run; the rest of supervision carries it out."""
WITHOUT_ROS = """
import sys

class Absent:
    packages = {"rclpy", "std_msgs", "geometry_msgs", "rosgraph_msgs", "rcl_interfaces",
                "builtin_interfaces", "diagnostic_msgs", "ament_index_python", *sys.argv[1].split()}

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in self.packages:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Absent())
del sys.argv[1]
"""
TIMED = """
import time
import pytest, cacc_platoon.simulation, cacc_platoon.supervision.run_machine
imports = time.process_time()
code = pytest.main(["-p", "no:cacheprovider", *sys.argv[1:]])
print(imports, time.process_time() - imports)
sys.exit(code)
"""
MOST = 16.0
"""Times what the imports take."""


def run_without(
    program: str, *arguments: str, also: str = "", cwd: Path = ROOT, measured: bool = True
) -> subprocess.CompletedProcess[str]:
    """Run a program where ROS, and the packages in `also`, cannot be imported.

    What is not `measured` runs at full speed under coverage too.
    """
    environment = {
        name: value
        for name, value in os.environ.items()
        if measured or not name.startswith("COVERAGE")
    }
    return subprocess.run(
        [sys.executable, "-c", WITHOUT_ROS + program, also, *arguments],
        capture_output=True,
        text=True,
        cwd=cwd,
        env=environment,
        timeout=120,
    )


def platoon(*arguments: str, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    program = "from cacc_platoon.cli import main; sys.exit(main(sys.argv[1:]))"
    return run_without(program, *arguments, cwd=cwd)


def pure_modules() -> list[str]:
    paths = [*(ROOT / "cacc_platoon").rglob("*.py"), *(ROOT / "msg_adapters").rglob("*.py")]
    names = (".".join(path.relative_to(ROOT).with_suffix("").parts) for path in paths)
    modules = (name.removesuffix(".__init__") for name in names)
    return sorted(name for name in modules if not name.startswith(NEEDS_ROS)) + DECISIONS


def test_the_stand_in_for_a_machine_without_ros_works():
    answer = run_without("import rclpy")
    assert "ModuleNotFoundError: No module named 'rclpy'" in answer.stderr


def test_every_pure_module_can_be_imported():
    program = "import importlib\nfor name in sys.argv[1:]: importlib.import_module(name)"
    answer = run_without(program, *pure_modules())
    assert answer.returncode == 0, answer.stderr


def test_what_decides_in_a_run_is_tested_without_ros_in_seconds():
    """Every test of it runs where ROS cannot be imported; all of them take 3 s.

    That is eight times what the imports take, by which the speed of the machine is measured.
    """
    files = sorted(map(str, (ROOT / "test" / "supervision").glob("test_*.py")))
    answer = run_without(TIMED, *files, "test/runs/test_sample_recorder.py", measured=False)
    assert answer.returncode == 0, answer.stdout
    imports, tests = map(float, answer.stdout.splitlines()[-1].split())
    assert tests < MOST * imports


@pytest.mark.parametrize("room", ["model", "theory", "design", "simulation", "scenario"])
def test_the_core_needs_numpy_alone(room):
    absent = "matplotlib rosbags ruamel scipy control mcap yaml"
    answer = run_without(f"import cacc_platoon.{room}", also=absent)
    assert answer.returncode == 0, answer.stderr


def test_tests_marked_unit_need_no_ros(pytestconfig):
    """Decided by what a file imports, here by importing it."""
    conftest = pytestconfig.pluginmanager.get_plugin(str(ROOT / "test" / "conftest.py"))
    files = [
        path for path in (ROOT / "test").rglob("test_*.py") if conftest.kind_of(path) == "unit"
    ]
    assert len(files) > 20
    program = "import runpy\nfor name in sys.argv[1:]: runpy.run_path(name)"
    answer = run_without(program, *map(str, files))
    assert answer.returncode == 0, answer.stderr


def test_help_of_the_command_and_of_every_verb():
    answer = platoon("--help")
    assert answer.returncode == 0, answer.stderr
    for verb in ("design", "run", "simulate", "report", "doctor"):
        assert f"    {verb} " in answer.stdout
        answer_of_verb = platoon(verb, "--help")
        assert answer_of_verb.returncode == 0, answer_of_verb.stderr
        assert f"usage: platoon {verb}" in answer_of_verb.stdout


def test_design_simulate_and_report(tmp_path):
    designed = platoon("design", "--rho", "5", "--tau-max", "0.5", "--json")
    assert designed.returncode == 0, designed.stderr
    assert json.loads(designed.stdout)["infimum_headway"] == pytest.approx(0.6)

    scenario = str(ROOT / "config" / "paper_b.yaml")
    settings = ["--set", "run.duration=20", "--set", "platoon.followers=3"]
    simulated = platoon("simulate", scenario, "-o", str(tmp_path / "run"), *settings)
    assert simulated.returncode == 0, simulated.stderr
    assert "Traceback" not in simulated.stderr
    assert (tmp_path / "run" / "bag" / "metadata.yaml").is_file()

    reported = platoon("report", str(tmp_path / "run"), "--json")
    assert reported.returncode == 0, reported.stderr
    assert json.loads(reported.stdout)["verdict"]["string_stable"] is False


def test_run_says_what_is_missing_and_what_works_instead(tmp_path):
    answer = platoon("run", str(ROOT / "config" / "paper_a.yaml"), "-o", str(tmp_path / "run"))
    assert answer.returncode == 2
    assert answer.stdout == ""
    [line] = answer.stderr.splitlines()
    assert "ROS 2" in line
    assert "platoon simulate" in line
    assert not (tmp_path / "run").exists()
