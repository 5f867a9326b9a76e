"""Records what a host's own nodes publish, and says how far it is."""

from __future__ import annotations

from pathlib import Path

from rclpy.node import Node
from std_msgs.msg import Int64

from cacc_platoon.nodes import qos
from cacc_platoon.nodes.node import MESSAGE_TYPES
from cacc_platoon.runs.journal import Receive
from cacc_platoon.runs.parts import PartWriter
from cacc_platoon.runs.sample_reader import Reading, SampleReader
from cacc_platoon.runs.sample_recorder import SampleRecorder
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import host_name
from msg_adapters.topics import Graph, Topic


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
    run : str, optional
        What tells the run from every other, where that is known.
    told : bool, optional
        Whether `receivers` are given the messages, which it subscribes to otherwise.

    Attributes
    ----------
    failures : list of str
        What went wrong; the first one ends the run.
    recorded : list of str
        Names of the topics.
    receivers : dict of str to callable
        What takes the messages of each of them.
    """

    def __init__(
        self,
        scenario: Scenario,
        host: str,
        topics: list[Topic],
        folder: Path,
        *,
        run: str = "",
        told: bool = False,
    ) -> None:
        namespace = f"{scenario.platoon.namespace}/{host_name(host)}"
        super().__init__("recorder", namespace=namespace, use_global_arguments=False)
        self.folder = folder.absolute()
        self.recorded = [topic.name for topic in topics]
        self.scenario = scenario
        self._part = PartWriter(folder, topics, run, buffered=not scenario.run.restarts)
        self._reader = SampleReader(self._part, topics, Graph.of(scenario), scenario.step_ns)
        progress = self.create_publisher(Int64, "recorded", qos.latched())
        self._recorder = SampleRecorder(
            scenario,
            topics,
            self._part.writers,
            self.folder,
            lambda sample: progress.publish(Int64(data=sample)),
        )
        self.failures = self._recorder.failures
        self.receivers: dict[str, Receive] = {
            topic.name: self._recorder.receiver(topic) for topic in topics
        }
        for topic in () if told else topics:
            message_type, receive = MESSAGE_TYPES[topic.kind.type_name], self.receivers[topic.name]
            self.create_subscription(
                message_type, topic.name, receive, qos.stream(scenario), raw=True
            )

    def end_at(self, samples: int) -> None:
        """Say so when all topics have the samples of a run that ends sooner than was planned."""
        self._recorder.end_at(samples)

    def flush(self) -> None:
        """Hand what was recorded to the operating system."""
        try:
            self._part.flush()
        except OSError as error:
            self._recorder.not_written(error)

    def readings(self, sample: int) -> dict[str, Reading]:
        """Return what is recorded of each vehicle at a sample, or before; see `SampleReader`."""
        self.flush()
        try:
            return self._reader.at(sample)
        except OSError as error:
            self._recorder.not_written(error)
            return {}

    def close(self) -> None:
        """Close the part."""
        self._part.close()
