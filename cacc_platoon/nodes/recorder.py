"""Takes down what a host's own nodes publish, as it arrives, and says how far it is."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

from rclpy.node import Node
from std_msgs.msg import Int64

from cacc_platoon.nodes import qos
from cacc_platoon.nodes.node import MESSAGE_TYPES
from cacc_platoon.runs.parts import PartWriter
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import host_name
from msg_adapters.stamped import SECOND
from msg_adapters.topics import Topic

_STAMP = struct.Struct("<4xiI")


class RecorderNode(Node):  # type: ignore[misc]
    """Records topics into a part; publishes the sample up to which it holds all of them.

    Parameters
    ----------
    scenario : Scenario
        The run.
    host : str
        Name of the host; the node lives in <prefix>/host_<name>.
    topics : list of Topic
        What to record.
    folder : Path
        The part's folder; must not exist.
    """

    def __init__(self, scenario: Scenario, host: str, topics: list[Topic], folder: Path) -> None:
        namespace = f"{scenario.platoon.namespace}/{host_name(host)}"
        super().__init__("recorder", namespace=namespace, use_global_arguments=False)
        self.folder = folder.absolute()
        self.failures: list[str] = []
        self.recorded = [topic.name for topic in topics]
        self.samples = dict.fromkeys(self.recorded, 0)
        self.scenario = scenario
        self._part = PartWriter(folder, topics)
        self._stride = max(1, scenario.run.window // 4)
        self._last = scenario.samples - 1
        self._arrived: dict[int, int] = {}
        self._progress = self.create_publisher(Int64, "recorded", qos.latched())
        for topic in topics:
            self.create_subscription(
                MESSAGE_TYPES[topic.kind.type_name],
                topic.name,
                self._receiver(topic),
                qos.stream(scenario),
                raw=True,
            )

    def flush(self) -> None:
        """Hand what was recorded to the operating system."""
        try:
            self._part.flush()
        except OSError as error:
            self.failures.append(f"{self.folder}: cannot be written: {error.strerror}")

    def close(self) -> None:
        """Close the part."""
        self._part.close()

    def _receiver(self, topic: Topic) -> Callable[[bytes], None]:
        write = self._part.writers[topic.name]
        unpack, size, step = _STAMP.unpack_from, topic.codec.size, self.scenario.step_ns
        samples, name, last, stride = self.samples, topic.name, self._last, self._stride
        begin, end = topic.codec.padding
        zeros = bytes(end - begin)
        mark, failures, folder = self._mark, self.failures, self.folder

        def receive(data: bytes) -> None:
            seconds, nanoseconds = unpack(data)
            k = samples[name]
            if seconds * SECOND + nanoseconds != k * step or len(data) != size:
                stamp = seconds + nanoseconds / SECOND
                failures.append(
                    f"{name}: a message of {len(data)} bytes stamped {stamp:.9g} s where "
                    f"{k * step / SECOND:.9g} s is due: a message was lost or comes from another "
                    "publisher"
                )
                return
            if data[begin:end] != zeros:
                data = topic.codec.zero_padding(data)
            try:
                write(data)
            except OSError as error:
                failures.append(f"{folder}: cannot be written: {error.strerror}")
                return
            samples[name] = k + 1
            if k % stride == 0 or k == last:
                mark(k)

        return receive

    def _mark(self, k: int) -> None:
        """Count a topic in at sample k, and say so when it was the last one."""
        arrived = self._arrived.get(k, 0) + 1
        if arrived < len(self.recorded):
            self._arrived[k] = arrived
        else:
            self._arrived.pop(k, None)
            self._progress.publish(Int64(data=k))
