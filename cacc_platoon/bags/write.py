"""A recording as a rosbag2 bag (MCAP, metadata version 9) that stands alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from cacc_platoon.bags.rows import FORMAT, FORMAT_KEY, Recording
from msg_adapters.text import encode_string

STRING_TYPE = "std_msgs/msg/String"
_FOREVER = QosTime(9223372036, 854775807)
_PROGRESS_STRIDE = 500


class Events(NamedTuple):
    """What happened in a run: the latched topic that says so, sample and text of each event."""

    topic: str
    texts: Sequence[tuple[int, str]]


NO_EVENTS = Events("", ())


def write_bag(
    folder: Path,
    recording: Recording,
    *,
    step_ns: int,
    depth: int,
    scenario_topic: str,
    scenario_text: str,
    custom_data: dict[str, str],
    events: Events = NO_EVENTS,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write a new bag, its messages in the order of (delivery stamp, topic).

    The log time of a message is the time of the sample at which it is delivered; its header stamp
    is the time of the sample at which it was sent. The bag is closed and readable even when writing
    is interrupted.

    Parameters
    ----------
    folder : Path
        The bag's folder; must not exist.
    recording : Recording
        What to write; topics may have different numbers of samples.
    step_ns : int
        Control period [ns].
    depth : int
        Queue depth of the topics, part of their offered QoS.
    scenario_topic, scenario_text : str
        The latched topic that carries the scenario, and the scenario file's text.
    custom_data : dict of str to str
        Goes into the bag's metadata beside the scenario.
    events : Events, optional
        What happened.
    progress : callable, optional
        Called periodically with the sample reached and the number of samples.
    """
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    version = {FORMAT_KEY: str(FORMAT.version)}
    for key, value in {"scenario": scenario_text, **version, **custom_data}.items():
        writer.set_custom_data(key, value)
    writer.open()
    try:
        latched = _add(writer, scenario_topic, STRING_TYPE, QosDurability.TRANSIENT_LOCAL, 1)
        writer.write(latched, 0, encode_string(scenario_text))
        if events.texts:
            told = _add(writer, events.topic, STRING_TYPE, QosDurability.TRANSIENT_LOCAL, 1)
            for sample, text in events.texts:
                writer.write(told, sample * step_ns, encode_string(text))
        connections = [
            _add(writer, name, record.type_name, QosDurability.VOLATILE, depth)
            for name, record in sorted(recording.items())
        ]
        _write_samples(writer, connections, recording, step_ns, progress)
    finally:
        writer.close()


def _write_samples(
    writer: Writer,
    connections: list[Connection],
    recording: Recording,
    step_ns: int,
    progress: Callable[[int, int], None] | None,
) -> None:
    columns: list[tuple[Connection, memoryview, int, int, list[int] | None]] = []
    samples = 0
    for connection in connections:
        _, messages, delivered = recording[connection.topic]
        count, size = messages.shape
        ends = None if delivered is None else _ends(delivered, step_ns)
        samples = max(samples, count if ends is None else len(ends) - 1)
        columns.append((connection, messages.reshape(-1).data, size, count, ends))
    for k in range(samples):
        for connection, data, size, count, ends in columns:
            if ends is None:
                if k < count:
                    writer.write(connection, k * step_ns, data[k * size : (k + 1) * size])
            elif k + 1 < len(ends):
                for row in range(ends[k], ends[k + 1]):
                    writer.write(connection, k * step_ns, data[row * size : (row + 1) * size])
        if progress and k % _PROGRESS_STRIDE == 0:
            progress(k, samples)


def _ends(delivered: npt.NDArray[np.int64], step_ns: int) -> list[int]:
    """Return where the rows of sample k begin, for each k and one more."""
    samples = int(delivered[-1]) // step_ns + 1 if len(delivered) else 0
    ends: list[int] = np.searchsorted(delivered, np.arange(samples + 1) * step_ns).tolist()
    return ends


@lru_cache(maxsize=1)
def typestore() -> Typestore:
    """Return the message definitions of Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


def _add(
    writer: Writer, topic: str, type_name: str, durability: QosDurability, depth: int
) -> Connection:
    qos = Qos(
        QosHistory.KEEP_LAST,
        depth,
        QosReliability.RELIABLE,
        durability,
        _FOREVER,
        _FOREVER,
        QosLiveliness.AUTOMATIC,
        _FOREVER,
        avoid_ros_namespace_conventions=False,
    )
    return writer.add_connection(
        topic, type_name, typestore=typestore(), offered_qos_profiles=[qos]
    )
