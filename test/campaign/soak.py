"""A long run by clocks with a fault every few seconds: nothing grows, nothing is lost.

    python test/campaign/soak.py [--minutes 30] [--seed 1]

Hosts and the supervisor are frozen for a while, get signals that they ignore, and processes that
listen come and are killed. Meanwhile memory, descriptors, threads and shared memory of every
process are looked at once a second. At the end every topic has every sample, and every state is
what was recorded makes of it, to the last bit.
"""

from __future__ import annotations

import argparse
import contextlib
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import NamedTuple

from cacc_platoon.analysis import analyse
from cacc_platoon.campaign.witness import Witness, signal_to
from cacc_platoon.dds.shared_memory import sweep, used_segments
from cacc_platoon.testing import Platoon
from cacc_platoon.testing.leftovers import unowned_files

PAPER_A = Path(__file__).parents[2] / "config" / "paper_a.yaml"
SETTINGS = (
    *("run.sync=wall", "platoon.followers=3", "v2v.reception=fallback", "v2v.loss=0.05"),
    *("leader.angular_frequency=0.5", "run.stall_timeout=20"),
)
GROWTH = 0.05
"""By so much may the memory of a process grow after it has warmed up."""
WARM_UP = 70.0
"""Queues hold a minute: by then they are as full as they get [s]."""
PAUSES = (1.0, 4.0)
"""From fault to fault [s]."""
FREEZES = (0.1, 2.0)
"""How long a process is frozen [s]."""
LISTENER = """
import sys, rclpy
from std_msgs.msg import String
from geometry_msgs.msg import PoseStamped
from cacc_platoon.nodes import qos
rclpy.init()
node = rclpy.create_node("listener")
node.create_subscription(String, "/platoon/status", print, qos.latched())
node.create_subscription(PoseStamped, "/platoon/vehicle_1/pose", print, 10)
rclpy.spin(node)
"""


class Usage(NamedTuple):
    """What a process takes up.

    Attributes
    ----------
    memory : float
        Of its own [MB].
    descriptors, threads, segments : int
        Open files, threads, and files of Fast DDS in its memory.
    """

    memory: float
    descriptors: int
    threads: int
    segments: int

    @classmethod
    def of(cls, pid: int) -> Usage:
        """Return what a process takes up now."""
        process = Path(f"/proc/{pid}")
        rollup = (process / "smaps_rollup").read_text().splitlines()
        own = sum(int(line.split()[1]) for line in rollup if line.startswith("Private_"))
        threads, descriptors = (len([*(process / name).iterdir()]) for name in ("task", "fd"))
        return cls(own / 1024, descriptors, threads, len(used_segments(pid)))


