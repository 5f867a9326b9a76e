"""Where a run lies on disk; what its process did not come to is done first."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import re
import time
from datetime import datetime
from pathlib import Path

from cacc_platoon.bags.raw import BagError
from cacc_platoon.runs.folder import BAG, PARTS, SCENARIO_FILE, RunFolder
from cacc_platoon.runs.info import INFO_FILE, EndStatus, InfoError, RunInfo

KILLED = "its process was killed"
COPIED = "this is a copy that was made while it went on"
SALVAGED = "this is what had been recorded"
_OURS = re.compile(
    rb"(?:^|[/\0])(?:platoon|supervisor)\0|\0-m\0cacc_platoon\0"
    rb"|cacc_platoon[.][a-z]|cacc_platoon/__main__[.]py\0"
)
_TICKS = os.sysconf("SC_CLK_TCK")
ENDED = {
    EndStatus.RUNNING: "goes on",
    EndStatus.FINISHED: "finished",
    EndStatus.FAILED: "failed",
    EndStatus.INTERRUPTED: "was interrupted",
}


def locate(path: Path) -> tuple[Path, Path | None]:
    """Return the bag and the run folder around it; a run whose process is gone is finished first.

    Raises
    ------
    BagError
        When the run goes on, or has recorded nothing.
    """
    if not path.is_dir():
        return path, None
    folder = RunFolder(path)
    if not folder.bag.exists() and (folder.parts.is_dir() or _lost_its_parts(path)):
        _salvage(folder)
    if folder.bag.is_dir():
        return folder.bag, path
    if path.name == BAG and any(
        (path.parent / name).is_file() for name in (INFO_FILE, SCENARIO_FILE)
    ):
        return path, path.parent
    return path, None


def _lost_its_parts(path: Path) -> bool:
    """Return whether a folder is a run's without anything that was recorded."""
    names = {file.name for file in path.iterdir()}
    storage = any(name.endswith((".mcap", ".db3")) for name in names)
    return {INFO_FILE, SCENARIO_FILE} <= names and not storage


def how_it_ended(info: RunInfo, when: str = "") -> str:
    """Say what run.json says of the end of a run."""
    ended = f"the run {ENDED[info.status]}{when}"
    return f"{ended}: {info.message}" if info.message else ended


def nothing_recorded(folder: Path, info: RunInfo) -> BagError:
    """Say that there is nothing to look at, and why."""
    ended = how_it_ended(info, " before anything was recorded").removesuffix(".")
    return BagError(f"{folder}: {ended}. Run it again.")


def _salvage(folder: RunFolder) -> None:
    """Make the bag of a run whose process did not come to it."""
    if not folder.hold():
        raise BagError(f"{folder.path}: {_going_on(folder)}. Wait until it has ended.")
    info, unfinished = last_word(folder)
    try:
        recording = folder.recording()
        scenario = folder.scenario()
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BagError(
            f"{folder.path}: its {PARTS}/ cannot be read ({error}). Run it again."
        ) from error
    if not any(len(record.messages) for record in recording.values()):
        raise nothing_recorded(folder.path, info)
    if unfinished:
        info = dataclasses.replace(info, message=f"{info.message}; {SALVAGED}")
    try:
        folder.finish(scenario, recording, info)
    except OSError as error:
        raise BagError(
            f"{folder.path}: its bag cannot be written ({error.strerror}). Make room, or report on "
            "a copy of the folder."
        ) from error


def _going_on(folder: RunFolder) -> str:
    """Say who holds a folder."""
    try:
        info = RunInfo.read(folder.path)
    except InfoError:
        info = None
    if info is None or info.pid is None:
        return "another process is at it"
    return f"process {info.pid} is at it, since {info.began}"


def last_word(folder: RunFolder) -> tuple[RunInfo, bool]:
    """Return how a run ended whose process is gone, and whether nobody had said so before."""
    try:
        info = RunInfo.read(folder.path)
    except InfoError:
        info = None
    if info is None:
        return RunInfo(EndStatus.FAILED, KILLED), True
    if info.status is not EndStatus.RUNNING:
        return info.with_bag(), False
    if _lives(info):
        info = dataclasses.replace(info, status=EndStatus.INTERRUPTED, message=COPIED)
    else:
        info = dataclasses.replace(info, status=EndStatus.FAILED, message=KILLED)
    with contextlib.suppress(OSError):  # where nothing can be written, the answer is still true
        info.write(folder.path)
    return info, True


def runs_platoons(command_line: bytes) -> bool:
    r"""Whether a command line is one of ours, wherever its interpreter and its files are.

    Examples
    --------
    >>> runs_platoons(b"/src/cacc_platoon/.venv/bin/python\0-m\0cacc_platoon\0run\0")
    True
    >>> runs_platoons(b"/src/cacc_platoon/.venv/bin/python\0-m\0pytest\0")
    False
    """
    return _OURS.search(command_line) is not None


def _lives(info: RunInfo) -> bool:
    """Return whether the process of a run lives: one that was there when the run began."""
    process = Path(f"/proc/{info.pid}")
    try:
        began = datetime.fromisoformat(info.began).timestamp()
        ours = runs_platoons((process / "cmdline").read_bytes())
        ticks = int((process / "stat").read_text().rpartition(")")[2].split()[19])
    except (OSError, ValueError):
        return False
    up = time.clock_gettime(time.CLOCK_BOOTTIME)
    return ours and time.time() - up + ticks / _TICKS <= began + 1.0
