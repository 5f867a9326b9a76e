"""What a part that is still being written holds of one sample, for whoever watches the run."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from typing import NamedTuple, Protocol

from cacc_platoon.model import Link
from msg_adapters.topics import Graph, LinkTopics, Topic


class Messages(Protocol):
    """Messages of some topics by number, in the order in which they were recorded."""

    def count(self, name: str) -> int:
        """Return how many messages of a topic there are."""
        ...

    def message(self, name: str, number: int) -> bytes:
        """Return one of them, or raise LookupError."""
        ...


class Reading(NamedTuple):
    """The values of one message.

    Attributes
    ----------
    sample : int
        The sample that it is stamped with; of a packet, the one at which it was sent.
    x, y : float
        Its values.
    """

    sample: int
    x: float
    y: float = 0.0


class SampleReader:
    """Reads what is known of each vehicle at a sample.

    Nothing is done for it while messages are recorded: they are looked up when somebody asks.

    Parameters
    ----------
    part : Messages
        What is recorded.
    recorded : iterable of Topic
        Its topics.
    graph : Graph
        The platoon's topics.
    step_ns : int
        The control period [ns].
    """

    def __init__(
        self, part: Messages, recorded: Iterable[Topic], graph: Graph, step_ns: int
    ) -> None:
        self._part, self._step_ns = part, step_ns
        topics = frozenset(recorded)
        self._counted = [link for link in _nearest_links(graph) if topics.issuperset(link)]
        counted = {topic for link in self._counted for topic in link}
        self._each = [
            topic for topic in shown_topics(graph) if topic in topics and topic not in counted
        ]

    def at(self, sample: int) -> dict[str, Reading]:
        """Return the last reading of each topic at a sample, by topic.

        Parameters
        ----------
        sample : int
            Where a topic is not as far, what there is of it is given.
        """
        found = {}
        for topic in self._each:
            number = min(sample, self._part.count(topic.name) - 1)
            if number >= 0:
                found[topic.name] = self._reading(topic, number)
        for link in self._counted:
            number = self._delivered(link, sample) - 1
            if number >= 0:
                found[link.accel.name] = self._reading(link.accel, number)
        return found

    def _delivered(self, link: LinkTopics, sample: int) -> int:
        """Return how many messages of a link that counts them were delivered by a sample."""
        counts = range(self._part.count(link.complete.name))
        by_then = bisect_right(
            counts, sample, key=lambda number: self._reading(link.complete, number).sample
        )
        if by_then == 0:
            return 0
        delivered = int(self._reading(link.complete, by_then - 1).x)
        return min(delivered, self._part.count(link.accel.name))

    def _reading(self, topic: Topic, number: int) -> Reading:
        stamp, x, y = topic.codec.decode_both(self._part.message(topic.name, number))
        return Reading(stamp // self._step_ns, x, y)


def shown_topics(graph: Graph) -> Iterator[Topic]:
    """Yield the topics whose values viewers show: of each vehicle, and of its nearest link."""
    for index, vehicle in graph.vehicles.items():
        yield from vehicle.motion
        if index in graph.topology.followers:
            yield vehicle.received
            yield from (vehicle.reception, vehicle.monitor, vehicle.timing)


def _nearest_links(graph: Graph) -> Iterator[LinkTopics]:
    for index in graph.topology.followers:
        if topics := graph.counted_links.get(Link(index - 1, index)):
            yield topics
