"""Standard output belongs to the command's answer."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator


def say(text: str) -> None:
    """Print a line on standard error, where there is one: a closed terminal stops nothing."""
    with contextlib.suppress(OSError):
        print(text, file=sys.stderr, flush=True)


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
