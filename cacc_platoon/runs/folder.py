"""The folder of a run: made at the start, filled while it runs, finished at the end."""

from __future__ import annotations

import contextlib
import dataclasses
import fcntl
import hashlib
import importlib.metadata
import math
import os
import platform
import shutil
import sys
import weakref
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from cacc_platoon import __version__
from cacc_platoon.bags.digest import run_digest
from cacc_platoon.bags.rows import Recording
from cacc_platoon.errors import UserError
from cacc_platoon.runs.events import bag_events, settle_events
from cacc_platoon.runs.info import EndStatus, RunInfo
from cacc_platoon.runs.parts import newest_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario, load_scenario
from msg_adapters.topics import Graph, PlatoonTopics, queue_depth

SCENARIO_FILE = "scenario.yaml"
BAG = "bag"
PARTS = "parts"
ENDED = "ended_parts"
"""Parts of hosts that were started again, which have recorded them anew since."""
LOGS = "logs"
UNFINISHED = "unfinished"
_INCOMPLETE = "incomplete"
BYTES_PER_MESSAGE = 300
"""Disk that a message takes while the bag is written: in its part, in the bag, in its index."""


def default_run_folder(scenario: Scenario) -> Path:
    """Return runs/<scenario>-<UTC time> below the working folder."""
    return Path("runs") / f"{scenario.name}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}"


_HELD: weakref.WeakValueDictionary[Path, RunFolder] = weakref.WeakValueDictionary()
"""Folders that this process holds."""


