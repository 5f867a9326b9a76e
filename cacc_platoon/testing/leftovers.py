"""What platoons that have ended may have left behind; the tests' own look at shared memory."""

from __future__ import annotations

import contextlib
import fcntl
import time
from collections.abc import Collection

from cacc_platoon.dds.shared_memory import MATURE, SHARED_MEMORY, in_use


def unowned_files(known: Collection[str] = ()) -> set[str]:
    """Return the segments and ports of Fast DDS, whoever made them, that no process has locked.

    To look, each is locked for a moment, in which nobody else can open it; not those that are
    `known`, nor those that a process has in its memory. What has just been made is returned
    unseen: whoever starts has not locked it yet. Look again.
    """
    names = {
        file.name
        for file in SHARED_MEMORY.iterdir()
        if file.name.startswith(("fastrtps_", "fastdds_"))
    }
    found, passed_over = set(), {*known, *in_use()}
    for name in names:
        if {name, name.removesuffix("_el")} & passed_over:
            continue
        if name.endswith("_el") and ("_port" in name or name.removesuffix("_el") in names):
            continue
        lock = SHARED_MEMORY / f"{name}_el"
        with contextlib.suppress(OSError):
            young = time.time() - (SHARED_MEMORY / name).stat().st_mtime < MATURE
            if lock.exists() and not young:
                with lock.open("ab") as handle:
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            found.add(name)
    return found
