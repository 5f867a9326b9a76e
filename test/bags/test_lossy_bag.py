"""A bag of a lossy run holds the packets that arrived and no others, for three readers."""

from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from cacc_platoon.runs.recorded_run import read_run
from cacc_platoon.simulation import simulate
from msg_adapters.topics import Graph

STORE = get_typestore(Stores.ROS2_JAZZY)
CHANNELS: dict[str, dict[str, Any]] = {
    "overtaking": {"v2v.loss": 0.2, "v2v.jitter": 0.1},
    "cam": {"v2v.send_rule": "cam", "v2v.loss": 0.1, "v2v.latency": 0.02, "v2v.jitter": 0.03},
    "bursts": {"v2v.burst_begin": 0.3, "v2v.burst_end": 0.3, "v2v.blackouts": [1.0, 1.5]},
}


def nanoseconds(stamp):
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def by_rosbags(bag, topic):
    """Return log times, stamps and accelerations; it gives no publish times."""
    with Reader(bag) as reader:
        wanted = [one for one in reader.connections if one.topic == topic]
        for connection, log, data in reader.messages(wanted):
            message: Any = STORE.deserialize_cdr(data, connection.msgtype)
            yield log, nanoseconds(message.header.stamp), message.accel.linear.x


def by_mcap(bag, topic):
    """Return log times, publish times, stamps and accelerations."""
    [file] = bag.glob("*.mcap")
    with file.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, _, record, message in reader.iter_decoded_messages([topic]):
            stamp = nanoseconds(message.header.stamp)
            yield record.log_time, record.publish_time, stamp, message.accel.linear.x


@pytest.mark.slow
@pytest.mark.parametrize("name", CHANNELS)
def test_the_bag_holds_exactly_what_arrived(bags, tmp_path, name):
    """Log time is delivery, publish time and stamp are the source, values to the last bit."""
    one = bags.scenario({**CHANNELS[name], "run.duration": 8.0})
    bag = bags.run(tmp_path / "run", one).bag
    run, read = simulate(one), read_run(bag)
    assert read.findings == ()
    assert run.arrivals is not None
    assert read.trajectory.arrivals is not None
    for arrivals, ours, topics in zip(
        run.arrivals, read.trajectory.arrivals, Graph.of(one).links.values(), strict=True
    ):
        source, sample = (times * one.step_ns for times in arrivals[:2])
        expected = [source, sample, arrivals.value]
        log, publish, stamp, value = map(
            np.array, zip(*by_mcap(bag, topics.accel.name), strict=True)
        )
        np.testing.assert_array_equal(stamp, publish)
        for found, due in zip((publish, log, value), expected, strict=True):
            np.testing.assert_array_equal(found, due)
        rows = zip(*by_rosbags(bag, topics.accel.name), strict=True)
        log, stamp, value = map(np.array, rows)
        for found, due in zip((stamp, log, value), expected, strict=True):
            np.testing.assert_array_equal(found, due)
        for found, due in zip(ours, arrivals, strict=True):
            np.testing.assert_array_equal(found, due)
    assert any((np.diff(one.source) < 0).any() for one in run.arrivals) == (name == "overtaking")
