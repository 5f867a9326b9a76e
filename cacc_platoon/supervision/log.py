"""The one log of a run: a file for each process, and standard error when asked for.

Nodes that were started manually have no run folder; they log through ROS.
"""

from __future__ import annotations

import contextlib
import logging
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

LOG = logging.getLogger("cacc_platoon")
LOG.addHandler(logging.NullHandler())

_FORMAT = "%(asctime)s.%(msecs)03d %(processName)s: %(message)s"


class _QuietFile(logging.FileHandler):
    """A file that nobody misses when the disk is full: the run says so in its own words."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802  (of logging)
        """Go on without the line."""


class _Forwarding(logging.Handler):
    def __init__(self, write: Callable[[str], object]) -> None:
        super().__init__()
        self._write = write

    def emit(self, record: logging.LogRecord) -> None:
        self._write(record.getMessage())


@contextlib.contextmanager
def logging_to(path: Path) -> Iterator[None]:
    """Within, what is logged is appended to a file too; without one, if it cannot be opened."""
    handler: logging.Handler = logging.NullHandler()
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        handler = _QuietFile(path, encoding="utf-8", errors="replace")
    _add(handler)
    try:
        yield
    finally:
        LOG.removeHandler(handler)
        with contextlib.suppress(OSError):
            handler.close()


def forward_log(write: Callable[[str], object]) -> None:
    """From now on, every message that is logged is given to a function, too."""
    _add(_Forwarding(write))


def log_to_stderr() -> None:
    """From now on, what is logged is shown on standard error too."""
    if not logs_to_stderr():
        _add(logging.StreamHandler(sys.stderr))


def logs_to_stderr() -> bool:
    """Return whether what is logged is shown on standard error."""
    return any(type(handler) is logging.StreamHandler for handler in LOG.handlers)


def _add(handler: logging.Handler) -> None:
    handler.setFormatter(logging.Formatter(_FORMAT, datefmt="%H:%M:%S"))
    LOG.addHandler(handler)
    LOG.setLevel(logging.INFO)