class Soak:
    """One long run, its faults, and what its processes took up meanwhile.

    Parameters
    ----------
    run : Platoon
        The platoon, already started.
    draw : random.Random
        Draws the faults.
    """

    def __init__(self, run: Platoon, draw: random.Random) -> None:
        self.run, self._draw = run, draw
        self.witness = Witness(run)
        self.used: dict[int, list[tuple[float, Usage]]] = {}
        self.faults: dict[str, int] = {}
        self._began = time.monotonic()
        self._listeners: list[subprocess.Popen[bytes]] = []

    def go(self) -> None:
        """Let faults happen until the run is over."""
        self.run.wait_sample(0, 60.0)
        self._began = time.monotonic()
        deeds: tuple[Callable[[], None], ...] = (
            *(self._freeze, self._freeze, self._freeze),
            *(self._ignored, self._listen, self._listen),
        )
        while not self.witness.over:
            self._pass(self._draw.uniform(*PAUSES))
            deed = self._draw.choice(deeds)
            deed()
            self.faults[deed.__name__.strip("_")] = self.faults.get(deed.__name__.strip("_"), 0) + 1
        self._end_listener(signal.SIGINT)  # with nobody left to clear up after it

    def _end_listener(self, number: signal.Signals) -> None:
        for listener in self._listeners:
            listener.send_signal(number)
            listener.wait()

    def _pass(self, seconds: float) -> None:
        """Let time pass, and look at the processes once a second."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not self.witness.over:
            for pid in (self.run.pid("supervisor"), *self.witness.hosts()):
                with contextlib.suppress(OSError):
                    seen = (time.monotonic() - self._began, Usage.of(pid))
                    self.used.setdefault(pid, []).append(seen)
            self.witness.let_pass(min(1.0, max(0.0, end - time.monotonic())))

    def _freeze(self) -> None:
        pid = self._draw.choice([self.run.pid("supervisor"), *self.witness.hosts()])
        signal_to(pid, signal.SIGSTOP)
        try:
            self._pass(self._draw.uniform(*FREEZES))
        finally:
            signal_to(pid, signal.SIGCONT)

    def _ignored(self) -> None:
        if hosts := self.witness.hosts():
            signal_to(self._draw.choice(hosts), signal.SIGINT)

    def _listen(self) -> None:
        """Let a process come that listens, and kill the one before."""
        self._end_listener(signal.SIGKILL)
        command = [sys.executable, "-c", LISTENER]
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        environment = self.run.environment()
        self._listeners = [subprocess.Popen(command, env=environment, **silent)]


def grown(used: list[tuple[float, Usage]], warm_up: float) -> tuple[Usage, Usage]:
    """Return what a process took up once warm, in the first and in the last third: medians."""
    warm = [usage for at, usage in used if at >= warm_up]
    third = max(1, len(warm) // 3)
    first, last = (
        Usage(*(median(column) for column in zip(*part, strict=True)))
        for part in (warm[:third], warm[-third:])
    )
    return first, last


def growth(first: Usage, last: Usage) -> list[str]:
    """Return what grew that has to stay."""
    found = []
    if last.memory > first.memory * (1.0 + GROWTH):
        found.append(f"memory grew by {100 * (last.memory / first.memory - 1):.1f} %")
    for name in ("descriptors", "threads", "segments"):
        if (now := getattr(last, name)) > (before := getattr(first, name)):
            found.append(f"{name} grew from {before:g} to {now:g}")
    return found


def judged(run: Platoon) -> list[str]:
    """Return what is wrong with the run itself."""
    result = run.result(300.0)
    if (result.exit_code, result.status) != (0, "finished"):
        return [f"{result.status} with exit code {result.exit_code}: {result.message}"]
    report = analyse(run.folder.path)
    found = [] if report.standing.state == "intact" else [f"the data: {report.standing.state}"]
    if report.consistency.largest or report.recomputed.links.largest:
        found.append("a state is not what was recorded makes of it")
    samples = len(report.run.trajectory.position)
    if samples != run.scenario.samples:
        found.append(f"{samples} of {run.scenario.samples} samples")
    if "Traceback" in result.errors + result.output:
        found.append(f"a traceback: {result.errors[-600:]}")
    if report.measured.first_collision is not None:
        found.append("vehicles collided")
    return found


def soak(minutes: float, seed: int, hosts: int | str, warm_up: float = WARM_UP) -> list[str]:
    """Run a soak, print what it took up, and return what did not hold."""
    before = unowned_files()
    found = []
    with tempfile.TemporaryDirectory(prefix="soak_") as folder:
        base = Path(folder)
        (base / "tmp").mkdir()
        duration = f"run.duration={60 * minutes:g}"
        environment = {"TMPDIR": str(base / "tmp"), "ROS_LOG_DIR": str(base / "log")}
        run = Platoon(
            PAPER_A,
            settings=(*SETTINGS, duration),
            hosts=hosts,
            folder=base,
            environment=environment,
        )
        with run:
            one = Soak(run, random.Random(seed))
            one.go()
            found += judged(run)
            run.wait_gone(30.0)
            print(f"{minutes:g} min, faults: {one.faults}", flush=True)
            for pid, used in one.used.items():
                first, last = grown(used, warm_up)
                grew = growth(first, last)
                print(f"process {pid}: {_told(first)} -> {_told(last)} {'; '.join(grew) or 'ok'}")
                found += [f"process {pid}: {line}" for line in grew]
        found += [f"{path.name} was left behind" for path in (base / "tmp").iterdir()]
    deadline = time.monotonic() + 20.0
    while (left := one.witness.segments & unowned_files(before)) and time.monotonic() < deadline:
        sweep()
    return [*found, *(f"{name} was left behind" for name in sorted(left))]


def _told(usage: Usage) -> str:
    return (
        f"{usage.memory:.1f} MB, {usage.descriptors:g} descriptors, {usage.threads:g} threads, "
        f"{usage.segments:g} segments"
    )


def main() -> int:
    """Run a soak; exit with 1 when something did not hold."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--hosts", default="4")
    parser.add_argument("--warm-up", type=float, default=WARM_UP, help="not counted [s]")
    options = parser.parse_args()
    found = soak(options.minutes, options.seed, options.hosts, options.warm_up)
    for line in found:
        print("NOT", line)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
