"""What must not last for ever: the process that is still at it is ended, with the right exit code.

DDS may wait without end, in C++ and holding the interpreter's lock, for a mutex that a killed
process has taken with it. No Python code runs in any thread then. So the clock is one of the
operating system, and what it calls is `_exit` of the C library, in a thread of its own.
"""

from __future__ import annotations

import contextlib
import ctypes
import sys
import time
from collections.abc import Iterator

_SIGEV_THREAD = 2


class _Event(ctypes.Structure):
    """The struct sigevent of Linux, which is padded to 64 bytes."""

    _fields_ = (
        ("value", ctypes.c_void_p),
        ("signal", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("attributes", ctypes.c_void_p),
        ("padding", ctypes.c_byte * 32),
    )


class _Times(ctypes.Structure):
    """The struct itimerspec: interval and value, each in seconds and nanoseconds."""

    _fields_ = (
        ("interval", ctypes.c_long * 2),
        ("value", ctypes.c_long * 2),
    )


@contextlib.contextmanager
def time_limit(seconds: float, exit_code: int) -> Iterator[None]:
    """Within, the process has so many seconds; then it ends itself with an exit code.

    Parameters
    ----------
    seconds : float
        How long it may take.
    exit_code : int
        The exit code of the process when it takes longer.
    """
    library = ctypes.CDLL(None)
    exit_now = ctypes.cast(library._exit, ctypes.c_void_p)
    event = _Event(exit_code, 0, _SIGEV_THREAD, exit_now)
    timer = ctypes.c_void_p()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    if library.timer_create(time.CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
        raise OSError("there is no timer")
    whole = int(seconds)
    due = _Times((0, 0), (whole, int((seconds - whole) * 1e9)))
    library.timer_settime(timer, 0, ctypes.byref(due), None)
    try:
        yield
    finally:
        library.timer_delete(timer)
