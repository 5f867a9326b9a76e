"""Any bag is read to the last bit, by every road."""

import struct

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from cacc_platoon.bags.raw import BagError
from cacc_platoon.runs.recorded_run import read_run
from cacc_platoon.simulation import simulate
from msg_adapters.topics import VehicleTopics

ARRAYS = ("position", "velocity", "acceleration", "received", "spacing_error", "platoon_length")


def assert_same(trajectory, other):
    for name in ARRAYS:
        one, two = getattr(trajectory, name), getattr(other, name)
        assert one.tobytes() == two.tobytes(), name
        assert one.flags.c_contiguous == two.flags.c_contiguous


def test_run_folder_gives_the_arrays_of_the_simulation(whole_run, scenario):
    run = read_run(whole_run / "bag", whole_run)
    assert run.findings == ()
    assert run.digest == run.digest_recorded != ""
    assert run.messages == 301 * (4 * 3 + 3)
    assert_same(run.trajectory, simulate(scenario))


@pytest.mark.parametrize(
    ("plugin", "compression"),
    [
        (StoragePlugin.SQLITE3, None),
        (StoragePlugin.MCAP, None),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    ],
)
def test_foreign_storage(bags, tmp_path, recording, plugin, compression):
    scenario = bags.scenario()
    bag = bags.foreign(tmp_path / "bag", scenario, recording, plugin, compression=compression)
    run = read_run(bag)
    assert run.findings == ()
    assert_same(run.trajectory, simulate(scenario))


def test_split_bag(bags, tmp_path, scenario, recording):
    """Two storage files in one folder, the later one first in the alphabet."""
    early = {n: r._replace(messages=r.messages[:120]) for n, r in recording.items()}
    late = {n: r._replace(messages=r.messages[120:]) for n, r in recording.items()}
    one = bags.bag(tmp_path / "z_early", scenario, early)
    two = bags.foreign(tmp_path / "a_late", scenario, late, StoragePlugin.MCAP)
    both = tmp_path / "both"
    both.mkdir()
    for file in (*one.glob("*.mcap"), *two.glob("*.mcap")):
        file.rename(both / file.name)
    run = read_run(both)
    assert run.findings == ("metadata.yaml is missing; the storage files were read without it",)
    assert_same(run.trajectory, simulate(scenario))


def test_one_storage_file_is_enough(whole_run, scenario):
    run = read_run(next((whole_run / "bag").glob("*.mcap")))
    assert_same(run.trajectory, simulate(scenario))


def test_namespace_and_vehicle_count_come_from_the_topics(bags, tmp_path):
    scenario = bags.scenario({"platoon.namespace": "/city/east", "platoon.followers": 2})
    bag = bags.foreign(tmp_path / "bag", scenario, bags.record(scenario), with_scenario=False)
    with pytest.raises(BagError, match=r"holds no scenario.*--scenario FILE"):
        read_run(bag)
    run = read_run(bag, scenario=bags.scenario())  # 3 followers below /platoon
    assert run.trajectory.scenario.platoon.namespace == "/city/east"
    assert run.trajectory.position.shape == (301, 3)
    assert run.findings == ()


def test_other_frames_and_byte_order(bags, tmp_path, scenario, recording):
    """A pose in a frame of another length, big-endian, y, z and rotation set."""
    topic = VehicleTopics("/platoon", 1).pose
    values = topic.codec.values(recording[topic.name].messages)
    frame = b"world_frame\0"
    rows = []
    for k, x in enumerate(values):
        stamp = k * scenario.step_ns
        head = (
            b"\0\0\0\0" + struct.pack(">iI", *divmod(stamp, 10**9)) + struct.pack(">I", len(frame))
        )
        head += frame
        head += bytes(-(len(head) - 4) % 8)
        rows.append(head + struct.pack(">7d", x, 1.0, 2.0, 0.1, 0.2, 0.3, 0.9))
    foreign = bags.edited(
        recording, topic.name, lambda _: np.array([np.frombuffer(row, np.uint8) for row in rows])
    )
    run = read_run(bags.bag(tmp_path / "bag", scenario, foreign))
    assert run.trajectory.position[:, 1].tobytes() == values.tobytes()


def test_second_reader_agrees(whole_run):
    """mcap with mcap-ros2-support, which knows nothing of ours, decodes the same numbers."""
    run = read_run(whole_run / "bag").trajectory
    seen: dict[str, list[float]] = {}
    with next((whole_run / "bag").glob("*.mcap")).open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            if channel.topic.endswith("/pose"):
                seen.setdefault(channel.topic, []).append(message.pose.position.x)
            elif channel.topic.endswith("v2v/accel"):
                seen.setdefault(channel.topic, []).append(message.accel.linear.x)
    for index in range(4):
        topics = VehicleTopics("/platoon", index)
        assert seen[topics.pose.name] == run.position[:, index].tolist()
        if index:
            assert seen[topics.received.name] == run.received[:, index - 1].tolist()


def test_wall_time_stamps_are_interpolated(bags, tmp_path, scenario, recording):
    """Stamps with jitter, counted from an epoch: reported, and near the truth."""
    generator = np.random.default_rng(5)
    jittered = dict(recording)
    for index in range(4):
        vehicle = VehicleTopics("/platoon", index)
        own = [vehicle.pose, vehicle.twist, vehicle.accel] + ([vehicle.received] if index else [])
        for topic in own:
            rows = recording[topic.name].messages
            stamps = topic.codec.stamps(rows) + 1_700_000_000 * 10**9
            stamps += generator.integers(-1_000_000, 1_000_000, len(rows))
            rows = topic.codec.encode_many(stamps, topic.codec.values(rows))
            jittered[topic.name] = recording[topic.name]._replace(messages=rows)
    run = read_run(bags.bag(tmp_path / "bag", scenario, jittered))
    assert any("no common grid" in line for line in run.findings)
    assert not run.grid.exact
    truth = simulate(scenario)
    both = min(len(truth.velocity), len(run.trajectory.velocity))
    difference = np.abs(run.trajectory.velocity[:both] - truth.velocity[:both])
    assert np.nanmax(difference) < 0.05