class RunFolder:
    """One run on disk: scenario.yaml, run.json, parts/ while it runs, then bag/.

    The process that fills it holds it, by a lock on the folder that goes with the process. So
    anybody can tell a run that goes on from one whose process is gone, however that came about.

    Parameters
    ----------
    path : Path
        The folder.

    Attributes
    ----------
    begun : RunInfo
        What run.json says at the beginning, in a folder that was made here.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.bag = path / BAG
        self.parts = path / PARTS
        self.logs = path / LOGS
        self.begun = RunInfo()

    @classmethod
    def create(cls, path: Path, scenario: Scenario, run: str = "") -> RunFolder:
        """Make the folder of a new run, with the resolved scenario and run.json, and hold it.

        Parameters
        ----------
        path : Path
            The folder.
        scenario : Scenario
            What is run.
        run : str, optional
            What tells the run from every other, where it has such a name.

        Raises
        ------
        UserError
            When it exists already or cannot be written; nothing is changed then.
        """
        folder = cls(path)
        try:
            path.mkdir(parents=True)
        except FileExistsError as error:
            raise UserError(
                f"{path}: exists already, a run never overwrites another. "
                "Choose another folder with -o or remove it."
            ) from error
        except OSError as error:
            raise _unwritable(path, error) from error
        try:
            folder.parts.mkdir()
            _refuse_full_disk(path, scenario)
            folder.begun = dataclasses.replace(_begun(scenario), run=run)
            folder.begun.write(path)
            folder.write_scenario(scenario)
        except BaseException as error:
            shutil.rmtree(path, ignore_errors=True)
            if isinstance(error, OSError):
                raise _unwritable(path, error) from error
            raise
        folder.hold()
        return folder

    def hold(self) -> bool:
        """Hold the folder as long as it is in use here; False when another process does."""
        if self.path.absolute() in _HELD:
            return True
        with contextlib.suppress(OSError):  # where there are no locks, nobody is known to hold it
            folder = os.open(self.path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
            weakref.finalize(self, os.close, folder)
            try:
                fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return False
            _HELD[self.path.absolute()] = self
        return True

    def write_scenario(self, scenario: Scenario) -> None:
        """Write the resolved scenario, all of it or nothing."""
        written = self.path / f"{SCENARIO_FILE}.new"
        written.write_text(format_scenario(scenario), encoding="utf-8")
        written.replace(self.path / SCENARIO_FILE)

    def scenario(self) -> Scenario:
        """Return the resolved scenario."""
        return load_scenario(self.path / SCENARIO_FILE)

    def recording(self) -> Recording:
        """Return what the parts hold, those of hosts that ended too where that is more."""
        return newest_of(self.parts, self.path / ENDED)

    def ended_part(self, part: Path) -> Path:
        """Move the part of a host that ended out of the way of its next one; return where to."""
        ended = self.path / ENDED
        ended.mkdir(exist_ok=True)
        if part.is_dir():
            part.rename(ended / f"{part.name}_{len([*ended.glob('*')])}")
        return ended

    def finish(
        self,
        scenario: Scenario,
        recording: Recording,
        info: RunInfo,
        progress: Callable[[int, int], None] | None = None,
    ) -> RunInfo:
        """Write the bag and run.json, remove the parts, and return what run.json says.

        As long as some of them are on other machines, those that are here stay.

        At any moment run.json is true, and what is missing can be made from the parts.

        Parameters
        ----------
        scenario : Scenario
            What was run.
        recording : Recording
            What was recorded.
        info : RunInfo
            What only the runner knows: status, message, wall time, hosts.
        progress : callable, optional
            Called periodically with the sample written and the number of samples.
        """
        from cacc_platoon.bags.write import Events, write_bag  # noqa: PLC0415  (heavy: a run starts sooner)
        from cacc_platoon.runs.recording import with_deliveries  # noqa: PLC0415

        info = dataclasses.replace(
            info,
            seed=scenario.run.seed,
            versions=info.versions or versions(),
            fingerprint=info.fingerprint or fingerprint(),
        )
        info.without_bag().write(self.path)
        prefix = scenario.platoon.namespace
        recording = with_deliveries(recording, Graph.of(scenario))
        digest = run_digest(recording, Graph.of(scenario))
        shutil.rmtree(self.path / UNFINISHED, ignore_errors=True)
        finished = info.samples if info.status is EndStatus.FINISHED else None
        settle_events(self.path, finished or scenario.samples)
        write_bag(
            self.path / UNFINISHED / BAG,
            recording,
            step_ns=scenario.step_ns,
            depth=queue_depth(scenario),
            scenario_topic=PlatoonTopics(prefix).scenario,
            scenario_text=format_scenario(scenario),
            events=Events(PlatoonTopics(prefix).events, bag_events(self.path, scenario.samples)),
            custom_data={
                "digest": digest,
                "cacc_platoon": __version__,
                "status": str(info.status),
                "message": info.message,
            },
            progress=progress,
        )
        info = dataclasses.replace(
            info,
            digest=digest,
            messages={name: len(record.messages) for name, record in sorted(recording.items())},
        )
        info.write(self.path)
        if self.bag.exists():  # without what was recorded elsewhere
            self.bag.rename(self.path / UNFINISHED / _INCOMPLETE)
        (self.path / UNFINISHED / BAG).rename(self.bag)
        shutil.rmtree(self.path / UNFINISHED)
        if not (info.lacks_parts or _awaits_parts(scenario, recording, info)):
            for folder in (self.parts, self.path / ENDED):
                shutil.rmtree(folder, ignore_errors=True)
        return info


def _awaits_parts(scenario: Scenario, recording: Recording, info: RunInfo) -> bool:
    """Return whether parts may be elsewhere of a run that nobody of its hosts is known of."""
    elsewhere = {vehicle for host in scenario.remote_hosts for vehicle in host.vehicles}
    graph = Graph.of(scenario)
    nodes = [node for node in scenario.nodes if node.vehicle in elsewhere]
    there = {topic.name for node in nodes for topic in graph.recorded_with(node)}
    return not info.hosts and not there <= recording.keys()


def _unwritable(path: Path, error: OSError) -> UserError:
    return UserError(
        f"{path}: cannot be written ({error.strerror}), the run would be lost. "
        "Choose another folder with -o."
    )


def _begun(scenario: Scenario) -> RunInfo:
    """Return what run.json says from the beginning on."""
    return RunInfo(
        EndStatus.RUNNING,
        seed=scenario.run.seed,
        versions=versions(),
        fingerprint=fingerprint(),
        pid=os.getpid(),
        began=f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}",
    )


def _refuse_full_disk(path: Path, scenario: Scenario) -> None:
    """Raise UserError, and remove the folder, when the run cannot fit on its disk."""
    needed = len(Graph.of(scenario).recorded) * scenario.samples * BYTES_PER_MESSAGE
    free = shutil.disk_usage(path).free
    if free < needed:
        shutil.rmtree(path)
        raise UserError(
            f"{path}: has {free / 2**20:.0f} MiB free but the run takes up to "
            f"{needed / 2**20:.0f} MiB, it would be lost. Choose another disk with -o or make room."
        )


def versions() -> dict[str, str]:
    """Return the versions of everything that shapes a run."""
    found = {"cacc_platoon": __version__, "python": platform.python_version()}
    for package in ("numpy", "rosbags", "rclpy"):
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def fingerprint() -> dict[str, str]:
    """Return what decides the last bits of sin, cos and exp on this machine."""
    grid = [math.sin(k) + math.cos(k) + math.exp(-k / 7.0) for k in range(1, 2000)]
    return {
        "machine": platform.machine(),
        "system": sys.platform,
        "libc": " ".join(platform.libc_ver()),
        "cores": str(os.cpu_count()),
        "math": hashlib.sha256(np.array(grid).tobytes()).hexdigest()[:16],
    }
