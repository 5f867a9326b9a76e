"""A whole run as messages: per topic, the CDR bytes of all samples; and back to a trajectory."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import Trajectory
from msg_adapters.topics import Topic, VehicleTopics, digest_topics, run_topics

INDEX_FILE = "topics.json"


class TopicRecord(NamedTuple):
    """The messages of one topic: row k, of shape (size,), is the message of sample k."""

    type_name: str
    messages: npt.NDArray[np.uint8]


Recording: TypeAlias = Mapping[str, TopicRecord]


def recording_of(trajectory: Trajectory) -> dict[str, TopicRecord]:
    """Return the messages that nodes would have published, to the last bit."""
    scenario = trajectory.scenario
    stamps = np.arange(len(trajectory.position), dtype=np.int64) * scenario.step_ns
    records: dict[str, TopicRecord] = {}

    def add(topic: Topic, values: npt.NDArray[np.float64]) -> None:
        messages = topic.codec.encode_many(stamps, values)
        records[topic.name] = TopicRecord(topic.kind.type_name, messages)

    for column, index in enumerate(scenario.vehicles):
        vehicle = VehicleTopics(scenario.platoon.namespace, index)
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
    prefix = scenario.platoon.namespace
    vehicles = [VehicleTopics(prefix, index) for index in scenario.vehicles]
    samples = min(len(recording[topic.name].messages) for topic in run_topics(scenario))

    def column(topic: Topic) -> npt.NDArray[np.float64]:
        return topic.codec.values(recording[topic.name].messages[:samples])

    return Trajectory(
        scenario,
        np.stack([column(vehicle.pose) for vehicle in vehicles], axis=1),
        np.stack([column(vehicle.twist) for vehicle in vehicles], axis=1),
        np.stack([column(vehicle.accel) for vehicle in vehicles], axis=1),
        np.stack([column(vehicle.received) for vehicle in vehicles[1:]], axis=1),
    )


def digest(recording: Recording, prefix: str, followers: int, first: int = 1) -> str:
    """Return the SHA-256 over pose, twist, accel and v2v/accel of all vehicles.

    Each topic is hashed over its messages in stamp order; the digest is the hash of the lines
    `<topic> <hash>`, sorted by topic. Two runs agree to the last bit exactly when their digests do.
    """
    return digest_of(recording, [topic.name for topic in digest_topics(prefix, followers, first)])


def digest_of(recording: Recording, names: Iterable[str]) -> str:
    """Return the SHA-256 over some topics of a recording, made as that of a run."""
    lines = sorted(
        f"{name} {topic_digest(recording[name])}\n" for name in names if name in recording
    )
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def topic_digest(record: TopicRecord) -> str:
    """Return the SHA-256 of one topic's messages in stamp order."""
    return hashlib.sha256(np.ascontiguousarray(record.messages).data).hexdigest()


class PartWriter:
    """Takes down the messages of some topics in a folder, one file per topic, append-only.

    A part needs no closing to be readable: what was flushed is there, whatever happened later.

    Parameters
    ----------
    folder : Path
        Made by the writer; must not exist.
    topics : list of Topic
        What will be written.
    """

    def __init__(self, folder: Path, topics: list[Topic]) -> None:
        folder.mkdir(parents=True)
        index = [
            {
                "name": topic.name,
                "type": topic.kind.type_name,
                "size": topic.codec.size,
                "file": f"{number:04d}.cdr",
            }
            for number, topic in enumerate(topics)
        ]
        (folder / INDEX_FILE).write_text(json.dumps(index, indent=1))
        self._files = {
            str(entry["name"]): (folder / str(entry["file"])).open("wb") for entry in index
        }
        self.writers = {name: file.write for name, file in self._files.items()}

    def flush(self) -> None:
        """Hand everything to the operating system; harmless once closed."""
        for file in self._files.values():
            if not file.closed:
                file.flush()

    def close(self) -> None:
        """Flush and close as far as the disk lets it; harmless when done twice."""
        for file in self._files.values():
            with contextlib.suppress(OSError):
                file.close()


def read_parts(folders: list[Path]) -> dict[str, TopicRecord]:
    """Return what the parts hold, mapped from disk; a message cut short at the end is left out."""
    records: dict[str, TopicRecord] = {}
    for folder in folders:
        index = folder / INDEX_FILE
        if not index.is_file():
            continue
        for entry in json.loads(index.read_text()):
            path, size = folder / entry["file"], entry["size"]
            count = path.stat().st_size // size if path.is_file() else 0
            messages = (
                np.memmap(path, np.uint8, "r", shape=(count, size))
                if count
                else np.empty((0, size), np.uint8)
            )
            records[entry["name"]] = TopicRecord(entry["type"], messages)
    return records
