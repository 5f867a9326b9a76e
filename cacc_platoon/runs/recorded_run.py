"""A recorded run: its scenario, its arrays, and every fault found on the way."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cacc_platoon.bags.decode import Floats, Signal, decode, rows_in_stamp_order
from cacc_platoon.bags.digest import run_digest
from cacc_platoon.bags.raw import BagError, Progress
from cacc_platoon.bags.read import RawBag, read_bag
from cacc_platoon.bags.rows import TopicRows
from cacc_platoon.errors import one_line
from cacc_platoon.model import Link, RecordedMotion
from cacc_platoon.runs.arrivals import counted_rows, prompt_arrivals, read_arrivals
from cacc_platoon.runs.find_platoons import find_platoons
from cacc_platoon.runs.info import INFO_FILE, EndStatus, InfoError, RunInfo
from cacc_platoon.runs.locate import how_it_ended, nothing_recorded
from cacc_platoon.runs.recorded_scenario import (
    altered_scenario,
    cut_short,
    cut_to_samples,
    identify,
)
from cacc_platoon.runs.sample_grid import Fault, Grid, group, lay_grid, sample
from cacc_platoon.runs.timing import read_timing
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import Arrivals, Trajectory
from cacc_platoon.simulation.bodies import measured_velocities
from cacc_platoon.simulation.timing import Timing
from cacc_platoon.simulation.trajectory import law_shares
from msg_adapters.topics import Graph, Role, Topic

_NAMED_TOPICS = 3
_DIGEST = 64


@dataclass(frozen=True)
class RecordedRun:
    """What a bag says.

    Attributes
    ----------
    bag : Path
        Where it was read from.
    trajectory : Trajectory
        The arrays, NaN where something is missing; its scenario is the one of the bag, cut to the
        samples that are there.
    scenario : Scenario
        The scenario as it was meant, not cut.
    grid : Grid
        Stamps of the samples.
    findings : tuple of str
        Everything wrong with the bag, one line each; empty for a whole run.
    digest : str
        Digest of the messages in the bag.
    digest_recorded : str
        The digest that was written when the run ended, empty when none was.
    messages : int
        Messages of the platoon.
    info : RunInfo or None
        What run.json says, or else the bag of a run that did not end well; None where neither does.
    altered_scenario : str
        That the bag's copies of its scenario differ, empty when they do not.
    faults : tuple of str
        Those of the findings that are about the platoon's messages.
    """

    bag: Path
    trajectory: Trajectory
    scenario: Scenario
    grid: Grid
    findings: tuple[str, ...]
    digest: str
    digest_recorded: str
    messages: int
    info: RunInfo | None
    faults: tuple[str, ...] = ()
    altered_scenario: str = ""


def read_run(
    bag: Path,
    folder: Path | None = None,
    *,
    scenario: Scenario | None = None,
    namespace: str | None = None,
    progress: Progress | None = None,
) -> RecordedRun:
    """Read a bag into arrays.

    Parameters
    ----------
    bag : Path
        A bag's folder or storage file.
    folder : Path, optional
        The run folder around it, where scenario.yaml and run.json are looked for.
    scenario : Scenario, optional
        Parameters to use instead of those in the bag.
    namespace : str, optional
        Which platoon to read when the bag holds several; by default that of the scenario, or the
        one with the most messages.
    progress : callable, optional
        Called periodically with what is being done, how much is done and how much there is.

    Raises
    ------
    BagError
        When there is no platoon in the bag, or nothing says what its parameters are.
    """
    raw = read_bag(bag, progress)
    info = _read_info(folder, raw) or _info_in_bag(raw)
    notes = [*_unfinished(info), *raw.damage]
    empty = not any(found.messages for found in find_platoons(raw.topics))
    if folder and info and _unfinished(info) and empty:
        raise nothing_recorded(folder, info)
    scenario = identify(raw, folder, scenario, namespace, notes)
    graph = Graph.of(scenario)
    before = len(notes)
    samples = _read_samples(raw, graph, scenario.step_ns, notes)
    faults = notes[before:]
    altered = altered_scenario(raw, graph.prefix)
    notes += filter(None, [altered])
    found = run_digest(_Rows(raw, graph), graph)
    recorded = (info.digest if info else "") or one_line(raw.custom_data.get("digest", ""), _DIGEST)
    notes += _another_digest(found, recorded)
    cut = cut_to_samples(scenario, samples.grid, notes)
    trajectory = _trajectory(cut, samples)
    if samples.grid.exact and not trajectory.ends_in_collision:
        notes += filter(None, [cut_short(scenario, cut)])
    return RecordedRun(
        bag,
        trajectory,
        scenario,
        samples.grid,
        tuple(one_line(note) for note in notes),
        found,
        recorded,
        samples.messages,
        info,
        tuple(one_line(fault) for fault in faults),
        altered,
    )


class _Samples(NamedTuple):
    """The messages of a platoon, sample by sample."""

    grid: Grid
    columns: Mapping[Role, Floats]
    arrivals: Mapping[Link, Arrivals]
    timing: Timing | None
    messages: int


def _read_samples(raw: RawBag, graph: Graph, step: int, notes: list[str]) -> _Samples:
    """Decode the messages of a platoon; what is wrong with them is appended to the notes."""
    signals, faults = _decode_all(raw, graph.roles, notes)
    messages = sum(len(signal.stamps) for signal in signals.values())
    if not messages:
        raise BagError(f"{raw.path}: no message of {graph.prefix} can be read. Give another bag.")
    grid = lay_grid(signals.values(), step)
    arrivals = read_arrivals(raw, graph, signals, grid, faults)
    columns = _columns(graph.roles, signals, grid, faults, arrivals)
    timing = read_timing(raw, graph, grid, faults)
    notes += group(faults)
    return _Samples(grid, columns, arrivals, timing, messages)


def _another_digest(found: str, recorded: str) -> list[str]:
    """Say so where the messages are not those of the digest that was written with them."""
    if recorded in ("", found):
        return []
    return [
        f"the digest is {found[:12]}, but {recorded[:12]} was written when the run ended: "
        "the messages are not those that were recorded"
    ]


def _read_info(folder: Path | None, raw: RawBag) -> RunInfo | None:
    if folder is None:
        return None
    try:
        return RunInfo.read(folder)
    except InfoError:
        raw.damage.append(f"{INFO_FILE} is damaged and left out")
        return None


def _info_in_bag(raw: RawBag) -> RunInfo | None:
    """Return what the bag itself says of a run that did not end well."""
    with contextlib.suppress(ValueError):
        status = EndStatus(raw.custom_data.get("status", ""))
        if status is not EndStatus.FINISHED:
            return RunInfo(status, one_line(raw.custom_data.get("message", "")))
    return None


def _unfinished(info: RunInfo | None) -> list[str]:
    """Say what run.json says of a run that did not end well."""
    if info is None or info.status == EndStatus.FINISHED:
        return []
    return [how_it_ended(info)]


def _decode_all(
    raw: RawBag, topics: Mapping[Role, Topic], notes: list[str]
) -> tuple[dict[Role, Signal], list[Fault]]:
    signals: dict[Role, Signal] = {}
    faults: list[Fault] = []
    missing: list[str] = []
    for role, topic in topics.items():
        parts = raw.topics.get(topic.name, [])
        right = [part for part in parts if _same_type(part.type_name, topic.kind.type_name)]
        wrong = {part.type_name or "of unknown type" for part in parts} - {
            part.type_name for part in right
        }
        if wrong:
            what = f"is {' and '.join(sorted(wrong))}, not {topic.kind.type_name}; left out"
            faults.append(Fault(topic.name, what))
        if right:
            signals[role] = decode(right, topic.kind)
        elif not wrong:
            missing.append(topic.name)
    if missing:
        shown = ", ".join(missing[:_NAMED_TOPICS])
        more = f" and {len(missing) - _NAMED_TOPICS} more" if len(missing) > _NAMED_TOPICS else ""
        notes.append(f"missing topics: {shown}{more}")
    return signals, faults


def _same_type(found: str, expected: str) -> bool:
    return found == expected or found.replace("/", "/msg/", 1) == expected


def _columns(
    topics: Mapping[Role, Topic],
    signals: Mapping[Role, Signal],
    grid: Grid,
    faults: list[Fault],
    arrivals: Mapping[Link, Arrivals],
) -> dict[Role, Floats]:
    columns: dict[Role, Floats] = {}
    for role in topics:
        if Link(role.sender, role.vehicle) in arrivals:
            columns[role] = np.full(grid.samples, np.nan)
        elif role in signals:
            columns[role], found = sample(signals[role], grid)
            faults += found
        else:
            columns[role] = np.full(grid.samples, np.nan)
    return columns


def _trajectory(scenario: Scenario, samples: _Samples) -> Trajectory:
    """Return the arrays; what a follower used of a channel that loses is worked out again."""
    columns, arrivals, timing = samples.columns, samples.arrivals, samples.timing

    def stack(quantity: str) -> Floats:
        own = [columns[role] for role in columns if role.quantity == quantity]
        return np.stack(own, axis=1)

    received = stack("received")
    states = stack("pose"), stack("twist"), stack("accel")
    receivers, shares = scenario.receivers, {}
    measured = measured_velocities(scenario, np.stack(states), timing) if arrivals else []
    for column, receiver in enumerate(receivers):
        if receiver.link in arrivals:
            arrived = arrivals[receiver.link]
            own = receiver.index - scenario.indices[0]
            received[:, column], share, *_ = arrived.of_bag(receiver, measured[own])
            if share is not None:
                shares[column] = share
            if np.isnan(columns[Role("pose", receiver.index)][:1]).any():
                first = int(min(arrived.sample, default=len(received)))
                received[:first, column] = np.nan  # what it held from before is not recorded
    if scenario.leader.profile == "bag":  # what led is in this bag too
        led = RecordedMotion(scenario.run.step, *(part[:, 0] for part in states))
        scenario = dataclasses.replace(scenario, recorded_leader=led)
    links = None
    if arrivals:
        links = tuple(
            arrivals.get(receiver.link) or prompt_arrivals(received[:, column])
            for column, receiver in enumerate(receivers)
        )
    return Trajectory(scenario, *states, received, links, law_shares(scenario, shares), timing)


class _Rows(Mapping[str, TopicRows]):
    """The recording that the digest is made of, one topic in memory at a time."""

    def __init__(self, raw: RawBag, graph: Graph) -> None:
        names = [topic.name for topic in graph.run_topics]
        self._parts = {name: raw.topics[name] for name in names if name in raw.topics}
        self._counted = counted_rows(raw, graph)

    def __getitem__(self, name: str) -> TopicRows:
        if name in self._counted:
            return self._counted[name]
        parts = self._parts[name]
        rows = rows_in_stamp_order(parts)
        return TopicRows(parts[0].type_name, np.empty((0, 0), np.uint8) if rows is None else rows)

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)
