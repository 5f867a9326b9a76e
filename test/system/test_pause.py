"""Real platoons that wait in the middle, and the simulated time on /clock."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from rosgraph_msgs.msg import Clock

from cacc_platoon.bags.digest import run_digest
from cacc_platoon.cli import main
from cacc_platoon.dds.domain import own_domain
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import simulate
from cacc_platoon.testing import Platoon
from msg_adapters.topics import Graph

PAPER_A = Path(__file__).parents[2] / "config" / "paper_a.yaml"
SETTINGS = (
    *("platoon.followers=4", "leader.start=1", "run.duration=6", "v2v.loss=0.2"),
    *("run.pause_at=2", "run.clock=true", "run.stall_timeout=1"),
)


def control(run: Platoon, *arguments: str) -> tuple[int, str]:
    """Ask a platoon by the command; return its exit code and what it says."""
    done = subprocess.run(
        [sys.executable, "-m", "cacc_platoon", "control", *arguments],
        env=run.environment(),
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
    )
    return done.returncode, (done.stdout + done.stderr).strip()


def test_a_run_that_waited_records_what_it_would_have(
    platoon: Callable[..., Platoon],
) -> None:
    run, shown = platoon(*SETTINGS, hosts=2), [-1]

    def take(message: Clock) -> None:
        shown.append(message.clock.sec * 1_000_000_000 + message.clock.nanosec)

    run.subscribe(Clock, "/clock", take)
    assert run.wait_event("pause")["sample"] == 200
    run.wait(lambda: shown[-1] == 2_000_000_000, 20.0, "the time of the pause")
    paused = time.monotonic()
    assert control(run, "pause") == (1, "platoon: /platoon: paused at sample 200 already")
    assert control(run, "step", "7") == (0, "/platoon pauses at sample 207")
    run.wait(lambda: shown[-1] == 2_070_000_000, 20.0, "the time after the step")
    run.wait(lambda: time.monotonic() > paused + 1.5, 10.0, "longer than run.stall_timeout")
    assert shown[-1] == 2_070_000_000
    assert control(run, "resume") == (0, "/platoon goes on")
    result = run.result()
    assert (result.exit_code, result.errors) == (0, "")
    assert shown == sorted(shown)
    assert shown[-1] == 6_000_000_000
    kinds = [event["kind"] for event in run.events]
    assert kinds == ["start", "pause", "resume", "end"]
    one = load_scenario(PAPER_A, SETTINGS)
    assert result.digest == run_digest(recording_of(simulate(one)), Graph.of(one))
    assert result.info is not None
    assert (result.info.wall_time or 0.0) < time.monotonic() - paused


def test_nobody_there_to_be_asked_is_said() -> None:
    program = (
        "import sys; from cacc_platoon.cli import main; from cacc_platoon.supervision import asking"
        "; asking.LIMIT = 0.5; sys.exit(main(['control', 'resume', '--namespace', '/nobody']))"
    )
    with own_domain() as domain:
        done = subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
            capture_output=True,
            text=True,
            timeout=60.0,
            check=False,
        )
    assert done.returncode == 2
    assert "/nobody/resume: is not there for 0.5 s." in done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["pause", "3"], "control pause: takes no number of samples"),
        (["step", "0"], "run.step_samples = 0 samples must be >= 1"),
        (
            ["step", "--namespace", "x y"],
            "platoon.namespace = 'x y' must be a ROS name",
        ),
    ],
)
def test_what_nobody_can_be_asked(
    capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    assert main(["control", *arguments]) == 2
    assert said in capsys.readouterr().err
