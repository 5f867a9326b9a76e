"""Adds parts that were recorded on other machines to the bag of a run, when it is over."""

from __future__ import annotations

import itertools
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from cacc_platoon.bags.rows import Recording, TopicRows
from cacc_platoon.errors import UserError
from cacc_platoon.runs.folder import RunFolder
from cacc_platoon.runs.info import EndStatus, InfoError, RunInfo
from cacc_platoon.runs.locate import last_word
from cacc_platoon.runs.parts import read_parts, run_of_part
from cacc_platoon.runs.recording import first_samples, recorded_samples
from cacc_platoon.scenario import Scenario
from msg_adapters.topics import Graph


def merge_parts(
    path: Path, parts: Sequence[Path], progress: Callable[[int, int], None] | None = None
) -> RunInfo:
    """Write the bag of a run anew, with parts that were elsewhere; return what run.json then says.

    Parameters
    ----------
    path : Path
        The run folder.
    parts : sequence of Path
        Folders that hosts have recorded in.
    progress : callable, optional
        Called periodically with the sample written and the number of samples.

    Raises
    ------
    UserError
        When the run lacks none of them, or goes on; nothing is changed then.
    """
    folder, info = RunFolder(path), _info(path)
    if not folder.parts.is_dir():
        raise UserError(f"{path}: its bag lacks no part. Give the run of these parts.")
    if not folder.hold():
        raise UserError(f"{path}: another process is at it. Wait until it has ended.")
    info, _ = last_word(folder)
    scenario = folder.scenario()
    graph = Graph.of(scenario)
    recording = {**folder.recording(), **_checked(parts, info, graph, folder)}
    _refuse_cut_parts(parts, recording, graph, info.samples)
    missing = [topic.name for topic in graph.recorded if topic.name not in recording]
    left = _left(info, scenario, missing)
    if missing:  # the next time these are still needed
        for part in parts:
            shutil.copytree(part, _free(folder.parts / part.absolute().name))
    info = info.with_parts().without_parts(left)
    if info.status is EndStatus.FINISHED and info.samples is not None:
        recording = first_samples(recording, graph, info.samples * scenario.step_ns)
    return folder.finish(scenario, recording, info, progress)


def _free(path: Path) -> Path:
    """Return a path that nothing has yet, named after another."""
    names = (path.with_name(f"{path.name}_{k}") for k in itertools.count(1))
    return next(one for one in itertools.chain([path], names) if not one.exists())


def _info(path: Path) -> RunInfo:
    try:
        info = RunInfo.read(path)
    except InfoError as error:
        raise UserError(f"{error}. Give an intact run folder.") from error
    if info is None:
        raise UserError(f"{path}: is no run folder, it has no run.json. Give one.")
    return info


def _checked(
    parts: Sequence[Path], info: RunInfo, graph: Graph, folder: RunFolder
) -> dict[str, TopicRows]:
    """Return what some parts hold, if each is one of the run."""
    known = {topic.name: topic for topic in graph.recorded}
    here = folder.recording()
    found: dict[str, TopicRows] = {}
    for part in parts:
        run = run_of_part(part)
        if run is None:
            raise UserError(f"{part}: is no part, it has no topics.json. Give a host's.")
        if run and info.run and run != info.run:
            raise UserError(f"{part}: is of run {run[:12]}, not of {info.run[:12]}. Give another.")
        for name, rows in read_parts([part]).items():
            if name not in known or rows.messages.shape[1] != known[name].codec.size:
                raise UserError(f"{part}: {name} is no topic of this run. Give another part.")
            if name in found or name in here:
                raise UserError(f"{part}: {name} is in the run already. Give another part.")
            found[name] = rows
    return found


def _refuse_cut_parts(
    parts: Sequence[Path], recording: Recording, graph: Graph, samples: int | None
) -> None:
    """Refuse parts of which not all has been brought over."""
    counts = recorded_samples(recording, graph, samples or 0)
    for part in parts:
        for name in read_parts([part]):
            if samples and counts[name] < samples:
                raise UserError(
                    f"{part}: {name} has {counts[name]} of {samples} samples. Bring all of the "
                    "part over and merge it then."
                )


def _left(info: RunInfo, scenario: Scenario, missing: Sequence[str]) -> Mapping[str, str]:
    """Return the parts, by host, that are still elsewhere: those of vehicles that lack topics."""
    hosts = {host.name: host.vehicles for host in scenario.remote_hosts}
    graph = Graph.of(scenario)
    return {
        host.name: host.part
        for host in info.hosts
        if host.part
        and any(
            topic.name in missing
            for node in scenario.nodes
            if node.vehicle in hosts.get(host.name, ())
            for topic in graph.recorded_with(node)
        )
    }
