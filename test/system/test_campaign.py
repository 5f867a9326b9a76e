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
