"""Faults at random moments of a platoon's life, and what must hold whatever they were.

    python test/campaign/faults.py [--seed 1] [--count 200] [--first 0]

Each fault is a real platoon, of which processes are killed, frozen or signalled, or to which a
foreign process speaks, at a random moment of its start, run, merge or report. Whatever it was:
the command ends within a time limit, with one of its documented exit codes and without a
traceback; no process lives on and nothing of it stays in shared memory or the temporary folder;
a folder that exists has a truthful run.json; what its bag holds equals the simulation to the last
bit, or the run says that somebody else had a hand in it; `platoon report` says so in a line.
"""

from __future__ import annotations

import argparse
import contextlib
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Vector3Stamped
from std_msgs.msg import Int64, String

from cacc_platoon.bags.raw import BagError
from cacc_platoon.dds.shared_memory import sweep
from cacc_platoon.runs.info import EndStatus, RunInfo
from cacc_platoon.runs.recorded_run import read_run
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import Trajectory, simulate
from cacc_platoon.testing import Platoon
from cacc_platoon.testing.leftovers import unowned_files
from msg_adapters.topics import PlatoonTopics, VehicleTopics

SCENARIOS = {
    "ideal": {"run.duration": 20.0, "platoon.followers": 3, "run.real_time_factor": 8.0},
    "lossy": {
        **{"run.duration": 20.0, "platoon.followers": 3, "run.real_time_factor": 8.0},
        **{"v2v.loss": 0.2},
    },
}
LIMIT = 60.0
"""How long anything may take to end [s]."""
EXIT_CODES = {0, 1, 2, 130, 143}
MOTION = ("position", "velocity", "acceleration")
PHASES = ("start", "run", "merge")
NODES = ("supervisor", "vehicle_0/leader", "vehicle_2/vehicle", "vehicle_3/noise_relay")


@dataclass(frozen=True)
class Fault:
    """One platoon and what happens to it.

    Attributes
    ----------
    number : int
        Which of the campaign.
    scenario : str
        Name in SCENARIOS.
    hosts : str
        run.hosts.
    phase : str
        When: one of PHASES.
    moment : float
        How far into the phase, 0 to 1.
    kind : str
        What: a key of KINDS.
    node : str
        To whom.
    """

    number: int
    scenario: str
    hosts: str
    phase: str
    moment: float
    kind: str
    node: str

    def __str__(self) -> str:
        """Return the fault as a line."""
        return (
            f"{self.number:4d} {self.scenario:5} hosts={self.hosts:8} "
            f"{self.phase:5} {self.moment:.2f} {self.kind:18} {self.node}"
        )


def _let_pass(run: Platoon, seconds: float) -> None:
    """Let some time pass; messages are received meanwhile."""
    end = time.monotonic() + seconds
    run.wait(lambda: time.monotonic() >= end, seconds + 1.0, f"{seconds:g} s")


def _topics(run: Platoon) -> PlatoonTopics:
    return PlatoonTopics(run.scenario.platoon.namespace)


def _signals(*numbers: signal.Signals) -> Callable[[Platoon, Fault], None]:
    """Return a fault that sends signals, the later ones 0.1 s after each other."""

    def act(run: Platoon, fault: Fault) -> None:
        for place, number in enumerate(numbers):
            if place:
                _let_pass(run, 0.1)
            with contextlib.suppress(ProcessLookupError, LookupError):
                run.kill(fault.node, number)

    return act


def _freeze(run: Platoon, fault: Fault) -> None:
    with contextlib.suppress(ProcessLookupError, LookupError):
        run.freeze(fault.node, 0.5)


def _forge_host_state(run: Platoon, fault: Fault) -> None:
    texts = (
        '{"run": "x", "state": "up"}',
        "[" * 100_000,
        '{"format": 1, "run": [], "host": "a b"}',
        '"closed"',
    )
    run.send(String(data=texts[fault.number % len(texts)]), _topics(run).host_state)


def _forge_status(run: Platoon, fault: Fault) -> None:
    texts = ('{"run": "x", "state": "up"}', "[" * 100_000, "{}", '{"format": 1, "phase": "failed"}')
    run.send(String(data=texts[fault.number % len(texts)]), _topics(run).status)


def _forge_recorded(run: Platoon, _fault: Fault) -> None:
    run.send(Int64(data=1500), _topics(run).recorded("0"))


def _forge_count(run: Platoon, _fault: Fault) -> None:
    message = Vector3Stamped()
    message.header.stamp.sec, message.vector.x = 5, 400.0
    run.send(message, VehicleTopics(run.scenario.platoon.namespace, 2).link(1).complete.name)


KINDS: dict[str, Callable[[Platoon, Fault], None]] = {
    "SIGKILL": _signals(signal.SIGKILL),
    "SIGTERM": _signals(signal.SIGTERM),
    "SIGINT": _signals(signal.SIGINT),
    "SIGINT twice": _signals(signal.SIGINT, signal.SIGINT),
    "SIGHUP": _signals(signal.SIGHUP),
    "freeze 0.5 s": _freeze,
    "forged host_state": _forge_host_state,
    "forged status": _forge_status,
    "forged recorded": _forge_recorded,
    "forged complete": _forge_count,
}
FORGED = tuple(kind for kind in KINDS if kind.startswith("forged"))


