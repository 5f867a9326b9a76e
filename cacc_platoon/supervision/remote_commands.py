"""Hosts that the supervisor starts through a command, such as ssh: `run.host_commands`.

No shell of this machine reads a word of it. What is added to the command consists of words that no
shell of the other machine changes either.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Mapping
from pathlib import Path

from cacc_platoon.dds.domain import domain_of
from cacc_platoon.dds.environment import LOCALHOST, RANGE, is_local
from cacc_platoon.errors import UserError, one_line
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import host_name
from cacc_platoon.scenario.remote_hosts import host_commands
from cacc_platoon.supervision.run_events import ProcessEnded

_TAIL = 2000


def words_of(scenario: Scenario, environment: Mapping[str, str]) -> dict[str, list[str]]:
    """Return the words of the command that starts each host with a prefix, by its name.

    Raises
    ------
    UserError
        When a command is not there.
    """
    reach = LOCALHOST if is_local(environment) else environment.get(RANGE, "")
    variables = {"ROS_DOMAIN_ID": f"{domain_of(environment)}", RANGE: reach}
    found = {}
    for name, prefix in host_commands(scenario.run).items():
        if shutil.which(prefix[0]) is None:
            raise UserError(
                f"run.host_commands: {prefix[0]!r}, which is to start host {name}, is no command "
                "of this machine. Install it, or correct its name."
            )
        found[name] = [
            *(*prefix, "env"),
            *(f"{variable}={value}" for variable, value in variables.items()),
            *("platoon", "host", name, "--namespace", scenario.platoon.namespace, "--attached"),
            *(["--own-code"] if scenario.custom_code else []),
        ]
    return found


class RemoteCommands:
    """The commands that run, one for each host that the supervisor starts elsewhere.

    Parameters
    ----------
    words : mapping of str to list of str
        What to start, by host.
    logs : Path
        Where a file of each host takes what it writes.
    """

    def __init__(self, words: Mapping[str, list[str]], logs: Path) -> None:
        self._words, self._logs = words, logs
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self) -> None:
        """Start them; each ends when its standard input does, which goes with this process."""
        for name, words in self._words.items():
            with self._log(name).open("ab") as log:
                self._running[name] = subprocess.Popen(
                    words,
                    stdin=subprocess.PIPE,
                    stdout=log,
                    stderr=log,
                    start_new_session=True,  # a Ctrl-C is for the supervisor alone
                )

    def ended(self) -> list[ProcessEnded]:
        """Return those that have failed; one that ends well may have left its host running."""
        return [
            ProcessEnded(name, process.pid, self._how(name, code))
            for name, process in self._running.items()
            if (code := process.poll())
        ]

    def __enter__(self) -> RemoteCommands:
        """Let them run until the end of the context at most."""
        return self

    def __exit__(self, *_: object) -> None:
        """End those that are left."""
        self.stop(0.0)

    def stop(self, patience: float = 3.0) -> None:
        """Wait for them to end by themselves, then end them."""
        self._await(patience)
        for process in self._running.values():
            with contextlib.suppress(OSError):
                assert process.stdin is not None
                process.stdin.close()
        self._await(1.0)
        for number in (signal.SIGTERM, signal.SIGKILL):
            for process in self._running.values():
                if process.poll() is None:
                    with contextlib.suppress(ProcessLookupError):
                        os.killpg(process.pid, number)
            self._await(1.0)
        self._running.clear()

    def _await(self, patience: float) -> None:
        deadline = time.monotonic() + patience
        for process in self._running.values():
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(0.0, deadline - time.monotonic()))

    def _log(self, name: str) -> Path:
        self._logs.mkdir(parents=True, exist_ok=True)
        return self._logs / f"{host_name(name)}.log"

    def _how(self, name: str, code: int) -> str:
        """Say how a command ended, and what it wrote last."""
        how = (
            f"was killed by {signal.Signals(-code).name}"
            if code < 0
            else f"ended with exit code {code}"
        )
        said = b""
        with contextlib.suppress(OSError), self._log(name).open("rb") as log:
            log.seek(max(0, log.seek(0, os.SEEK_END) - _TAIL))
            said = log.read()
        lines = said.decode(errors="replace").strip().splitlines()
        return f"{how}: {one_line(lines[-1])}" if lines else how
