"""A line on the terminal that says how far something is; nothing where there is no terminal."""

from __future__ import annotations

import contextlib
import sys
import time
from typing import TextIO

_INTERVAL = 0.1


class ProgressLine:
    """Call it with what is being done, how far it is and how much there is.

    Used as a context it is cleared at the end.

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
        self._step, self._stream = step, stream or sys.stderr
        self._live = shown and self._stream.isatty()
        self._what, self._shown_at = "", 0.0
        self._began_at, self._began_with = 0.0, 0

    def __enter__(self) -> ProgressLine:
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show `done` of `total`, at most ten times a second."""
        now = time.monotonic()
        if not self._live:
            return
        if what != self._what:
            self._what, self._began_at, self._began_with = what, now, done
        elif now - self._shown_at < _INTERVAL:
            return
        self._shown_at = now
        share = f"{100 * min(done, total) // total:3d} %" if total > 0 else f"{done}"
        self._draw(f"{what} {share}{self._pace(done, total, now - self._began_at)}")

    def clear(self) -> None:
        """Remove the line."""
        if self._live:
            self._draw("")

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

    def _draw(self, text: str) -> None:
        with contextlib.suppress(OSError):  # the terminal may be gone
            self._stream.write(f"\r\033[K{text}")
            self._stream.flush()
