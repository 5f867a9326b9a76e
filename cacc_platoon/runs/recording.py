"""A trajectory as the messages that nodes would have published."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cacc_platoon.bags.rows import Recording, TopicRows
from cacc_platoon.simulation import Arrivals, Trajectory
from cacc_platoon.simulation.trajectory import Array
from msg_adapters.topics import Graph, Topic, VehicleTopics


def recording_of(trajectory: Trajectory) -> dict[str, TopicRows]:
    """Return the messages that nodes would have published, to the last bit."""
    scenario = trajectory.scenario
    stamps = np.arange(len(trajectory.position), dtype=np.int64) * scenario.step_ns
    records: dict[str, TopicRows] = {}

    def add(topic: Topic, values: npt.ArrayLike) -> None:
        messages = topic.codec.encode_many(stamps, values)
        records[topic.name] = TopicRows(topic.kind.type_name, messages)

    graph = Graph.of(scenario)
    for column, (index, vehicle) in enumerate(graph.vehicles.items()):
        add(vehicle.pose, trajectory.position[:, column])
        add(vehicle.twist, trajectory.velocity[:, column])
        add(vehicle.accel, trajectory.acceleration[:, column])
        if column and trajectory.arrivals is None:
            add(vehicle.received, trajectory.received[:, column - 1])
        elif column and trajectory.arrivals is not None:
            source, sample, value = trajectory.arrivals[column - 1]
            topic = vehicle.received
            messages = topic.codec.encode_many(source * scenario.step_ns, value)
            delivered = sample * scenario.step_ns
            records[topic.name] = TopicRows(topic.kind.type_name, messages, delivered)
        if index in graph.counted:
            add(vehicle.complete, np.searchsorted(sample, np.arange(len(stamps)), "right"))
    return records


def with_deliveries(recording: Recording, graph: Graph) -> dict[str, TopicRows]:
    """Return a recording in which counted messages know the samples they were delivered at.

    A message is delivered at the first sample by which its relay has counted it; messages that no
    count covers, since the recording ends before, are left out.
    """
    records = dict(recording)
    for index in graph.counted:
        vehicle = graph.vehicles[index]
        received, counts = recording.get(vehicle.received.name), _counts(recording, vehicle)
        if received is None or counts is None:
            continue
        stamps = vehicle.complete.codec.stamps(recording[vehicle.complete.name].messages)
        known = min(len(received.messages), int(counts[-1]) if len(counts) else 0)
        delivered = stamps[np.searchsorted(counts, np.arange(1, known + 1))]
        records[vehicle.received.name] = TopicRows(
            received.type_name, received.messages[:known], delivered
        )
    return records


def recorded_samples(recording: Recording, graph: Graph) -> dict[str, int]:
    """Return up to which sample each topic is complete, by the number of its samples."""
    samples = {name: len(record.messages) for name, record in recording.items()}
    for index in graph.counted:
        vehicle = graph.vehicles[index]
        counts = _counts(recording, vehicle)
        if counts is not None and vehicle.received.name in samples:
            here = samples[vehicle.received.name]
            samples[vehicle.received.name] = int((counts <= here).sum())
    return samples


def _counts(recording: Recording, vehicle: VehicleTopics) -> Array | None:
    """Return how many messages the relay had published by each sample."""
    record = recording.get(vehicle.complete.name)
    return None if record is None else vehicle.complete.codec.values(record.messages)


def arrivals_of(received: TopicRows, topic: Topic, step_ns: int) -> Arrivals:
    """Return what arrived at a follower; `received` as `with_deliveries` gives it."""
    source = topic.codec.stamps(received.messages) // step_ns
    sample = source if received.delivered is None else received.delivered // step_ns
    return Arrivals(source, sample, topic.codec.values(received.messages))
