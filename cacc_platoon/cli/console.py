"""Standard output belongs to the command's answer, standard error gets lines that can be shown."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Iterator
from typing import TextIO

from cacc_platoon.errors import one_line


def say(text: str) -> None:
    """Print one line on standard error, whatever is in the text, where there is one."""
    with contextlib.suppress(OSError):  # a closed terminal stops nothing
        print(f"platoon: {one_line(text)}", file=sys.stderr, flush=True)


def open_standard_streams() -> None:
    """Open what the caller has closed, so that no file of ours takes its place and is written to.

    What cannot be shown in the encoding of standard output is escaped.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = sys.stdout or _to_nowhere(1)
    sys.stderr = sys.stderr or _to_nowhere(2)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def _to_nowhere(descriptor: int) -> TextIO:
    return open(descriptor, "w", encoding="utf-8", closefd=False)


def give_up_output() -> None:
    """From now on, write standard output to nowhere: nobody takes it."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextlib.contextmanager
def answers_apart() -> Iterator[TextIO]:
    """Yield standard output; within, what libraries print there goes to standard error."""
    errors, encoding = "backslashreplace", sys.stdout.encoding
    sys.stdout.flush()
    answers = os.fdopen(os.dup(1), "w", encoding=encoding, errors=errors)
    with answers, libraries_on_stderr():
        try:
            yield answers
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), answers.fileno())
            raise


@contextlib.contextmanager
def libraries_on_stderr() -> Iterator[None]:
    """Within, what libraries and new processes print on standard output goes to standard error.

    Fast DDS complains on standard output, where it would spoil the one object of `--json`.
    """
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)
