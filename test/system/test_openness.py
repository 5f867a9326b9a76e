"""What docs/security.md says is not protected on one machine, so that nobody relies on it."""

from __future__ import annotations

import contextlib
import stat
from collections.abc import Callable

from std_msgs.msg import String

from cacc_platoon.dds.shared_memory import SHARED_MEMORY, used_segments
from cacc_platoon.nodes import qos
from cacc_platoon.testing import Platoon

SMALL = ("run.duration=60", "platoon.followers=2", "run.real_time_factor=10")

Start = Callable[..., Platoon]


def test_whoever_is_on_this_machine_may_join_listen_and_read_the_segments(platoon: Start) -> None:
    run = platoon(*SMALL, hosts=2)
    heard: list[str] = []
    run.subscribe(String, "/platoon/scenario", lambda m: heard.append(m.data), qos.latched())
    run.wait(lambda: bool(heard), 30.0, "the scenario")
    run.wait_sample(10)
    names: set[str] = set()
    for pid in run.living():
        with contextlib.suppress(OSError):
            names |= used_segments(pid)
    files = [SHARED_MEMORY / name for name in names if (SHARED_MEMORY / name).exists()]
    assert files
    modes = {stat.S_IMODE(file.stat().st_mode) for file in files}
    assert all(mode & stat.S_IROTH and not mode & stat.S_IWOTH for mode in modes), modes
    assert run.result().status == "finished"
