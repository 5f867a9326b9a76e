"""The bag: readable by rosbags and by mcap alone, complete, and standing alone."""

from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2
from ruamel.yaml import YAML

from cacc_platoon.bags.write import write_bag
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario, parse_scenario
from cacc_platoon.simulation import simulate

SCENARIO = Scenario.from_values({"platoon.followers": 2, "run.duration": 1.0, "leader.start": 0.1})
TEXT = format_scenario(SCENARIO)


@pytest.fixture(scope="module")
def trajectory():
    return simulate(SCENARIO)


@pytest.fixture(scope="module")
def bag(tmp_path_factory, trajectory):
    folder = tmp_path_factory.mktemp("run") / "bag"
    write_bag(
        folder,
        recording_of(trajectory),
        step_ns=SCENARIO.step_ns,
        depth=130,
        scenario_topic="/platoon/scenario",
        scenario_text=TEXT,
        custom_data={"digest": "0123"},
    )
    return folder


def test_rosbags_finds_every_message_in_time_order(bag, trajectory):
    with AnyReader([bag]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        assert counts.pop("/platoon/scenario") == 1
        assert len(counts) == 11
        assert set(counts.values()) == {101}
        times = [time for _, time, _ in reader.messages()]
        assert times == sorted(times)
        assert (times[0], times[-1]) == (0, 1_000_000_000)
        [connection] = [c for c in reader.connections if c.topic == "/platoon/vehicle_2/accel"]
        for k, (_, time, data) in enumerate(reader.messages([connection])):
            message: Any = reader.deserialize(data, connection.msgtype)
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            assert time == stamp == k * 10_000_000
            assert message.accel.linear.x == trajectory.acceleration[k, 2]


def test_a_second_reader_needs_nothing_but_the_file(bag, trajectory):
    [path] = bag.glob("*.mcap")
    positions: list[float] = []
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, _, message, value in reader.iter_decoded_messages("/platoon/vehicle_1/pose"):
            assert value.header.frame_id == "map"
            assert value.pose.orientation.w == 1.0
            assert message.log_time == len(positions) * 10_000_000
            positions.append(value.pose.position.x)
        summary: Any = reader.get_summary()
        assert summary.statistics.message_count == 11 * 101 + 1
    np.testing.assert_array_equal(positions, trajectory.position[:, 1])


def test_the_scenario_is_inside_twice(bag):
    text = (bag / "metadata.yaml").read_text()
    metadata = YAML(typ="safe").load(text)["rosbag2_bagfile_information"]
    assert metadata["version"] == 9
    custom = {"scenario": TEXT, "digest": "0123", "cacc_platoon_format": "1"}
    assert metadata["custom_data"] == custom
    assert parse_scenario(metadata["custom_data"]["scenario"], "scenario") == SCENARIO
    with AnyReader([bag]) as reader:
        [connection] = [c for c in reader.connections if c.topic == "/platoon/scenario"]
        [(_, time, data)] = reader.messages([connection])
        message: Any = reader.deserialize(data, connection.msgtype)
        assert (time, message.data) == (0, TEXT)


def test_the_offered_quality_of_service_is_recorded(bag):
    with AnyReader([bag]) as reader:
        for connection in reader.connections:
            assert isinstance(connection.ext, ConnectionExtRosbag2)
            [qos] = connection.ext.offered_qos_profiles
            latched = connection.topic == "/platoon/scenario"
            assert qos.durability.name == ("TRANSIENT_LOCAL" if latched else "VOLATILE")
            assert (qos.reliability.name, qos.history.name) == ("RELIABLE", "KEEP_LAST")
            assert qos.depth == (1 if latched else 130)


def test_topics_of_different_lengths_and_a_failing_progress_still_make_a_bag(tmp_path, trajectory):
    recording = recording_of(trajectory)
    name = "/platoon/vehicle_1/twist"
    recording[name] = recording[name]._replace(messages=recording[name].messages[:40])

    def interrupt(*_):
        raise KeyboardInterrupt

    for folder, progress in (("whole", None), ("interrupted", interrupt)):
        try:
            write_bag(
                tmp_path / folder,
                recording,
                step_ns=10_000_000,
                depth=1,
                scenario_topic="/s",
                scenario_text="",
                custom_data={},
                progress=progress,
            )
        except KeyboardInterrupt:
            assert progress is interrupt
        with AnyReader([tmp_path / folder]) as reader:
            counts = {c.topic: c.msgcount for c in reader.connections}
            assert counts[name] == (40 if progress is None else 1)
            assert len(list(reader.messages())) == sum(counts.values())
