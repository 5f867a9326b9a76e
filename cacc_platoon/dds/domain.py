"""A DDS domain that no other process on this machine uses."""

from __future__ import annotations

import contextlib
import fcntl
import os
import random
import tempfile
from collections.abc import Iterator
from pathlib import Path

DOMAINS = range(1, 101)


@contextlib.contextmanager
def own_domain() -> Iterator[int]:
    """Hold a domain that no other process of ours holds; RuntimeError if none is free."""
    folder = Path(tempfile.gettempdir()) / f"cacc_platoon-domains-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    candidates = list(DOMAINS)
    random.shuffle(candidates)
    for domain in candidates:
        with (folder / str(domain)).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    raise RuntimeError(f"all DDS domains from 1 to 100 are taken; see the locks in {folder}")
