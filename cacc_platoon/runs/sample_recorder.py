"""What a recorder does with each message, without ROS: the next due sample, and how far it is.

In lockstep a topic has every sample, in order and once, so a message is written where its stamp is
the due one, and refused otherwise. What a follower receives over a channel that may lose or delay
packets is written as it comes; the relay's counts, which have every sample, say up to which sample
it is complete.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from cacc_platoon.scenario import Scenario
from cacc_platoon.stepping.deliveries import (
    OTHERS,
    CountedDeliveries,
    doubtful_from,
    is_count,
    lost_or_foreign,
)
from msg_adapters.stamped import SECOND
from msg_adapters.topics import Graph, Topic

NAMED = 10
"""So many failures are kept; the first one ends the run."""
_STAMP = struct.Struct("<4xiI")


class _CountedLink(NamedTuple):
    """A link that may lose or delay packets: what was received, and the counts of its relay."""

    received: str
    complete: Topic
    deliveries: CountedDeliveries[int]


class SampleRecorder:
    """Takes the messages of some topics, and counts the samples that all of them have.

    Parameters
    ----------
    scenario : Scenario
        The run.
    topics : sequence of Topic
        What to record.
    writers : mapping of str to callable
        Called with each message of the topic of that name; may raise OSError.
    folder : Path
        Where they write, for the failure that says so.
    progress : callable
        Called periodically with a sample up to which everything is there.

    Attributes
    ----------
    failures : list of str
        What went wrong; the first one ends the run.
    samples : dict of str to int
        How many samples each topic has.
    """

    def __init__(
        self,
        scenario: Scenario,
        topics: Sequence[Topic],
        writers: Mapping[str, Callable[[bytes], object]],
        folder: Path,
        progress: Callable[[int], object],
    ) -> None:
        self.failures: list[str] = []
        self.samples = dict.fromkeys((topic.name for topic in topics), 0)
        self._writers, self._folder, self._progress = writers, folder, progress
        self._step_ns, self._last = scenario.step_ns, scenario.samples - 1
        self._window = scenario.run.window
        self._stride = scenario.run.stride
        self._arrived: dict[int, int] = {}
        self._ended = False
        self._counted = self._counted_links(scenario)
        self._clocked = scenario.clocked

    def receiver(self, topic: Topic) -> Callable[[bytes], None]:
        """Return the function that takes the messages of a topic."""
        link = self._counted.get(topic.name)
        if link is None:
            return self._every_sample(topic)
        if topic == link.complete:
            return self._count(topic, link)
        return self._as_it_comes(topic, link)

    def _counted_links(self, scenario: Scenario) -> dict[str, _CountedLink]:
        """Return the links that count their messages, by the names of both their topics."""
        links: dict[str, _CountedLink] = {}
        graph = Graph.of(scenario)
        for accel, complete in graph.counted_links.values():
            if accel.name in self.samples:
                link = _CountedLink(accel.name, complete, CountedDeliveries())
                links[accel.name] = links[complete.name] = link
        return links

    def _as_it_comes(self, topic: Topic, link: _CountedLink) -> Callable[[bytes], None]:
        """Return the receiver of what comes over a link that counts."""
        write, codec = self._writers[topic.name], topic.codec

        def receive(data: bytes) -> None:
            if len(data) != codec.size:
                self._refuse(topic.name, data, self.samples[topic.name])
                return
            try:
                write(codec.zero_padding(data))
            except OSError as error:
                self.not_written(error)
                return
            except ValueError:  # closed, as the run is over
                return
            seconds, nanoseconds = _STAMP.unpack_from(data)
            link.deliveries.message(seconds * SECOND + nanoseconds)
            self._settle(link)

        return receive

    def _count(self, topic: Topic, link: _CountedLink) -> Callable[[bytes], None]:
        """Return the receiver of the counts of a link."""
        take, decode = self._every_sample(topic), topic.codec.decode_both
        counted = 0.0

        def receive(data: bytes) -> None:
            nonlocal counted
            before = self.samples[topic.name]
            take(data)
            if self.samples[topic.name] == before:
                return
            stamp, count, more = decode(data)
            known = is_count(more) and more <= min(self._window, self._last - before)
            if not (is_count(count) and counted <= count and known):
                none = f", none at {more:g} samples more" if more else ""
                self._fail(
                    f"{topic.name}: counts {count:g} messages after {counted:g}{none}: it comes "
                    f"from another publisher; {doubtful_from(before)}"
                )
                return
            counted = count
            self._advance(topic.name, int(more))
            link.deliveries.count(stamp, int(count), stamp + int(more) * self._step_ns)
            self._settle(link)

        return receive

    def _settle(self, link: _CountedLink) -> None:
        """Take note of the samples up to which everything is here that a link delivered."""
        for stamp, sources, last in link.deliveries.settled():
            if any(source > stamp for source in sources):
                what = "a message was delivered before it was sent"
                self._doubt(link, what, stamp // self._step_ns)
            self._advance(link.received, (last - stamp) // self._step_ns + 1)
        over = self.samples[link.received] > self._last and not self._clocked
        if over and link.deliveries.waiting:
            self._doubt(link, f"has more messages than {link.complete.name} counts", 0)

    def _advance(self, name: str, more: int) -> None:
        """Take note that a topic has so many samples more."""
        first = self.samples[name]
        self.samples[name] = first + more
        for k in range(first, first + more):
            if k % self._stride == 0 or k == self._last:
                self.mark(k)

    def _doubt(self, link: _CountedLink, what: str, sample: int) -> None:
        self._fail(
            f"{link.received}: {what}: one comes from another publisher; {doubtful_from(sample)}"
        )

    def _every_sample(self, topic: Topic) -> Callable[[bytes], None]:
        """Return the receiver of a topic that has every sample."""
        write, name = self._writers[topic.name], topic.name
        unpack, size, step = _STAMP.unpack_from, topic.codec.size, self._step_ns
        samples, last, stride, mark = self.samples, self._last, self._stride, self.mark
        begin, end = topic.codec.padding
        zeros = bytes(end - begin)

        def receive(data: bytes) -> None:
            k = samples[name]
            if len(data) != size:
                self._refuse(name, data, k)
                return
            seconds, nanoseconds = unpack(data)
            if seconds * SECOND + nanoseconds != k * step:
                self._refuse(name, data, k)
                return
            if data[begin:end] != zeros:
                data = topic.codec.zero_padding(data)
            try:
                write(data)
            except OSError as error:
                self.not_written(error)
                return
            except ValueError:  # closed, as the run is over
                return
            samples[name] = k + 1
            if k % stride == 0 or k == last:
                mark(k)

        return receive

    def mark(self, k: int) -> None:
        """Count a topic in at sample k, and say so when it was the last one."""
        arrived = self._arrived.get(k, 0) + 1
        if arrived < len(self.samples):
            self._arrived[k] = arrived
        else:
            self._arrived.pop(k, None)
            self._progress(k)

    def end_at(self, samples: int) -> None:
        """Say so, once, when all topics have so many samples, fewer than the run was to have."""
        sooner = 0 < samples <= self._last and not self._ended
        if sooner and min(self.samples.values(), default=0) >= samples:
            self._ended = True
            self._progress(samples - 1)

    def not_written(self, error: OSError) -> None:
        """Take note that the disk does not take what is recorded."""
        self._fail(f"{self._folder}: cannot be written: {error.strerror}")

    def _refuse(self, name: str, data: bytes, k: int) -> None:
        found, why, due = f"a message of {len(data)} bytes", OTHERS, k * self._step_ns
        if len(data) >= _STAMP.size:
            seconds, nanoseconds = _STAMP.unpack_from(data)
            stamp = seconds * SECOND + nanoseconds
            found += f" stamped {stamp / SECOND:.9g} s"
            why = lost_or_foreign(stamp, due, self._step_ns)
        self._fail(f"{name}: {found} where {due / SECOND:.9g} s is due: {why}")

    def _fail(self, reason: str) -> None:
        """Take a failure down; of a flood of them, the first ones."""
        if len(self.failures) < NAMED:
            self.failures.append(reason)