def faults(seed: int, first: int, count: int) -> Iterator[Fault]:
    """Yield the faults of a campaign; each depends on the seed and its number alone."""
    for number in range(first, first + count):
        draw = random.Random(f"{seed}.{number}")
        kind = draw.choice(list(KINDS))
        yield Fault(
            number,
            "lossy" if kind == "forged complete" else draw.choice(list(SCENARIOS)),
            draw.choice(["1", "2", "per_node"]),
            "run" if kind in FORGED else draw.choice(PHASES),
            draw.random(),
            kind,
            draw.choice(NODES),
        )


@cache
def truth(name: str) -> Trajectory:
    """Return what the platoon does when nothing happens to it."""
    return simulate(Scenario.from_values(SCENARIOS[name]))


def wrong(fault: Fault) -> list[str]:
    """Let a fault happen and return what does not hold; nothing when all is well."""
    before = unowned_files()
    with tempfile.TemporaryDirectory(prefix="campaign_") as folder:
        temporary = Path(folder, "tmp")
        temporary.mkdir()
        run = Platoon(
            Scenario.from_values(SCENARIOS[fault.scenario]),
            hosts=fault.hosts,
            folder=Path(folder),
            report=True,
            environment={"TMPDIR": str(temporary)},
        )
        with run:
            try:
                _reach(run, fault)
                KINDS[fault.kind](run, fault)
                result = run.result(timeout=LIMIT)
            except TimeoutError as error:
                return [str(error)]
            found = [*_ending(fault, result.exit_code, result.errors + result.output)]
            with contextlib.suppress(TimeoutError):
                run.wait_gone()
            if living := run.living():
                found.append(f"processes {living} live on")
            found += _folder(fault, run.folder.path)
            found += [f"{path.name} was left behind" for path in temporary.iterdir()]
        deadline = time.monotonic() + 5.0
        while (left := unowned_files(before)) and time.monotonic() < deadline:
            threading.Event().wait(0.1)
        if left:  # of the killed, which the next process of ours clears
            sweep()
            left = unowned_files(before)
    return [*found, *(f"{name} was left behind" for name in sorted(left))]


def _reach(run: Platoon, fault: Fault) -> None:
    """Wait until the moment of a fault has come."""
    if fault.phase == "start":
        _let_pass(run, 2.0 * fault.moment)
        return
    last = run.scenario.samples - 1
    if fault.phase == "run":
        run.wait_sample(int(fault.moment * (last - 200)), LIMIT)
    else:
        run.wait_state("finished", LIMIT)
        _let_pass(run, fault.moment)


def _ending(fault: Fault, code: int, text: str) -> Iterator[str]:
    """Say what is wrong with the end of the command; a signal may end it before it listens."""
    kind = fault.kind.split()[0]
    number = signal.Signals[kind] if kind in signal.Signals.__members__ else None
    own = {-number, 128 + number} if number and fault.node == "supervisor" else set()
    if code not in EXIT_CODES | own:
        yield f"exit code {code}"
    if "Traceback" in text:
        yield f"a traceback: {text[-600:]}"


def _folder(fault: Fault, folder: Path) -> Iterator[str]:
    """Say what is wrong with the run folder and with what is said of it."""
    if not folder.exists():
        return
    info = RunInfo.read(folder)
    if info is None:
        yield "there is a run folder without run.json"
    command = [sys.executable, "-m", "cacc_platoon", "report", str(folder)]
    report = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, check=False)
    if report.returncode not in (0, 1, 2) or "Traceback" in report.stderr:
        yield f"report ends with {report.returncode}: {report.stderr[-600:]}"
    info = RunInfo.read(folder)
    if not (folder / "bag").exists():
        if info and info.status is EndStatus.FINISHED:
            yield "finished without a bag"
        return
    yield from _data(fault, folder / "bag", info)


def _data(fault: Fault, bag: Path, info: RunInfo | None) -> Iterator[str]:
    """Say what is wrong with the data."""
    finished = info is not None and info.status is EndStatus.FINISHED
    try:
        recorded, expected = read_run(bag).trajectory, truth(fault.scenario)
    except BagError as error:  # it was stopped before the first sample
        if finished:
            yield f"finished, and {error}"
        return
    samples = len(recorded.position)
    same = all(_equal(getattr(recorded, name), getattr(expected, name)) for name in MOTION)
    if finished and (samples != expected.scenario.samples or not same):
        yield f"finished with {samples} samples, as simulated: {same}"
    if not same and fault.kind not in FORGED:
        yield f"the {samples} samples in the bag are not those of the simulation"
    if not same and "another publisher" not in (info.message if info else ""):
        yield f"wrong data and the message is {info and info.message!r}"


def _equal(recorded: npt.NDArray[np.float64], expected: npt.NDArray[np.float64]) -> bool:
    """Return whether all that was recorded is as expected; what was not is NaN."""
    there = np.isfinite(recorded)
    return bool((recorded == expected[: len(recorded)])[there].all())


def main() -> int:
    """Run a campaign; exit with 1 when something did not hold."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="number of the first fault")
    options = parser.parse_args()
    bad = 0
    for fault in faults(options.seed, options.first, options.count):
        found = wrong(fault)
        bad += bool(found)
        print(fault, "ok" if not found else "", flush=True)
        for line in found:
            print("     ", line, flush=True)
    print(f"{options.count} faults, {bad} with something wrong")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
