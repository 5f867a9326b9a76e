"""Fast DDS files in /dev/shm: which are ours, and removing those of the dead.

A process owns a segment or port for as long as it holds its lock file `<name>_el` open. Every
host notes what it uses in a file below the temporary folder. A process that was killed leaves
its note behind, and the segments it owned or sent to; the next process of ours removes them, by
name, and only what no living process owns.
"""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")
_PREFIXES = ("fastrtps_", "fastdds_")
_LOCK = "_el"


def owned_segments(pid: int | str) -> set[str]:
    """Return the names of the Fast DDS segments and ports that a process owns."""
    names = set()
    with contextlib.suppress(OSError):
        for link in Path(f"/proc/{pid}/fd").iterdir():
            with contextlib.suppress(OSError):
                names.add(str(link.readlink()))
    return _segments(names)


def used_segments(pid: int | str) -> set[str]:
    """Return the names of those that a process owns or has mapped, which is where it sends to."""
    names = set()
    with contextlib.suppress(OSError):
        maps = Path(f"/proc/{pid}/maps").read_text()
        names = {line.split(maxsplit=5)[-1] for line in maps.splitlines()}
    return owned_segments(pid) | _segments(names)


def _segments(paths: set[str]) -> set[str]:
    return {
        path.name.removesuffix(_LOCK)
        for path in map(Path, paths)
        if path.parent == SHARED_MEMORY and path.name.startswith(_PREFIXES)
    }


def note_segments() -> None:
    """Write down what this process uses, so that others can remove it if it is killed."""
    folder = _notes()
    folder.mkdir(mode=0o700, exist_ok=True)
    content = {"start": _start_time(os.getpid()), "segments": sorted(used_segments(os.getpid()))}
    temporary = folder / f"{os.getpid()}.new"
    temporary.write_text(json.dumps(content))
    temporary.replace(folder / f"{os.getpid()}.json")


@contextlib.contextmanager
def cleared_segments() -> Iterator[None]:
    """Within, DDS is shut down; afterwards what this process used and nobody owns is removed.

    Fast DDS leaves a port behind when sender and owner end at the same time, or one was killed.
    """
    used = used_segments(os.getpid())
    yield
    (_notes() / f"{os.getpid()}.json").unlink(missing_ok=True)
    remove_unowned(used)


def sweep() -> list[str]:
    """Remove what dead processes of ours left in shared memory; return the names removed."""
    orphans: set[str] = set()
    for note in sorted(_notes().glob("*.json")):
        try:
            content = json.loads(note.read_text())
        except (OSError, ValueError):
            continue
        if _start_time(int(note.stem)) != content["start"]:
            orphans.update(content["segments"])
            note.unlink(missing_ok=True)
    return remove_unowned(orphans)


def remove_unowned(names: set[str]) -> list[str]:
    """Remove those segments and ports that no living process owns; return the files removed."""
    if not names:
        return []
    owned = set().union(*(owned_segments(p.name) for p in Path("/proc").glob("[0-9]*")))
    removed: list[str] = []
    for name in sorted(names - owned):
        for member in (name, f"{name}{_LOCK}", f"sem.{name}_mutex"):
            file = SHARED_MEMORY / member
            if file.exists():
                file.unlink(missing_ok=True)
                removed.append(member)
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
