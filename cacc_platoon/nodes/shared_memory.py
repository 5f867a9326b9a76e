"""Fast DDS segments in /dev/shm: which are ours, and removing those of the dead.

Every host notes the segments it has mapped in a file of its own below the temporary folder. A
process that was killed leaves segments and note behind; the next one of ours removes both, by
name, and only where no living process maps them.
"""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")
_PREFIXES = ("fastrtps_", "sem.fastrtps_", "fastdds_", "sem.fastdds_")


def mapped_segments(pid: int | str) -> set[str]:
    """Return the names of the Fast DDS segments that a process has mapped."""
    try:
        maps = Path(f"/proc/{pid}/maps").read_text()
    except OSError:
        return set()
    names = (line.rpartition(f"{SHARED_MEMORY}/")[2] for line in maps.splitlines())
    return {name.removesuffix(" (deleted)") for name in names if name.startswith(_PREFIXES)}


def note_segments() -> None:
    """Write down the segments of this process, so that others can remove them if it is killed."""
    folder = _notes()
    folder.mkdir(mode=0o700, exist_ok=True)
    segments = sorted(mapped_segments(os.getpid()))
    temporary = folder / f"{os.getpid()}.new"
    temporary.write_text(json.dumps({"start": _start_time(os.getpid()), "segments": segments}))
    temporary.replace(folder / f"{os.getpid()}.json")


def forget_segments() -> None:
    """Remove the note of this process, which is about to end in good order."""
    (_notes() / f"{os.getpid()}.json").unlink(missing_ok=True)


def sweep() -> list[str]:
    """Remove what dead processes of ours left in shared memory; return the names removed."""
    removed: list[str] = []
    orphans: set[str] = set()
    for note in sorted(_notes().glob("*.json")):
        try:
            content = json.loads(note.read_text())
        except (OSError, ValueError):
            continue
        if _start_time(int(note.stem)) == content["start"]:
            continue
        orphans.update(content["segments"])
        note.unlink(missing_ok=True)
    if orphans:
        living = set().union(*(mapped_segments(p.name) for p in Path("/proc").glob("[0-9]*")))
        for name in sorted(orphans - living):
            for file in (SHARED_MEMORY / name, SHARED_MEMORY / f"sem.{name}_mutex"):
                if file.exists():
                    file.unlink(missing_ok=True)
                    removed.append(file.name)
    return removed


def _notes() -> Path:
    return Path(tempfile.gettempdir()) / f"cacc_platoon-{os.getuid()}"


def _start_time(pid: int) -> str:
    """Return when a process began, in clock ticks; empty when it is gone."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return ""
    return stat.rpartition(")")[2].split()[19]
