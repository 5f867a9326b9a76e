"""Fast DDS files in /dev/shm: which are ours, and removing those of the dead.

A living process keeps the file `<name>_el` of each segment and port that it owns locked. Every
process of ours notes what it uses in our own folder. One that was killed leaves its note behind,
and the segments it owned or sent to; the next process of ours removes them, by name, and only
what belongs to this user and no living process has locked.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import json
import logging
import os
import re
import shutil
import stat
import tempfile
import time
from collections.abc import Iterable, Iterator
from multiprocessing.util import Finalize
from pathlib import Path
from typing import NamedTuple

from cacc_platoon.dds.own_folder import folders_of_the_dead, process_folder

SHARED_MEMORY = Path("/dev/shm")
NEEDED = 32 * 2**20
"""Free memory for 32 participants, of 0.65 MB each: a segment and two ports."""
STARTING = 10.0
"""How long a process may create segments that it has not noted [s]."""
MATURE = 1.0
"""At this age a segment is mapped and locked by whoever makes it, if that lives [s]."""

_FILE = re.compile(r"(?:fastrtps|fastdds)_(?:[0-9a-f]{16}|port[0-9]{1,5})")
_LOCK = "_el"
_PORT = "_port"
_NOTE = "note.json"
_LONGEST_NOTE = 2**20
_LONGEST_SOCKET = 107 - len("/pymp-12345678/sock-12345678")
_AFTER_THEIRS = -200  # multiprocessing removes its own at -100 and complains if they are gone
_LOG = logging.getLogger("cacc_platoon.dds")


class Note(NamedTuple):
    """What a process has left word of.

    Attributes
    ----------
    segments : tuple of str
        What it uses.
    since : float, optional
        When it began to make segments that it has not noted yet, as a Unix time.
    """

    segments: tuple[str, ...] = ()
    since: float | None = None


class Swept(NamedTuple):
    """The files removed from shared memory, and a line for each note that was no good."""

    removed: list[str]
    broken: list[str]


def free_memory() -> int | None:
    """Return how much is free in shared memory [bytes]; None when it cannot be used."""
    if not os.access(SHARED_MEMORY, os.W_OK | os.X_OK):
        return None
    state = os.statvfs(SHARED_MEMORY)
    return state.f_bavail * state.f_frsize


def used_segments(pid: int | str = "self") -> set[str]:
    """Return the names of the Fast DDS segments and ports that a process owns or sends to."""
    folder = f" {SHARED_MEMORY}/"
    names = (
        line.partition(folder)[2] for line in Path(f"/proc/{pid}/maps").read_text().split("\n")
    )
    return {name for name in names if _FILE.fullmatch(name)}


def removed_ports() -> set[str]:
    """Return the names of the Fast DDS ports in use here that are no longer in /dev/shm."""
    lines = Path("/proc/self/maps").read_text().splitlines()
    gone = " (deleted)"
    names = (
        line.removesuffix(gone).rpartition(f" {SHARED_MEMORY}/")[2]
        for line in lines
        if line.endswith(gone)
    )
    return {name for name in names if _PORT in name and _FILE.fullmatch(name)}


def note_start() -> None:
    """Write down that this process begins to use shared memory; to be called before DDS starts."""
    _write(Note(since=time.time()))


def note_segments() -> None:
    """Write down what this process uses, so that others can remove it if it is killed."""
    _write(Note(tuple(sorted(used_segments()))))


@contextlib.contextmanager
def cleared_segments() -> Iterator[None]:
    """Within, DDS is shut down; afterwards what this process used and nobody owns is removed.

    Fast DDS leaves a port behind when sender and owner end at the same time, or one was killed.
    """
    used = used_segments()
    yield
    if folder := process_folder():
        with contextlib.suppress(OSError):
            (folder / _NOTE).unlink(missing_ok=True)
            folder.rmdir()
    _remove_unowned(used)


@contextlib.contextmanager
def own_temporary_files() -> Iterator[None]:
    """Within, temporary files of this process are where a sweep finds them if it is killed."""
    folder = process_folder()
    if folder and len(os.fsencode(folder)) <= _LONGEST_SOCKET:
        with contextlib.suppress(OSError):
            folder.mkdir(mode=0o700, exist_ok=True)
            remove = functools.partial(shutil.rmtree, ignore_errors=True)
            Finalize(None, remove, (folder,), exitpriority=_AFTER_THEIRS)
            before, tempfile.tempdir = tempfile.tempdir, str(folder)
            try:
                yield
            finally:
                tempfile.tempdir = before
            return
    yield


def sweep() -> Swept:
    """Remove what dead processes of ours left in shared memory and in our own folder."""
    orphans: set[str] = set()
    broken: list[str] = []
    for folder in folders_of_the_dead():
        try:
            note = _read(folder / _NOTE)
            orphans.update(note.segments)
            orphans.update(_born(note.since) if note.since is not None else ())
        except FileNotFoundError:
            pass
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            broken.append(f"{folder / _NOTE}: {reason}; dropped")
            _LOG.warning("%s", broken[-1])
        shutil.rmtree(folder, ignore_errors=True)
    return Swept(_remove_unowned(orphans), broken)


def _write(note: Note) -> None:
    """Leave word, if there is a folder and if the word is a new one."""
    folder = process_folder()
    if folder is None:
        return
    text = json.dumps(note._asdict())
    with contextlib.suppress(OSError):  # a full disk must not end a run
        if (folder / _NOTE).is_file() and (folder / _NOTE).read_text() == text:
            return
        folder.mkdir(mode=0o700, exist_ok=True)
        (folder / "new").write_text(text)
        (folder / "new").replace(folder / _NOTE)


def _read(path: Path) -> Note:
    """Return a note; FileNotFoundError without one, ValueError or OSError when it is none."""
    with os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb") as file:
        found = os.fstat(file.fileno())
        if not stat.S_ISREG(found.st_mode) or found.st_uid != os.getuid():
            raise ValueError("is no file of this user")
        text = file.read(_LONGEST_NOTE + 1)
    if len(text) > _LONGEST_NOTE:
        raise ValueError(f"is longer than {_LONGEST_NOTE} bytes")
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError("is no JSON") from error
    match content:
        case {"segments": [*names], "since": None | float() as since}:
            for name in names:
                if not (isinstance(name, str) and _FILE.fullmatch(name)):
                    raise ValueError(f"names {str(name)[:80]!r}, which is no segment of Fast DDS")
            return Note(tuple(names), since)
    raise ValueError("is nothing that a process of ours writes")


def _born(since: float) -> set[str]:
    """Return what was made while a process that is dead started and that no living one uses.

    Nothing says which of it was its own. Whoever has made one of the others and lives has it in
    its memory, and that can be seen: of this user's processes, and others cannot make files of
    this user.
    """
    born = {file: made for file, made in _files() if since - 0.1 <= made <= since + STARTING}
    if not born:
        return set()
    time.sleep(max(0.0, min(MATURE, MATURE - (time.time() - max(born.values())))))
    return born.keys() - in_use()


def _files() -> Iterator[tuple[str, float]]:
    """Yield the segments and ports of this user, and when each was made."""
    for path in SHARED_MEMORY.iterdir():
        found = _own(path) if _FILE.fullmatch(path.name) else None
        if found:
            yield path.name, found.st_mtime


def in_use() -> set[str]:
    """Return what the living have in their memory, as far as we may see."""
    used: set[str] = set()
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            used |= used_segments(process.name)
    return used


def _own(path: Path) -> os.stat_result | None:
    """Return the state of a file of this user; None for what is none, a link above all."""
    with contextlib.suppress(OSError):
        found = path.lstat()
        if stat.S_ISREG(found.st_mode) and found.st_uid == os.getuid():
            return found
    return None


def _remove_unowned(names: Iterable[str]) -> list[str]:
    return [file for name in sorted(names) for file in _remove(name)]


def _remove(name: str) -> list[str]:
    """Remove one segment or port and its mutex, holding its lock meanwhile.

    Whoever wants to open it in that moment fails to lock it and takes another. The empty lock
    file of a port stays, because ports are used again: a process that has opened it already would
    hold a lock that nobody else sees, and the port would be taken from it.
    """
    lock = SHARED_MEMORY / f"{name}{_LOCK}"
    files = [SHARED_MEMORY / name, SHARED_MEMORY / f"sem.{name}_mutex"]
    if not any(map(_own, files)):
        return []
    if _PORT not in name:
        files.append(lock)
    removed = []
    with contextlib.suppress(OSError):  # locked, or another user's
        handle = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for file in filter(_own, files):
                file.unlink()
                removed.append(file.name)
        finally:
            os.close(handle)
    return removed
