"""How far something is: a line on a terminal, or a line in a log every few seconds."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any, Self, TextIO

_INTERVAL, _LOG_INTERVAL = 0.1, 3.0


class Progress:
    """Call it with what is being done, how far it is and how much there is.

    Used as a context it is cleared at the end.

    Parameters
    ----------
    step : float or None
        Simulated time of one unit of progress [s]; adds the real-time factor.
    interval : float
        Wall time from one line to the next, at least [s].
    shown : bool
        Whether it is shown at all.
    """

    def __init__(self, step: float | None, interval: float, *, shown: bool) -> None:
        self._step, self._interval, self._shown = step, interval, shown
        self._what, self._shown_at = "", 0.0
        self._began_at, self._began_with = 0.0, 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show `done` of `total`, unless that was shown a moment ago."""
        now = time.monotonic()
        if not self._shown:
            return
        if what != self._what:
            self._what, self._began_at, self._began_with = what, now, done
        elif now - self._shown_at < self._interval:
            return
        self._shown_at = now
        share = f"{100 * min(done, total) // total:3d} %" if total > 0 else f"{done}"
        self.show(f"{what} {share}{self._pace(done, total, now - self._began_at)}")

    def nodes(self) -> Sequence[Any]:
        """Make the nodes that it needs in a process that runs a platoon."""
        return ()

    def show(self, text: str) -> None:
        """Show one line."""
        raise NotImplementedError

    def clear(self) -> None:
        """Remove what is shown, where it can be."""

    def _pace(self, done: int, total: int, elapsed: float) -> str:
        """Say how fast it goes and how long it still takes."""
        advanced = done - self._began_with
        if advanced <= 0 or elapsed <= 0.0:
            return ""
        rate = advanced / elapsed
        left = f", {max(0.0, (total - done) / rate):.0f} s left"
        if self._step is None:
            return left
        return f", sample {done} of {total}, real-time factor {rate * self._step:.1f}{left}"


class ProgressLine(Progress):
    """A line on a terminal, ten times a second at most; nothing where there is no terminal.

    Parameters
    ----------
    step : float, optional
        Simulated time of one unit of progress [s]; adds the real-time factor.
    stream : file, optional
        Where to show it, standard error by default.
    shown : bool, optional
        Whether to show it at all; not where a log scrolls by.
    """

    def __init__(
        self, step: float | None = None, stream: TextIO | None = None, *, shown: bool = True
    ) -> None:
        self._stream = stream or sys.stderr
        super().__init__(step, _INTERVAL, shown=shown and self._stream.isatty())

    def show(self, text: str) -> None:
        """Put the line in the place of the one before."""
        with contextlib.suppress(OSError):  # the terminal may be gone
            self._stream.write(f"\r\033[K{text}")
            self._stream.flush()

    def clear(self) -> None:
        """Remove the line."""
        if self._shown:
            self.show("")


class ProgressLog(Progress):
    """A message in a log every few seconds.

    Parameters
    ----------
    log : callable
        Logs a text.
    step, shown
        As of `Progress`.
    """

    def __init__(
        self, log: Callable[[str], object], step: float | None = None, *, shown: bool = True
    ) -> None:
        super().__init__(step, _LOG_INTERVAL, shown=shown)
        self._log = log

    def show(self, text: str) -> None:
        """Log the text."""
        self._log(text)
