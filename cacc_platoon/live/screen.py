"""Lines of a terminal that are drawn again in their place, and anything else above them."""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Callable, Mapping, Sequence
from typing import TextIO

USUAL = os.terminal_size((80, 24))


class Screen:
    """Draws lines in place of those that it has drawn before.

    The cursor stays below them and stays to be seen: whatever ends the process leaves the terminal
    as it was.

    Parameters
    ----------
    stream : file
        The terminal.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._lines, self._drawn_at = 0, USUAL

    @property
    def size(self) -> os.terminal_size:
        """Columns and lines of the terminal, as it is now; usual ones where it does not say."""
        try:
            size = os.get_terminal_size(self._stream.fileno())
        except (OSError, ValueError):
            return USUAL
        return size if size.columns and size.lines else USUAL

    def draw(self, lines: Sequence[str]) -> None:
        """Draw lines in place of those before."""
        size = self.size
        if size.columns < self._drawn_at.columns:  # those before are wrapped now
            self._lines = 0
        text = self._up() + "".join(f"\033[2K{line}\n" for line in lines) + "\033[J"
        self._lines, self._drawn_at = len(lines), size
        self._write(text)

    def clear(self) -> None:
        """Remove what was drawn."""
        if self._lines:
            self._write(f"{self._up()}\033[J")
            self._lines = 0

    def _up(self) -> str:
        return f"\r\033[{self._lines}A" if self._lines else "\r"

    def _write(self, text: str) -> None:
        encoding = getattr(self._stream, "encoding", None) or "ascii"
        shown = text.encode(encoding, "backslashreplace").decode(encoding)
        with contextlib.suppress(OSError):  # the terminal may be gone
            self._stream.write(shown)
            self._stream.flush()


class Above(io.TextIOBase):
    """A stream whose texts come above what a screen shows.

    Parameters
    ----------
    clear : callable
        Called before anything is written; whoever draws on the screen draws again below.
    stream : file
        Where texts go.
    """

    def __init__(self, clear: Callable[[], None], stream: TextIO) -> None:
        self._clear, self._stream = clear, stream

    def write(self, text: str) -> int:
        """Write a text."""
        self._clear()
        return self._stream.write(text)

    def flush(self) -> None:
        """Hand everything to the stream."""
        self._stream.flush()

    def fileno(self) -> int:
        """Return the descriptor of the stream."""
        return self._stream.fileno()

    def isatty(self) -> bool:
        """Whether the stream is a terminal."""
        return self._stream.isatty()


def coloured(environment: Mapping[str, str]) -> bool:
    """Whether a terminal is to show colours (https://no-color.org)."""
    return not environment.get("NO_COLOR") and environment.get("TERM") != "dumb"


def is_screen(stream: TextIO, environment: Mapping[str, str]) -> bool:
    """Whether lines of a stream can be drawn again in their place."""
    return stream.isatty() and environment.get("TERM") != "dumb"
