"""Records what a host's own nodes publish, as it arrives, and says how far it is."""

from __future__ import annotations

from pathlib import Path

from rclpy.node import Node
from std_msgs.msg import Int64

from cacc_platoon.nodes import qos
from cacc_platoon.nodes.node import MESSAGE_TYPES
from cacc_platoon.runs.parts import PartWriter
from cacc_platoon.runs.past import Past, Receive
from cacc_platoon.runs.sample_reader import Reading, SampleReader
from cacc_platoon.runs.sample_recorder import SampleRecorder
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import host_name
from msg_adapters.topics import Graph, Topic, is_packets


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
    past : Past, optional
        What was recorded before this process was started again; it is recorded anew first.

    Attributes
    ----------
    failures : list of str
        What went wrong; the first one ends the run.
    recorded : list of str
        Names of the topics.
    """

    def __init__(
        self,
        scenario: Scenario,
        host: str,
        topics: list[Topic],
        folder: Path,
        past: Past | None = None,
        *,
        run: str = "",
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
        for topic in topics:
            receive = self._recorder.receiver(topic)
            if past:
                receive = self._again(topic, receive, past)
            self.create_subscription(
                MESSAGE_TYPES[topic.kind.type_name],
                topic.name,
                receive,
                qos.stream(scenario),
                raw=True,
            )

    @staticmethod
    def _again(topic: Topic, receive: Receive, past: Past) -> Receive:
        """Record what was recorded of a topic before, and return what receives the rest."""
        for data in past.rows(topic.name):
            receive(data)
        return past.since(receive, topic.codec) if is_packets(topic.name) else receive

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
