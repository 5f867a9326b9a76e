"""A folder of our own: what processes of ours leave for each other, closed to everybody else.

It is in the user's runtime folder where there is one, otherwise in the user's cache. A run needs
it only to remove what a killed process has left; without it, everything else works.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pwd
import re
import stat
from collections.abc import Iterator
from pathlib import Path

NAME = "cacc_platoon"
BOOT = Path("/proc/sys/kernel/random/boot_id")
PROCESSES = Path("/proc/self/ns/pid")
_NAME = re.compile(r"[0-9a-f]{8}-(?P<pid>[0-9]{1,9})-(?P<start>[0-9]+)")


class UnusableFolderError(Exception):
    """A folder that cannot be ours, and why."""


def own_folders() -> list[Path]:
    """Return the folders of ours that are usable, the one to write in first; perhaps none."""
    found = []
    for folder in _candidates():
        with contextlib.suppress(UnusableFolderError):
            found.append(_usable(folder))
    return found


def unusable_folder() -> str:
    """Return why there is no folder of our own, in one line; empty when there is one."""
    if own_folders():
        return ""
    reasons = []
    for folder in _candidates():
        try:
            _usable(folder)
        except UnusableFolderError as error:
            reasons.append(f"{folder}: {error}")
    return (
        f"{'; '.join(reasons) or 'neither XDG_RUNTIME_DIR nor XDG_CACHE_HOME nor HOME is set'}: "
        "what a killed process leaves in shared memory will not be removed. Remove or repair the "
        "folder, or set XDG_CACHE_HOME to a folder of yours."
    )


def process_folder() -> Path | None:
    """Return where this process leaves things, which need not exist; None for nowhere."""
    folders, pid = own_folders(), os.getpid()
    return folders[0] / f"{_place()}-{pid}-{_start_time(pid)}" if folders else None


def folders_of_the_dead() -> Iterator[Path]:
    """Yield where processes of this machine that live no longer have left something."""
    for folder in own_folders():
        for path in sorted(folder.glob(f"{_place()}-*")):
            name = _NAME.fullmatch(path.name)
            folders = name and path.is_dir() and not path.is_symlink()
            if name and folders and _start_time(int(name["pid"])) != name["start"]:
                yield path


def _candidates() -> list[Path]:
    """Return where the folder may be: what the environment says, then the home on record."""
    cache = Path(os.environ.get("XDG_CACHE_HOME", ""))
    home = Path(os.environ.get("HOME", ""))
    bases = [
        Path(os.environ.get("XDG_RUNTIME_DIR", "")),
        cache if cache.is_absolute() else home / ".cache",
    ]
    with contextlib.suppress(KeyError):  # a user without an entry, as in containers
        bases.append(Path(pwd.getpwuid(os.getuid()).pw_dir) / ".cache")
    return [base / NAME for base in dict.fromkeys(bases) if base.is_absolute()]


def _usable(folder: Path) -> Path:
    """Return a folder, made if need be, that is a folder, ours and closed to others.

    Raises
    ------
    UnusableFolderError
        When it is not; sudo, for instance, can leave HOME at that of another user.
    """
    try:
        above = next(parent for parent in folder.parents if parent.exists())
        if above.stat().st_uid != os.getuid():
            raise UnusableFolderError(f"{above} belongs to another user")
        if above != folder.parent:
            folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        found = folder.lstat()
    except OSError as error:
        raise UnusableFolderError(f"cannot be used ({error.strerror})") from error
    if not stat.S_ISDIR(found.st_mode):
        raise UnusableFolderError("is no folder")
    if found.st_uid != os.getuid():
        raise UnusableFolderError("belongs to another user")
    if found.st_mode & 0o077:
        raise UnusableFolderError(f"is open to others (mode {stat.S_IMODE(found.st_mode):o})")
    return folder


def _place() -> str:
    """Return what tells the processes and the shared memory of this machine from those of others.

    A home may be shared by machines and containers, and process ids begin anew with each boot.
    """
    parts = [BOOT.read_text().strip(), str(Path("/dev").stat().st_dev), str(PROCESSES.readlink())]
    with contextlib.suppress(OSError):
        parts.append(str(Path("/dev/shm").stat().st_dev))
    return hashlib.sha256(" ".join(parts).encode()).hexdigest()[:8]


def _start_time(pid: int) -> str:
    """Return when a process began, in clock ticks; empty when it is gone or a zombie."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ""
    return "" if fields[0] == "Z" else fields[19]
