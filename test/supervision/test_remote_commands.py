"""Hosts that are started through a command: its words, how it ends, and what it leaves."""

import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from cacc_platoon.errors import UserError
from cacc_platoon.scenario import Scenario
from cacc_platoon.supervision.remote_commands import RemoteCommands, words_of

PATIENCE = 20.0


def scenario(command: str, **more: object) -> Scenario:
    values = {"platoon.followers": 2, "run.remote_hosts": ("east=2",), **more}
    return Scenario.from_values({**values, "run.host_commands": (f"east={command}",)})


def wait(condition: Callable[[], object]) -> None:
    deadline, pause = time.monotonic() + PATIENCE, threading.Event()
    while not condition():
        assert time.monotonic() < deadline
        pause.wait(0.01)


def test_no_shell_reads_the_command() -> None:
    words = words_of(scenario('env "A=$(rm x); b" -'), {"ROS_DOMAIN_ID": "7"})["east"]
    assert words == [
        *("env", "A=$(rm x); b", "-", "env", "ROS_DOMAIN_ID=7"),
        *("ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST", "platoon", "host", "east"),
        *("--namespace", "/platoon", "--attached"),
    ]


def test_the_host_is_as_open_as_the_supervisor_and_may_run_its_code() -> None:
    made = scenario("env", **{"controller.law": "laws:Law"})
    words = words_of(made, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"})["east"]
    assert "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET" in words
    assert words[-1] == "--own-code"


def test_a_command_that_is_not_there_is_refused_in_one_line() -> None:
    with pytest.raises(UserError, match="'shh', which is to start host east, is no command"):
        words_of(scenario("shh user@east"), {})


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[str], RemoteCommands]]:
    """Start a command for a host; afterwards it is gone."""
    with contextlib.ExitStack() as stack:

        def begin(program: str) -> RemoteCommands:
            words = [sys.executable, "-c", program]
            made = stack.enter_context(RemoteCommands({"east": words}, tmp_path))
            made.start()
            return made

        yield begin


def test_a_command_that_fails_is_told_with_its_last_words(start, tmp_path: Path) -> None:
    said = "print('one', flush=True); sys.exit('Permission denied (publickey).')"
    commands = start(f"import sys; {said}")
    wait(commands.ended)
    (ended,) = commands.ended()
    assert (ended.host, ended.how) == (
        "east",
        "ended with exit code 1: Permission denied (publickey).",
    )
    assert (tmp_path / "host_east.log").read_text().splitlines()[0] == "one"


def test_a_command_that_leaves_its_host_running_has_not_failed(start) -> None:
    commands = start("")
    commands.stop(PATIENCE)
    assert commands.ended() == []


@pytest.mark.slow
def test_a_command_ends_with_the_run(start, tmp_path: Path) -> None:
    """By its standard input, or else by a signal, with all that it has started."""
    said = tmp_path / "host_east.log"
    polite = "import os, sys; print(os.getpid(), flush=True); sys.stdin.read(); print('bye')"
    deaf = (
        "import os, signal, subprocess; signal.signal(signal.SIGTERM, signal.SIG_IGN); "
        "child = subprocess.Popen(['sleep', '600']); print(child.pid, os.getpid(), flush=True); "
        "child.wait()"
    )
    for program in (polite, deaf):
        commands = start(program)
        wait(said.read_text)
        pids = [int(word) for word in said.read_text().split()]
        commands.stop(0.1)
        wait(partial(gone, pids))
        if program == polite:
            assert said.read_text().endswith("bye\n")
        said.unlink()


def gone(pids: list[int]) -> bool:
    return not any(map(alive, pids))


def alive(pid: int) -> bool:
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] not in "ZX" and os.getpid() != pid
