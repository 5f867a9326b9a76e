"""The name of a platoon in a domain, held by one process of this user on this machine.

The graph shows other supervisors too, wherever they are, but late on a busy machine, and two that
start at once do not see each other. A lock decides at once, and goes with the process.
"""

from __future__ import annotations

import errno
import hashlib
import os
import socket
import struct
from collections.abc import Mapping

_APART = ("ROS_DOMAIN_ID", "ROS_DISCOVERY_SERVER")
"""Processes with other values of these do not find each other."""
_CREDENTIALS = struct.Struct("iII")
_QUEUE = 128


class PlatoonLock:
    """Holds the name of a platoon until the process ends or the lock is dropped.

    It is held by the name of a socket that lives as long as the process, in the network namespace,
    which is where a domain is.

    Parameters
    ----------
    prefix : str
        The platoon's namespace.
    environment : mapping of str to str
        Which domain it is in.
    """

    def __init__(self, prefix: str, environment: Mapping[str, str]) -> None:
        key = "\n".join([prefix, *(environment.get(name, "").strip() or "0" for name in _APART)])
        digest = hashlib.sha256(key.encode(errors="replace")).hexdigest()[:32]
        self._name = f"\0cacc_platoon-{os.getuid()}-platoon-{digest}"
        self._socket: socket.socket | None = None

    def taken_by(self) -> str:
        """Take the name, or say which process has it; empty once it is held here.

        What another user holds does not count: then the graph alone has to tell.
        """
        if self._socket:
            return ""
        own = _socket()
        try:
            own.bind(self._name)
            own.listen(_QUEUE)
        except OSError as error:
            own.close()
            return self._holder() if error.errno == errno.EADDRINUSE else ""
        self._socket = own
        return ""

    def drop(self) -> None:
        """Let others have the name."""
        if self._socket:
            self._socket.close()
            self._socket = None

    def _holder(self) -> str:
        """Say which process of this user holds the name; empty when none does."""
        with _socket() as asking:
            try:
                asking.connect(self._name)
            except BlockingIOError:
                return "another process of this machine runs it"
            except OSError:
                return ""  # it has just ended
            credentials = asking.getsockopt(
                socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size
            )
        pid, user, _ = _CREDENTIALS.unpack(credentials)
        return f"process {pid} of this machine runs it" if user == os.getuid() else ""


def _socket() -> socket.socket:
    made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    made.setblocking(False)
    return made
