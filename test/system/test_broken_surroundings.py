"""Commands whose output is closed or full, whose paths are none, whose middleware is absent."""

import contextlib
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PAPER_A = str(Path(__file__).parents[2] / "config" / "paper_a.yaml")
LISTENING = ("env", "--default-signal=INT,TERM,HUP")  # what a job in the background ignores
SHORT = ("--set", "run.duration=0.5", "--set", "platoon.followers=2")


def shell(line: str, *arguments: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    """Run `platoon "$@"` as a shell line has it, with output that is buffered as users have it."""
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    command = f'"{sys.executable}" -m cacc_platoon "$@"'
    return subprocess.run(
        ["bash", "-c", line.replace("platoon", command), "-", *arguments],
        capture_output=True,
        text=True,
        timeout=90,
        check=False,
        env={**buffered, **environment},
    )


CLOSED = ("platoon >&-", "platoon <&- >&-", "platoon <&- >&- 2>&-")
SAYING = (("parameters",), ("--help",), ("design", "--json"))
SIMULATE = ("simulate", PAPER_A, *SHORT)


@pytest.mark.parametrize(
    ("line", "arguments"),
    [*itertools.product(CLOSED, SAYING), (CLOSED[0], SIMULATE), (CLOSED[-1], SIMULATE)],
)
def test_closed_streams(tmp_path: Path, line: str, arguments: tuple[str, ...]) -> None:
    output = ("-o", str(tmp_path / "run")) if "simulate" in arguments else ()
    done = shell(line, *arguments, *output)
    assert done.returncode == (2 if "design" in arguments else 0), done
    assert "Traceback" not in done.stderr
    if output:
        assert (tmp_path / "run" / "report.html").is_file()


@pytest.mark.parametrize("arguments", [("parameters",), ("--help",)])
def test_output_that_has_no_room(arguments: tuple[str, ...]) -> None:
    done = shell("platoon >/dev/full", *arguments)
    assert done.returncode == 1
    assert done.stderr == (
        "platoon: standard output cannot be written: No space left on device. Its answer is lost.\n"
    )


def test_a_reader_that_has_seen_enough() -> None:
    done = shell("platoon --help | exec true; echo ${PIPESTATUS[0]}")
    assert done.stdout.strip() in ("0", "1")
    assert done.stderr == ""


@pytest.mark.parametrize("variable", ["RMW_IMPLEMENTATION", "RCL_ASSERT_RMW_ID_MATCHES"])
def test_a_middleware_that_is_absent(tmp_path: Path, variable: str) -> None:
    output = str(tmp_path / "run")
    done = shell("platoon", "run", PAPER_A, "-o", output, **{variable: "rmw_absent_cpp"})
    assert done.returncode == 2
    assert done.stderr.startswith(f"platoon: platoon run: {variable} = rmw_absent_cpp is not")
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "run").exists()
    done = shell("platoon", "doctor", "--json", **{variable: "rmw_absent_cpp"})
    assert done.returncode == 1
    findings = json.loads(done.stdout)
    assert "rmw_absent_cpp is not installed here" in findings["rclpy"]["text"]
    assert not findings["DDS"]["ok"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_simulation_that_is_ended_leaves_nothing(tmp_path: Path, number: signal.Signals) -> None:
    command = [sys.executable, "-m", "cacc_platoon", "simulate", PAPER_A, "-o", str(tmp_path / "s")]
    with subprocess.Popen([*LISTENING, *command], stderr=subprocess.PIPE) as process:
        deadline = time.monotonic() + 60
        while not (tmp_path / "s" / "run.json").exists():
            assert time.monotonic() < deadline
        process.send_signal(number)
        assert process.wait(60) == 128 + number
        assert process.stderr
        said = process.stderr.read().splitlines()
    assert said[-1] in (b"platoon: interrupted", f"platoon: stopped by {number.name}".encode())
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize("seconds", [0.02, 0.05, 0.1, 0.2, 0.4, 0.8])
def test_an_early_ctrl_c_is_no_traceback(tmp_path: Path, seconds: float) -> None:
    """Once Python runs our code."""
    entry = "import sys; print('begun', flush=True); from cacc_platoon.__main__ import main"
    entry += "; sys.exit(main())"
    command = [sys.executable, "-c", entry, "run", PAPER_A, *SHORT, "-o", str(tmp_path / "run")]
    with subprocess.Popen(
        [*LISTENING, *command], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout
        assert process.stdout.readline() == b"begun\n"
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(seconds)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=120)
    assert process.returncode in (-signal.SIGINT, 130), said
    assert b"Traceback" not in said


@pytest.mark.parametrize("path", ["/dev/null", "x" * 5000, "pipe", "a\x1b[31m\nb"])
@pytest.mark.parametrize("verb", ["report", "simulate", "layout"])
def test_paths_that_are_none(tmp_path: Path, verb: str, path: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    given = path if path != "pipe" else str(tmp_path / path)
    done = shell("platoon", verb, given, "-o", str(tmp_path / "out"))
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.isprintable()
    assert len(line) < 2100
