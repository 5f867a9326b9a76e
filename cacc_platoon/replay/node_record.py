"""What one node of a recorded run was given and what it said, as messages, byte for byte."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cacc_platoon.bags.decode import Floats, rows_in_stamp_order
from cacc_platoon.bags.raw import BagError, Bytes, Integers, Progress
from cacc_platoon.bags.read import RawBag, read_bag
from cacc_platoon.errors import UserError
from cacc_platoon.runs.locate import locate
from cacc_platoon.runs.recorded_run import RecordedRun, read_run
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import NodeKind, NodeName, vehicle_name
from msg_adapters.topics import Graph, Topic

NODES = ("vehicle", "noise_relay", "leader")


class Stream(NamedTuple):
    """The messages of one topic.

    Attributes
    ----------
    topic : Topic
        Which.
    messages : ndarray of uint8, shape (n, size)
        CDR bytes in stamp order, padding zeroed.
    stamps : ndarray of int64, shape (n,)
        Their stamps [ns].
    unbroken : int
        So many are the messages of samples 0, 1, 2, ...; what comes behind them has a gap before.
    """

    topic: Topic
    messages: Bytes
    stamps: Integers
    unbroken: int

    def values(self, samples: int) -> Floats:
        """Return x of the first samples."""
        return self.topic.codec.values(self.messages[:samples])


@dataclass(frozen=True)
class NodeRecord:
    """One node of a recorded run.

    Attributes
    ----------
    run : RecordedRun
        The run it belongs to.
    node : str
        "vehicle", "noise_relay" or "leader".
    index : int
        Its vehicle.
    inputs, outputs : tuple of Stream
        What it heard and what it published.
    samples : int
        So many samples of its output can be repeated from its inputs.
    notes : tuple of str
        Why these are not all samples of the run, one line each.
    """

    run: RecordedRun
    node: str
    index: int
    inputs: tuple[Stream, ...]
    outputs: tuple[Stream, ...]
    samples: int
    notes: tuple[str, ...]

    @property
    def scenario(self) -> Scenario:
        """What was run."""
        return self.run.scenario

    def feed(self) -> list[tuple[Topic, list[bytes | None]]]:
        """Return the inputs per sample, None where the channel delivered nothing."""
        step = self.scenario.step_ns
        fed = []
        for stream in self.inputs:
            rows: list[bytes | None] = [None] * self.samples
            for stamp, row in zip(stream.stamps.tolist(), stream.messages, strict=True):
                if 0 <= stamp < self.samples * step and stamp % step == 0:
                    rows[stamp // step] = row.tobytes()
            fed.append((stream.topic, rows))
        return fed


def read_node(
    path: Path,
    index: int,
    node: str | None = None,
    *,
    scenario: Scenario | None = None,
    namespace: str | None = None,
    progress: Progress | None = None,
) -> NodeRecord:
    """Read what a node of a recorded run was given and said.

    Parameters
    ----------
    path : Path
        A run folder, a bag's folder or a storage file.
    index : int
        The vehicle.
    node : str, optional
        "vehicle", "noise_relay" or "leader"; by default the one that moves.
    scenario, namespace, progress
        As in `read_run`.

    Raises
    ------
    UserError
        When the run has no such node, or the bag lacks its topics.
    """
    bag, folder = locate(path)
    run = read_run(bag, folder, scenario=scenario, namespace=namespace, progress=progress)
    leads = index == run.scenario.leader_index
    if index not in run.scenario.vehicles or (leads and node not in (None, "leader")):
        vehicles = run.scenario.vehicles
        raise UserError(
            f"{path}: has no {node or 'vehicle'} of {vehicle_name(index)}; "
            f"{vehicle_name(vehicles[0])} leads and {vehicles[0] + 1} to {vehicles[-1]} follow. "
            "Give one of them with --vehicle."
        )
    node = node or ("leader" if leads else "vehicle")
    if node == "leader" and not leads:
        raise UserError(f"{path}: {vehicle_name(index)} does not lead. Give --node vehicle.")
    raw = read_bag(bag, progress)
    step = run.scenario.step_ns
    topics = Graph.of(run.scenario).nodes[NodeName(NodeKind(node), index)]
    inputs = tuple(_stream(raw, topic, node, step) for topic in topics.subscribes)
    outputs = tuple(_stream(raw, topic, node, step) for topic in topics.publishes)
    known = [_known(stream, node) for stream in inputs]
    ahead = 1 if node == "vehicle" else 0  # sample k of the inputs gives sample k + 1
    last = run.scenario.samples
    samples = min([last, *(n + ahead for n in known), *(s.unbroken for s in outputs)])
    notes = [
        f"{s.topic.name} ends at sample {n - 1}"
        if n == len(s.stamps)
        else f"{s.topic.name} lacks sample {n}"
        for s, n in zip(inputs + outputs, [*known, *(s.unbroken for s in outputs)], strict=True)
        if n < last
    ]
    return NodeRecord(run, node, index, inputs, outputs, samples, tuple(notes))


def _stream(raw: RawBag, topic: Topic, node: str, step: int) -> Stream:
    parts = [part for part in raw.topics.get(topic.name, []) if len(part.lengths)]
    if not parts:
        raise BagError(
            f"{raw.path}: lacks {topic.name}, without which {node} cannot be replayed. Record it "
            "too or replay another node."
        )
    rows = rows_in_stamp_order(parts)
    if rows is None or rows.shape[1] != topic.codec.size:
        raise BagError(
            f"{raw.path}: {topic.name} has messages of another layout than "
            f"{topic.kind.type_name} in frame {topic.frame_id}; another program published them. "
            "Replay a bag of this package."
        )
    stamps = topic.codec.stamps(rows)
    astray = stamps != np.arange(len(stamps)) * step
    unbroken = int(astray.argmax()) if astray.any() else len(stamps)
    if not unbroken:
        raise BagError(
            f"{raw.path}: {topic.name} does not begin with sample 0, stamped 0 s, so the state of "
            "the node is unknown. Replay a lockstep run that was recorded from its beginning."
        )
    return Stream(topic, rows, stamps, unbroken)


def _known(stream: Stream, node: str) -> int:
    """Return for how many samples an input is known: what the channel lost is known too."""
    if node == "vehicle" and stream.topic.name.endswith("/v2v/accel"):
        step = int(stream.stamps[1] - stream.stamps[0]) if len(stream.stamps) > 1 else 1
        if stream.unbroken > 1 and (np.diff(stream.stamps) > 0).all():
            return int(stream.stamps[-1]) // step + 1
    return stream.unbroken
