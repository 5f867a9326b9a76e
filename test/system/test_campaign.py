"""A handful of the seeded searches of test/campaign, each command a process of its own."""

import subprocess
import sys
from pathlib import Path

import pytest

CAMPAIGN = Path(__file__).parents[1] / "campaign"


@pytest.mark.parametrize("seed", [1, 2])
def test_hostile_input_breaks_no_rule(seed: int) -> None:
    command = [sys.executable, str(CAMPAIGN / "inputs.py"), "--seed", str(seed), "--count", "8"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "scenarios: 8 cases" in done.stdout
    assert "folders: 8 cases" in done.stdout


def test_faults_of_a_platoon_break_no_rule() -> None:
    command = [sys.executable, str(CAMPAIGN / "faults.py"), "--seed", "1", "--count", "4"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "4 faults, 0 with something wrong" in done.stdout
