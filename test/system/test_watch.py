"""Who watches a platoon sees it, and does not hold it up: frozen, killed, or sending nonsense."""

import contextlib
import fcntl
import json
import os
import pty
import re
import signal
import struct
import subprocess
import sys
import termios
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from std_msgs.msg import Int64, String

from cacc_platoon.bags.digest import run_digest
from cacc_platoon.dds.domain import own_domain
from cacc_platoon.nodes import qos
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.runs.sample_reader import Reading
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import simulate
from cacc_platoon.supervision.view_message import HostView
from cacc_platoon.testing import Platoon
from msg_adapters.topics import Graph

PAPER_A = Path(__file__).parents[2] / "config" / "paper_a.yaml"
SMALL = ("run.duration=60", "platoon.followers=3", "run.real_time_factor=10")
"""Six seconds of wall time, slow enough to watch."""
PATIENCE = 60.0

Start = Callable[..., Platoon]
Watcher = Callable[..., subprocess.Popen[str]]


def digest(run: Platoon) -> str:
    return run_digest(recording_of(simulate(run.scenario)), Graph.of(run.scenario))


@pytest.fixture
def watch(tmp_path: Path) -> Iterator[Watcher]:
    """Start `platoon watch` in the domain of a platoon; end it afterwards, frozen or not."""
    started: list[subprocess.Popen[str]] = []

    def start(run: Platoon, *arguments: str) -> subprocess.Popen[str]:
        with (tmp_path / f"watch_{len(started)}.txt").open("w") as errors:
            process = subprocess.Popen(
                [sys.executable, "-m", "cacc_platoon", "watch", *arguments],
                stdout=subprocess.PIPE,
                stderr=errors,
                env=run.environment(),
                text=True,
            )
        started.append(process)
        return process

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
            process.send_signal(signal.SIGCONT)
        assert process.stdout
        process.stdout.close()
        process.wait(PATIENCE)


def test_a_run_is_seen_and_does_not_notice(platoon: Start, watch: Watcher) -> None:
    """One watcher sees all of it, another is frozen in the middle, and one is killed."""
    run = platoon(*SMALL, hosts=2)
    whole, frozen, killed = (watch(run, "--json") for _ in range(3))
    for one in (frozen, killed):
        assert one.stdout
        while not any(v["gap"] for v in json.loads(one.stdout.readline())["vehicles"]):
            pass
    frozen.send_signal(signal.SIGSTOP)
    killed.kill()
    result = run.result()
    output, _ = whole.communicate(timeout=PATIENCE)
    assert (result.status, result.digest) == ("finished", digest(run)), result.message
    assert whole.returncode == 0
    pictures = [json.loads(line) for line in output.splitlines()]
    assert pictures[-1]["phase"] == "finished"
    expected, compared = result.trajectory(), 0
    for picture in pictures:
        for vehicle in picture["vehicles"][1:]:
            if vehicle["gap"] is not None:
                sample, column = vehicle["sample"], vehicle["vehicle"] - 1
                assert vehicle["gap"] == pytest.approx(expected.gap[sample, column])
                error = expected.spacing_error[sample, column]
                assert vehicle["spacing_error"] == pytest.approx(error, abs=1e-9)
                compared += 1
    assert compared > 20


def test_what_is_forged_spoils_a_picture_and_nothing_else(platoon: Start, watch: Watcher) -> None:
    run = platoon(*SMALL, hosts=2)
    run.wait_sample(100)
    lie = {"/platoon/vehicle_1/pose": Reading(6000, 1e9)}
    texts = [
        *("", "{}", "[" * 10_000, "x" * 100_000, '{"format": 3}'),
        *(HostView(name, "0", 6000, lie).to_json() for name in ("none", "x")),
    ]
    views = run.advertise(String, "/platoon/view", qos.glimpse())
    requests = run.advertise(Int64, "/platoon/view_request", qos.glimpse())
    watcher = watch(run, "--json")
    assert watcher.stdout
    for line in watcher.stdout:
        for text in texts:
            views.publish(String(data=text))
        for sample in (-1, 0, 2**62):
            requests.publish(Int64(data=sample))
        if json.loads(line)["phase"] == "finished":
            break
    result = run.result()
    assert (result.status, result.digest) == ("finished", digest(run)), result.message
    assert "another publisher" not in result.errors
    for log in result.folder.logs.glob("*"):
        assert "Traceback" not in log.read_text()


def test_a_watcher_waits_for_a_run_and_ends_as_it_is_told(platoon: Start, watch: Watcher) -> None:
    later = "vehicle_1/noise_relay"
    run = platoon(*SMALL, f"run.manual_nodes=[{later}]")
    once = watch(run, "--once", "--namespace", "/other")
    waiting = watch(run)
    assert once.wait(PATIENCE) == 1
    assert waiting.stdout
    assert waiting.stdout.readline().startswith("/platoon, ")
    waiting.send_signal(signal.SIGINT)
    assert waiting.wait(PATIENCE) == 130
    run.start(later)
    result = run.result()
    assert result.status == "finished"


def test_on_a_terminal_a_run_shows_its_vehicles(tmp_path: Path, nothing_left: None) -> None:
    settings = ("run.duration=10", "platoon.followers=2", "run.real_time_factor=5")
    scenario = load_scenario(PAPER_A, settings)
    command = [sys.executable, "-m", "cacc_platoon", "run", str(PAPER_A), "--no-report"]
    command += [part for setting in settings for part in ("--set", setting)]
    ours, theirs = pty.openpty()
    fcntl.ioctl(ours, termios.TIOCSWINSZ, struct.pack("4H", 20, 60, 0, 0))
    with own_domain() as domain, os.fdopen(ours, "rb", buffering=0) as terminal:
        process = subprocess.Popen(
            [*command, "-o", str(tmp_path / "run")],
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            env={**os.environ, "ROS_DOMAIN_ID": str(domain), "TERM": "xterm", "NO_COLOR": "1"},
        )
        os.close(theirs)
        shown = b""
        with contextlib.suppress(OSError):  # how a terminal says that all have closed it
            while more := terminal.read(65536):
                shown += more
        assert process.wait(PATIENCE) == 0
    pictures = shown.decode().split("/platoon  ")[1:]
    assert any("running  sample" in picture for picture in pictures)
    whole = [picture for picture in pictures if "28.7" in picture]
    assert len(whole) > 3
    for picture in whole:
        rows = re.findall(r"\x1b\[2K( .*)\r\n", picture)
        assert [row.split()[0] for row in rows[-4:-1]] == ["0", "1", "2"]
        assert max(map(len, rows)) <= 60
    assert shown.endswith(b"\x1b[K")
    info = json.loads((tmp_path / "run" / "run.json").read_text())
    expected = run_digest(recording_of(simulate(scenario)), Graph.of(scenario))
    assert info["digest"] == expected
