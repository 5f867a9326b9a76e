"""A custom controller among the nodes of the package, and what is said when it fails in one."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from cacc_platoon.cli.simulate import simulate_run
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.testing import Platoon

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PAPER_A = ROOT / "config" / "paper_a.yaml"
SMALL = ("run.duration=1", "platoon.followers=2")
FAILS = "controller.law=own_parts:tried_alone"
REASON = f"{FAILS.replace('=', ' = ')}: raised SystemExit: 3 when it was made for vehicle"


def test_the_example_of_the_readme_runs(tmp_path: Path) -> None:
    blocks = re.findall(r"```python\n# (\w+\.py)\n(.*?)```", (ROOT / "README.md").read_text(), re.S)
    assert [name for name, _ in blocks] == ["my_vehicle.py", "test_my_vehicle.py"]
    for name, code in blocks:
        (tmp_path / name).write_text(code)
    (tmp_path / "config").symlink_to(ROOT / "config")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert "1 passed" in done.stdout, done.stdout


def test_a_law_that_fails_in_a_host_ends_the_run_with_its_reason(
    platoon: Callable[..., Platoon],
) -> None:
    run = platoon(*SMALL, f"vehicle_2.{FAILS}", environment={"PYTHONPATH": str(HERE)})
    result = run.result()
    assert (result.exit_code, result.status) == (1, "failed")
    assert result.message.startswith(f"{REASON} 2; the run would lack it. Correct its code; ")
    assert "Traceback" not in result.errors


def test_a_law_that_fails_in_a_replay_is_one_line(nothing_left: None, tmp_path: Path) -> None:
    run = simulate_run(load_scenario(PAPER_A, SMALL), tmp_path / "run")
    command = [sys.executable, "-m", "cacc_platoon", "replay", str(run.path), "--vehicle", "2"]
    done = subprocess.run(
        [*command, "--set", FAILS],
        env={**os.environ, "PYTHONPATH": f"{HERE}:{os.environ.get('PYTHONPATH', '')}"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("platoon: ")]
    assert line.startswith(f"platoon: {REASON} 2; ")
    assert "Traceback" not in done.stderr
