"""Evaluates rows of a study on ROS 2 nodes: each is a `platoon run` of its own."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from cacc_platoon.errors import UserError
from cacc_platoon.runs.info import EndStatus, InfoError, RunInfo
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario
from cacc_platoon.texts import TextError, read_json

PATIENCE = 30.0
"""How long a run that is stopped may take to write its bag [s]."""


_RUN = """
import ctypes, os, signal, sys
ctypes.CDLL(None).prctl(1, signal.SIGTERM)  # PR_SET_PDEATHSIG: it ends when its study does
if os.getppid() != int(sys.argv[1]):
    sys.exit(1)
os.execv(sys.executable, [sys.executable, "-m", "cacc_platoon", *sys.argv[2:]])
"""


class OnNodes:
    """Runs the scenario of a row and returns the numbers of its report.

    As a context it stops the run that goes on when it ends.

    Parameters
    ----------
    folder : Path
        Where the runs are, one a row.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if (process := self._process) is not None:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()

    def __call__(self, scenario: Scenario, row: int) -> dict[str, Any]:
        """Run a scenario, and again where a run of that row was not finished.

        Raises
        ------
        UserError
            When it fails; its last line says why.
        """
        run = self._folder / f"{row}"
        _wait_end(run)
        shutil.rmtree(run, ignore_errors=True)
        self._folder.mkdir(parents=True, exist_ok=True)
        file = self._folder / f"{row}.yaml"
        file.write_text(format_scenario(scenario), encoding="utf-8")
        command = [sys.executable, "-c", _RUN, f"{os.getpid()}", "run", str(file), "-o", str(run)]
        with subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        ) as process:
            self._process = process
            _, said = process.communicate()
            self._process = None
        if process.returncode:
            last = said.strip().splitlines()[-1:] or ["it said nothing"]
            raise UserError(f"exit code {process.returncode}: {last[0]}")
        try:
            found = read_json(run / "metrics.json")
        except TextError as error:
            raise UserError(f"{run / 'metrics.json'}: {error}. Look at {run}.") from error
        if not isinstance(found, dict):
            raise UserError(f"{run / 'metrics.json'}: holds no numbers. Look at {run}.")
        return found


def _wait_end(run: Path) -> None:
    """Wait for a run of a study that was killed, which ends with it and closes its bag."""
    deadline = time.monotonic() + PATIENCE
    while _goes_on(run) and time.monotonic() < deadline:
        time.sleep(0.1)


def _goes_on(run: Path) -> bool:
    try:
        info = RunInfo.read(run) if run.is_dir() else None
    except (InfoError, UserError):  # damaged: nothing says that it goes on
        return False
    if info is None or info.status is not EndStatus.RUNNING or not info.pid:
        return False
    return Path(f"/proc/{info.pid}/exe").exists()
