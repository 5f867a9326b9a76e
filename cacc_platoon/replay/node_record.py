"""What one node of a recorded run was given and what it published, byte for byte."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cacc_platoon.bags.decode import Floats, rows_in_order_of_recording, rows_in_stamp_order
from cacc_platoon.bags.raw import BagError, Bytes, Integers, Progress, RawTopic
from cacc_platoon.bags.read import RawBag, read_bag
from cacc_platoon.errors import UserError
from cacc_platoon.runs.locate import locate
from cacc_platoon.runs.recorded_run import RecordedRun, read_run
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import NodeKind, NodeName, vehicle_name
from msg_adapters.topics import Graph, Topic


class Stream(NamedTuple):
    """The messages of one topic.

    Attributes
    ----------
    topic : Topic
        Which.
    messages : ndarray of uint8, shape (n, size)
        CDR bytes in the order of their delivery, padding zeroed.
    ends : ndarray of int64, shape (samples,)
        How many messages there are up to and including each sample, for the samples 0, 1, 2, ... of
        which that is known; messages behind the last of them have a gap before.
    """

    topic: Topic
    messages: Bytes
    ends: Integers

    @property
    def unbroken(self) -> int:
        """For so many samples it is known what was published."""
        return len(self.ends)

    def count(self, samples: int) -> int:
        """Return how many messages the first samples have."""
        return int(self.ends[samples - 1]) if samples else 0

    def sample_of(self, row: int) -> int:
        """Return the sample at which a message was delivered."""
        return int(np.searchsorted(self.ends, row, side="right"))

    def values(self, samples: int) -> Floats:
        """Return x of the messages of the first samples."""
        return self.topic.codec.values(self.messages[: self.count(samples)])


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
        What it received and what it published.
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

    def feed(self) -> list[tuple[Topic, list[list[bytes]]]]:
        """Return the messages of each input at each sample."""
        fed = []
        for stream in self.inputs:
            ends = [0, *stream.ends[: self.samples].tolist()]
            rows = [row.tobytes() for row in stream.messages[: ends[-1]]]
            samples = [rows[begin:end] for begin, end in pairwise(ends)]
            samples += [[]] * (self.samples - len(samples))
            fed.append((stream.topic, samples))
        return fed

    def expected(self) -> list[tuple[Topic, list[int]]]:
        """Return how many messages each output has up to and including each sample."""
        return [(one.topic, one.ends[: self.samples].tolist()) for one in self.outputs]


def read_node(
    path: Path,
    index: int,
    node: str | None = None,
    *,
    scenario: Scenario | None = None,
    namespace: str | None = None,
    progress: Progress | None = None,
) -> NodeRecord:
    """Read what a node of a recorded run was given and published.

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
    graph = Graph.of(run.scenario)
    topics = graph.nodes[NodeName(NodeKind(node), index)]
    read = _Streams(raw, graph, node, run.scenario.step_ns)
    inputs = tuple(read.stream(topic, index) for topic in topics.subscribes)
    outputs = tuple(read.stream(topic, index) for topic in topics.publishes)
    known = [stream.unbroken for stream in inputs]
    ahead = 1 if node == "vehicle" else 0  # sample k of the inputs gives sample k + 1
    last = run.scenario.samples
    samples = min([last, *(n + ahead for n in known), *(s.unbroken for s in outputs)])
    notes = [
        f"{s.topic.name} ends at sample {n - 1}"
        if s.count(n) == len(s.messages)
        else f"{s.topic.name} lacks sample {n}"
        for s, n in zip(inputs + outputs, [*known, *(s.unbroken for s in outputs)], strict=True)
        if n < last
    ]
    return NodeRecord(run, node, index, inputs, outputs, samples, tuple(notes))


class _Streams:
    """Reads the topics of one node from a bag."""

    def __init__(self, raw: RawBag, graph: Graph, node: str, step: int) -> None:
        self._raw, self._node, self._step = raw, node, step
        self._complete = dict(graph.counted_links.values())

    def stream(self, topic: Topic, index: int) -> Stream:
        """Return the messages of a topic that vehicle `index` publishes or subscribes to."""
        complete = self._complete.get(topic)
        if complete is None:
            return self._gridded(topic)
        counts = self._gridded(complete)
        ends = complete.codec.values(counts.messages[: counts.unbroken]).astype(np.int64)
        if ends[-1] == 0:  # everything was lost
            rows = np.empty((0, topic.codec.size), np.uint8)
        else:
            rows = self._rows(topic, rows_in_order_of_recording)
        return Stream(topic, rows, ends[ends <= len(rows)])

    def _gridded(self, topic: Topic) -> Stream:
        """Return a topic that has a message of every sample."""
        rows = self._rows(topic, rows_in_stamp_order)
        stamps = topic.codec.stamps(rows)
        astray = stamps != np.arange(len(stamps)) * self._step
        unbroken = int(astray.argmax()) if astray.any() else len(stamps)
        if not unbroken:
            raise BagError(
                f"{self._raw.path}: {topic.name} does not begin with sample 0, stamped 0 s, so the "
                "state of the node is unknown. Replay a lockstep run that was recorded from its "
                "beginning."
            )
        return Stream(topic, rows, np.arange(1, unbroken + 1))

    def _rows(self, topic: Topic, read: Callable[[list[RawTopic]], Bytes | None]) -> Bytes:
        parts = [part for part in self._raw.topics.get(topic.name, []) if len(part.lengths)]
        if not parts:
            raise BagError(
                f"{self._raw.path}: lacks {topic.name}, without which {self._node} cannot be "
                "replayed. Record it too or replay another node."
            )
        rows = read(parts)
        if rows is None or rows.shape[1] != topic.codec.size:
            raise BagError(
                f"{self._raw.path}: {topic.name} has messages of another layout than "
                f"{topic.kind.type_name} in frame {topic.frame_id}; another program published "
                "them. Replay a bag of this package."
            )
        return rows
