"""A handful of the seeded searches of test/campaign, each command a process of its own."""

import subprocess
import sys
from pathlib import Path

CAMPAIGN = Path(__file__).parents[1] / "campaign"


def searched(name: str, count: int) -> str:
    """Run some cases of a search, which have to break no rule, and return what it says."""
    command = [sys.executable, str(CAMPAIGN / name), "--count", str(count)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_hostile_input_breaks_no_rule() -> None:
    said = searched("inputs.py", 2)
    assert "scenarios: 2 cases" in said
    assert "folders: 2 cases" in said


def test_recommended_designs_keep_all_that_is_asked() -> None:
    assert "1 questions" in searched("designs.py", 1)


def test_faults_of_platoons_end_as_they_may(tmp_path: Path) -> None:
    """Two at once; what is left of those that did not is kept for whoever looks at the test."""
    kept = tmp_path / "kept"
    command = [sys.executable, "-m", "cacc_platoon", "campaign", "--faults", "6", "--jobs", "2"]
    done = subprocess.run([*command, "-o", str(kept)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "6 faults, 6 ended as they may, 0 not" in done.stdout
    assert not kept.exists()


def test_channels_have_one_digest_whatever_disturbs_them() -> None:
    assert "1 tries, 0 with something wrong" in searched("channels.py", 1)
