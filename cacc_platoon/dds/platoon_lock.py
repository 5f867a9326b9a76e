"""The name of a platoon in a domain, held by one process of this user on this machine.

The graph shows other supervisors too, wherever they are, but late on a busy machine, and two that
start at once do not see each other. A lock decides at once, and goes with the process.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import stat
import tempfile
from collections.abc import Mapping
from pathlib import Path

_NETWORK = Path("/proc/self/ns/net")
_APART = ("ROS_DOMAIN_ID", "ROS_DISCOVERY_SERVER")
"""Processes with other values of these do not find each other."""


class PlatoonLock:
    """Holds the name of a platoon until the process ends or the lock is dropped.

    Parameters
    ----------
    prefix : str
        The platoon's namespace.
    environment : mapping of str to str
        Which domain it is in.
    """

    def __init__(self, prefix: str, environment: Mapping[str, str]) -> None:
        network = _NETWORK.stat().st_ino if _NETWORK.exists() else 0
        domain = [environment.get(name) or "0" for name in _APART]
        key = "\n".join([prefix, str(network), *domain])
        self._name = f"platoon-{hashlib.sha256(key.encode(errors='replace')).hexdigest()[:32]}"
        self._file = -1

    def taken_by(self) -> str:
        """Take the name, or say which process has it; empty once it is held here.

        Where the lock cannot be had for other reasons, the graph alone has to tell.
        """
        if self._file >= 0:
            return ""
        with contextlib.suppress(OSError):
            flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
            file = os.open(_folder() / self._name, flags, 0o600)
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                holder = os.read(file, 20).decode(errors="replace").strip()
                os.close(file)
                return (
                    f"process {holder} of this machine runs it"
                    if holder
                    else "another process runs it"
                )
            os.ftruncate(file, 0)
            os.write(file, f"{os.getpid()}\n".encode())
            self._file = file
        return ""

    def drop(self) -> None:
        """Let others have the name."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1


def _folder() -> Path:
    """Return the folder of the locks, which is this user's alone, or raise OSError."""
    folder = Path(tempfile.gettempdir()) / f"cacc_platoon-domains-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o022:
        raise PermissionError(f"{folder} is not this user's alone")
    return folder
