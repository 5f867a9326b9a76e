"""A trajectory as the messages that nodes would have published."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cacc_platoon.bags.rows import Recording, TopicRows
from cacc_platoon.simulation import Arrivals, Trajectory
from cacc_platoon.stepping.deliveries import MOST
from msg_adapters.topics import Graph, LinkTopics, Topic

MOST_SAMPLES = 2.0**31
"""For more samples stands no count."""


def recording_of(trajectory: Trajectory) -> dict[str, TopicRows]:
    """Return the messages that nodes would have published, to the last bit."""
    scenario = trajectory.scenario
    stamps = np.arange(len(trajectory.position), dtype=np.int64) * scenario.step_ns
    records: dict[str, TopicRows] = {}

    def add(topic: Topic, values: npt.ArrayLike, beside: npt.ArrayLike = 0.0) -> None:
        messages = topic.codec.encode_many(stamps, values, beside)
        records[topic.name] = TopicRows(topic.kind.type_name, messages)

    def add_arrivals(topic: Topic, arrivals: Arrivals) -> None:
        source, sample, value = arrivals
        messages = topic.codec.encode_many(source * scenario.step_ns, value)
        delivered = sample * scenario.step_ns
        records[topic.name] = TopicRows(topic.kind.type_name, messages, delivered)

    graph = Graph.of(scenario)
    for column, vehicle in enumerate(graph.vehicles.values()):
        add(vehicle.pose, trajectory.position[:, column])
        add(vehicle.twist, trajectory.velocity[:, column])
        add(vehicle.accel, trajectory.acceleration[:, column])
    if trajectory.timing:
        for index, age, late in zip(
            scenario.indices, trajectory.timing.age.T, trajectory.timing.lateness.T, strict=True
        ):
            add(graph.vehicles[index].timing, age, late)
    for number, (link, topics) in enumerate(graph.links.items()):
        sample = np.arange(len(stamps))
        if trajectory.arrivals is None:
            add(topics.accel, trajectory.received[:, number])
        else:
            add_arrivals(topics.accel, trajectory.arrivals[number])
            sample = trajectory.arrivals[number].sample
        if link in graph.counted_links:
            add(topics.complete, np.searchsorted(sample, np.arange(len(stamps)), "right"))
    return records


def with_deliveries(recording: Recording, graph: Graph) -> dict[str, TopicRows]:
    """Return a recording in which counted messages know the samples they were delivered at.

    A message is delivered at the first sample by which its relay has counted it; messages that no
    count covers, since the recording ends before, are left out. Where counts do not fit the
    messages, as in a recording that begins late, nothing is known of their delivery.
    """
    records = dict(recording)
    for topics in graph.counted_links.values():
        received, counts = recording.get(topics.accel.name), recording.get(topics.complete.name)
        if received is None or counts is None:
            continue
        delivered = _delivered(received, counts, topics)
        if delivered is not None:
            messages = received.messages[: len(delivered)]
            records[topics.accel.name] = TopicRows(received.type_name, messages, delivered)
    return records


def first_samples(recording: Recording, graph: Graph, end: int) -> dict[str, TopicRows]:
    """Return what was published of the samples before a stamp [ns], and delivered at them."""
    records = dict(recording)
    for topic in graph.recorded:
        if topic.name in recording:
            messages = recording[topic.name].messages
            before = messages[topic.codec.stamps(messages) < end]
            records[topic.name] = recording[topic.name]._replace(messages=before)
    for topics in graph.counted_links.values():
        received, counts = recording.get(topics.accel.name), records.get(topics.complete.name)
        if received is not None and counts is not None and len(counts.messages):
            published = int(topics.complete.codec.values(counts.messages)[-1])
            records[topics.accel.name] = received._replace(messages=received.messages[:published])
    return records


def recorded_samples(recording: Recording, graph: Graph, run: int) -> dict[str, int]:
    """Return up to which sample each topic is complete, by the number of its samples.

    What counts say of samples beyond those of the `run`, which may have ended sooner, is no sample.
    """
    samples = {name: len(record.messages) for name, record in recording.items()}
    for topics in graph.counted_links.values():
        counts = recording.get(topics.complete.name)
        if counts is not None:
            stands_for = 1 + samples_more(topics.complete, counts.messages)
            samples[topics.complete.name] = min(run, int(stands_for.sum()))
            if topics.accel.name in samples:
                published = topics.complete.codec.values(counts.messages)
                here = samples[topics.accel.name]
                samples[topics.accel.name] = min(run, int(stands_for[published <= here].sum()))
    return samples


def _delivered(
    received: TopicRows, counts: TopicRows, topics: LinkTopics
) -> npt.NDArray[np.int64] | None:
    """Return the stamps at which messages were delivered; None where counts do not fit them."""
    published = topics.complete.codec.values(counts.messages)
    stamps: npt.NDArray[np.int64] = topics.complete.codec.stamps(counts.messages)
    if not len(stamps):
        return stamps
    steps = np.diff(stamps) / (1 + samples_more(topics.complete, counts.messages)[:-1])
    if stamps[0] != 0 or (steps != steps[:1]).any():
        return None
    if not_counts(published).any():
        return None
    known = int(min(len(received.messages), published[-1]))
    delivered = stamps[np.searchsorted(published, np.arange(1, known + 1))]
    sent = topics.accel.codec.stamps(received.messages[:known])
    return None if (delivered < sent).any() else delivered


def samples_more(complete: Topic, counts: npt.NDArray[np.uint8]) -> npt.NDArray[np.int64]:
    """Return for how many samples more each count of a relay stands, shape (n, size) -> (n,)."""
    more = complete.codec.values(counts, "y")
    whole = (more >= 0.0) & (more < MOST_SAMPLES) & (np.floor(more) == more)
    return np.where(whole, more, 0.0).astype(np.int64)


def count_of_each_sample(
    complete: Topic, counts: npt.NDArray[np.uint8], step_ns: int, samples: int
) -> npt.NDArray[np.uint8]:
    """Return the counts of a relay as they are where it publishes one of every sample.

    Those that do not follow each other are left as they are.

    Parameters
    ----------
    complete : Topic
        Of the counts.
    counts : ndarray of uint8, shape (n, size)
        Messages in order.
    step_ns : int
        Control period [ns].
    samples : int
        Of the run; none beyond is returned.
    """
    more = samples_more(complete, counts)
    if not more.any():
        return counts
    stamps, published = complete.codec.stamps(counts), complete.codec.values(counts)
    due = np.cumsum(1 + more) - 1 - more
    astray = (stamps != stamps[0] + due * step_ns) | (due >= samples)
    known = int(astray.argmax()) if astray.any() else len(stamps)
    sample = np.arange(min(samples, int((1 + more[:known]).sum())))
    row = np.searchsorted(due[:known], sample, "right") - 1
    each = complete.codec.encode_many(stamps[0] + sample * step_ns, published[row])
    return np.concatenate((each, counts[known:]))


def not_counts(published: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Mark what is no whole number >= 0, or less than the one before, shape (samples,)."""
    before = np.concatenate(([0.0], published[:-1]))
    whole = (published < MOST) & (np.floor(published) == published)
    wrong: npt.NDArray[np.bool_] = np.logical_not(whole & (published >= before))
    return wrong
