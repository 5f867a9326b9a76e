"""What one node of a recorded run was given and what it published, byte for byte."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cacc_platoon.analysis import Standing, standing_of
from cacc_platoon.bags.decode import Floats, rows_in_order_of_recording, rows_in_stamp_order
from cacc_platoon.bags.raw import BagError, Bytes, Integers, Progress, RawTopic
from cacc_platoon.bags.read import RawBag, read_bag
from cacc_platoon.errors import UserError
from cacc_platoon.runs.locate import locate
from cacc_platoon.runs.recorded_run import RecordedRun, read_run
from cacc_platoon.runs.recording import count_of_each_sample, not_counts
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
        which that is known.
    end : str
        Why it is known for no more of them.
    gap : bool
        Whether there are messages behind them, which do not go on where these end.
    """

    topic: Topic
    messages: Bytes
    ends: Integers
    end: str
    gap: bool

    @property
    def unbroken(self) -> int:
        """For so many samples it is known what was published."""
        return len(self.ends)

    def count(self, samples: int) -> int:
        """Return how many messages the first samples have, as far as that is known."""
        known = min(samples, self.unbroken)
        return int(self.ends[known - 1]) if known else 0

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
        What it received and what it published, as far as the bag has what is for viewers alone.
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

    @cached_property
    def standing(self) -> Standing:
        """How the data of the run stand."""
        return standing_of(self.run)

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
    topics = graph.replayed(NodeName(NodeKind(node), index))
    read = _Streams(raw, graph, node, run.scenario)
    inputs = tuple(read.stream(topic, index) for topic in topics.subscribes)
    shown = graph.vehicles[index].shown
    outputs = tuple(
        read.stream(topic, index)
        for topic in topics.publishes
        if topic not in shown or raw.topics.get(topic.name)
    )
    in_lockstep = node == "vehicle" and not run.scenario.clocked
    ahead = 1 if in_lockstep else 0  # sample k of the inputs gives sample k + 1
    last = run.scenario.samples
    samples = min([last, *(s.unbroken + ahead for s in inputs), *(s.unbroken for s in outputs)])
    streams = sorted(inputs + outputs, key=lambda stream: stream.unbroken)
    notes = dict.fromkeys(stream.end for stream in streams if stream.unbroken < last)
    return NodeRecord(run, node, index, inputs, outputs, samples, tuple(notes))


class _Streams:
    """Reads the topics of one node from a bag."""

    def __init__(self, raw: RawBag, graph: Graph, node: str, scenario: Scenario) -> None:
        self._raw, self._node = raw, node
        self._step, self._samples = scenario.step_ns, scenario.samples
        self._counted_by = dict(graph.counted_links.values())

    def stream(self, topic: Topic, index: int) -> Stream:
        """Return the messages of a topic that vehicle `index` publishes or subscribes to."""
        if complete := self._counted_by.get(topic):
            return self._known(self._counted(topic, self._known(self._counts(complete))))
        if topic in self._counted_by.values():
            return self._known(self._counts(topic))
        return self._known(self._gridded(topic))

    def _known(self, stream: Stream) -> Stream:
        """Return a stream of which something is known from the beginning on."""
        if not stream.unbroken:
            raise BagError(
                f"{self._raw.path}: {stream.end}, so the state of the node is unknown. Replay a "
                "lockstep run that was recorded from its beginning and not altered."
            )
        return stream

    def _gridded(self, topic: Topic) -> Stream:
        """Return a topic that has a message of every sample."""
        rows = self._rows(topic, rows_in_stamp_order)
        if topic in self._counted_by.values():
            rows = count_of_each_sample(topic, rows, self._step, self._samples)
        stamps = topic.codec.stamps(rows)
        astray = stamps != np.arange(len(stamps)) * self._step
        n = int(astray.argmax()) if astray.any() else len(stamps)
        if n == len(stamps):
            end = f"ends at sample {n - 1}"
        elif n and stamps[n] == stamps[n - 1]:
            end = f"has sample {n - 1} twice"
        elif n:
            end = f"lacks sample {n}"
        else:
            end = "does not begin with sample 0, stamped 0 s"
        return Stream(topic, rows, np.arange(1, n + 1), f"{topic.name} {end}", n < len(stamps))

    def _counts(self, complete: Topic) -> Stream:
        """Return the counts of a relay as far as they can be counts of messages."""
        stream = self._gridded(complete)
        counts = complete.codec.values(stream.messages[: stream.unbroken])
        wrong = not_counts(counts)
        if not wrong.any():
            return stream
        n = int(np.argmax(wrong))
        before = counts[n - 1] if n else 0.0
        end = (
            f"{complete.name} counts {counts[n]:g} messages at sample {n} after {before:g}, but "
            "counts are whole numbers below 2^53 that never decrease"
        )
        return stream._replace(ends=stream.ends[:n], end=end, gap=True)

    def _counted(self, topic: Topic, counts: Stream) -> Stream:
        """Return a topic of which so many messages were delivered as are counted."""
        totals = counts.values(counts.unbroken).astype(np.int64)
        if totals[-1] == 0:  # everything was lost
            rows = np.empty((0, topic.codec.size), np.uint8)
        else:
            rows = self._rows(topic, rows_in_order_of_recording)
        ends = totals[totals <= len(rows)]
        if len(ends) == len(totals) < self._samples:
            return Stream(topic, rows, ends, counts.end, gap=False)
        k = min(len(ends), len(totals) - 1)
        end = (
            f"{counts.topic.name} counts {totals[k]} messages up to sample {k}, but {topic.name} "
            f"has {len(rows)}"
        )
        return Stream(topic, rows, ends, end, gap=not len(ends) or ends[-1] < len(rows))

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
