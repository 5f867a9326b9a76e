"""Commands whose output is closed or full, whose paths are none, whose middleware is absent."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

PAPER_A = str(Path(__file__).parents[2] / "config" / "paper_a.yaml")
SHORT = ("--set", "run.duration=0.5", "--set", "platoon.followers=2")


def shell(line: str, *arguments: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    """Run `platoon "$@"` as a shell line has it."""
    command = f'"{sys.executable}" -m cacc_platoon "$@"'
    return subprocess.run(
        ["bash", "-c", line.replace("platoon", command), "-", *arguments],
        capture_output=True,
        text=True,
        timeout=90,
        check=False,
        env={**os.environ, **environment},
    )


@pytest.mark.parametrize(
    "arguments", [("parameters",), ("simulate", PAPER_A, *SHORT), ("--help",), ("design", "--json")]
)
@pytest.mark.parametrize("line", ["platoon >&-", "platoon <&- >&-", "platoon <&- >&- 2>&-"])
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
