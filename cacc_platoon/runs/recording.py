"""A trajectory as the messages that nodes would have published, and back."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cacc_platoon.bags.rows import Recording, TopicRows
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import Trajectory
from msg_adapters.topics import Graph, Topic


def recording_of(trajectory: Trajectory) -> dict[str, TopicRows]:
    """Return the messages that nodes would have published, to the last bit."""
    scenario = trajectory.scenario
    stamps = np.arange(len(trajectory.position), dtype=np.int64) * scenario.step_ns
    records: dict[str, TopicRows] = {}

    def add(topic: Topic, values: npt.NDArray[np.float64]) -> None:
        messages = topic.codec.encode_many(stamps, values)
        records[topic.name] = TopicRows(topic.kind.type_name, messages)

    for column, vehicle in enumerate(Graph.of(scenario).vehicles.values()):
        add(vehicle.pose, trajectory.position[:, column])
        add(vehicle.twist, trajectory.velocity[:, column])
        add(vehicle.accel, trajectory.acceleration[:, column])
        if column:
            add(vehicle.received, trajectory.received[:, column - 1])
    return records


def trajectory_of(recording: Recording, scenario: Scenario) -> Trajectory:
    """Return the arrays of a recording, cut to the samples that every topic has.

    Raises
    ------
    KeyError
        When a topic of the digest is missing.
    """
    graph = Graph.of(scenario)
    vehicles = list(graph.vehicles.values())
    samples = min(len(recording[topic.name].messages) for topic in graph.run_topics)

    def column(topic: Topic) -> npt.NDArray[np.float64]:
        return topic.codec.values(recording[topic.name].messages[:samples])

    return Trajectory(
        scenario,
        np.stack([column(vehicle.pose) for vehicle in vehicles], axis=1),
        np.stack([column(vehicle.twist) for vehicle in vehicles], axis=1),
        np.stack([column(vehicle.accel) for vehicle in vehicles], axis=1),
        np.stack([column(vehicle.received) for vehicle in vehicles[1:]], axis=1),
    )
