"""Fast DDS files in /dev/shm: which are ours, and removing those of the dead.

A living process keeps the file `<name>_el` of each segment and port that it owns locked. Every
host notes what it uses in a file below the temporary folder. A process that was killed leaves
its note behind, and the segments it owned or sent to; the next process of ours removes them, by
name, and only what no living process has locked.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")
_PREFIXES = ("fastrtps_", "fastdds_")
_LOCK = "_el"
_PORT = "_port"
_MAPS = Path("/proc/self/maps")


def used_segments() -> set[str]:
    """Return the names of the Fast DDS segments and ports that this process owns or sends to."""
    folder = f" {SHARED_MEMORY}/"
    names = (line.partition(folder)[2] for line in _MAPS.read_text().splitlines())
    return {name for name in names if name.startswith(_PREFIXES)}


def note_segments() -> None:
    """Write down what this process uses, so that others can remove it if it is killed."""
    folder = _notes()
    folder.mkdir(mode=0o700, exist_ok=True)
    content = {"start": _start_time(os.getpid()), "segments": sorted(used_segments())}
    temporary = folder / f"{os.getpid()}.new"
    temporary.write_text(json.dumps(content))
    temporary.replace(folder / f"{os.getpid()}.json")


@contextlib.contextmanager
def cleared_segments() -> Iterator[None]:
    """Within, DDS is shut down; afterwards what this process used and nobody owns is removed.

    Fast DDS leaves a port behind when sender and owner end at the same time, or one was killed.
    """
    used = used_segments()
    yield
    (_notes() / f"{os.getpid()}.json").unlink(missing_ok=True)
    _remove_unowned(used)


def sweep() -> list[str]:
    """Remove what dead processes of ours left in shared memory; return the files removed."""
    orphans: set[str] = set()
    for note in sorted(_notes().glob("*.json")):
        try:
            content = json.loads(note.read_text())
        except (OSError, ValueError):
            continue
        if _start_time(int(note.stem)) != content["start"]:
            orphans.update(content["segments"])
            note.unlink(missing_ok=True)
    return _remove_unowned(orphans)


def _remove_unowned(names: set[str]) -> list[str]:
    return [file for name in sorted(names) for file in _remove(name)]


def _remove(name: str) -> list[str]:
    """Remove one segment or port and its mutex, holding its lock meanwhile.

    Whoever wants to open it in that moment fails to lock it and takes another. The empty lock
    file of a port stays, because ports are used again: a process that has opened it already would
    hold a lock that nobody else sees, and the port would be taken from it.
    """
    lock = SHARED_MEMORY / f"{name}{_LOCK}"
    files = [SHARED_MEMORY / name, SHARED_MEMORY / f"sem.{name}_mutex"]
    if not any(file.exists() for file in files):
        return []
    if _PORT not in name:
        files.append(lock)
    removed = []
    with contextlib.suppress(OSError), lock.open("ab") as handle:  # locked, or another user's
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        for file in files:
            if file.exists():
                file.unlink(missing_ok=True)
                removed.append(file.name)
    return removed


def _notes() -> Path:
    return Path(tempfile.gettempdir()) / f"cacc_platoon-{os.getuid()}"


def _start_time(pid: int) -> str:
    """Return when a process began, in clock ticks; empty when it is gone or a zombie."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ""
    return "" if fields[0] == "Z" else fields[19]
