"""A run as messages: to bytes and back without loss, one digest, parts that survive a crash."""

import dataclasses
import hashlib

import numpy as np
import pytest

from cacc_platoon.bags.digest import run_digest
from cacc_platoon.bags.rows import TopicRows
from cacc_platoon.model import Topology
from cacc_platoon.runs.parts import PartWriter, read_parts
from cacc_platoon.runs.recording import (
    count_of_each_sample,
    first_samples,
    recorded_samples,
    recording_of,
    with_deliveries,
)
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import simulate
from msg_adapters.topics import Graph, VehicleTopics

THREE = Graph("/platoon", Topology(range(1, 4)))
SCENARIO = Scenario.from_values(
    {"platoon.followers": 3, "run.duration": 2.0, "leader.start": 0.5, "v2v.hold": 0.05}
)


@pytest.fixture(scope="module")
def trajectory():
    return simulate(SCENARIO)


@pytest.fixture(scope="module")
def recording(trajectory):
    return recording_of(trajectory)


def test_every_topic_of_the_digest_is_there(recording):
    names = {
        *(f"/platoon/vehicle_{i}/{name}" for i in range(4) for name in ("pose", "twist", "accel")),
        *(f"/platoon/vehicle_{i}/v2v/accel" for i in (1, 2, 3)),
    }
    assert set(recording) == names
    assert {topic.name for topic in THREE.run_topics} == names
    assert {len(record.messages) for record in recording.values()} == {201}


def test_messages_are_what_each_vehicle_would_publish(trajectory, recording):
    for index in range(4):
        topics = VehicleTopics("/platoon", index)
        for topic, values in (
            (topics.pose, trajectory.position[:, index]),
            (topics.twist, trajectory.velocity[:, index]),
            (topics.accel, trajectory.acceleration[:, index]),
        ):
            rows = recording[topic.name].messages
            assert rows[7].tobytes() == topic.codec.encode(70_000_000, values[7])
    received = VehicleTopics("/platoon", 2).received
    assert recording[received.name].messages[9].tobytes() == received.codec.encode(
        90_000_000, trajectory.received[9, 1]
    )


def test_the_digest_is_the_hash_of_the_sorted_topic_hashes(recording):
    lines = [
        f"{name} {hashlib.sha256(recording[name].messages.tobytes()).hexdigest()}\n"
        for name in sorted(recording)
    ]
    expected = hashlib.sha256("".join(lines).encode()).hexdigest()
    assert run_digest(recording, THREE) == expected
    assert run_digest(dict(reversed(recording.items())), THREE) == expected


def test_topics_beside_the_run_do_not_count(recording):
    more = {**recording, "/clock": TopicRows("rosgraph_msgs/msg/Clock", np.zeros((3, 8), "u1"))}
    assert run_digest(more, THREE) == run_digest(recording, THREE)


def test_one_bit_changes_the_digest(recording):
    for name in recording:
        messages = recording[name].messages.copy()
        messages[100, -1] ^= 1
        changed = {**recording, name: recording[name]._replace(messages=messages)}
        assert run_digest(changed, THREE) != run_digest(recording, THREE)


def test_another_seed_another_digest():
    digests = {
        run_digest(recording_of(simulate(scenario)), THREE)
        for seed in (1, 2, 3)
        for scenario in [
            dataclasses.replace(SCENARIO, run=dataclasses.replace(SCENARIO.run, seed=seed))
        ]
    }
    assert len(digests) == 3


def test_parts_hold_what_was_written_wherever_they_were_cut(tmp_path, recording):
    topics = THREE.run_topics
    halves = [topics[::2], topics[1::2]]
    folders = [tmp_path / "a", tmp_path / "b"]
    for folder, half in zip(folders, halves, strict=True):
        part = PartWriter(folder, half)
        for topic in half:
            for message in recording[topic.name].messages:
                part.writers[topic.name](message.tobytes())
        part.close()
        part.close()
    assert run_digest(read_parts(folders), THREE) == run_digest(recording, THREE)

    file = next((tmp_path / "a").glob("*.cdr"))
    file.write_bytes(file.read_bytes()[:-5])
    counts = sorted(len(record.messages) for record in read_parts(folders).values())
    assert counts == [200, *[201] * (len(topics) - 1)]
    file.unlink()
    assert 0 in {len(record.messages) for record in read_parts(folders).values()}


def test_a_folder_that_is_no_part_is_passed_over(tmp_path):
    (tmp_path / "empty").mkdir()
    assert read_parts([tmp_path / "empty"]) == {}


def test_a_part_is_never_overwritten(tmp_path):
    PartWriter(tmp_path / "a", []).close()
    with pytest.raises(FileExistsError):
        PartWriter(tmp_path / "a", [])


@pytest.mark.parametrize("channel", [{}, {"v2v.loss": 0.3, "v2v.latency": 0.05}])
def test_the_first_samples_of_a_recording_are_those_of_a_run_that_ends_there(channel):
    crash = {
        "platoon.followers": 3,
        "platoon.standstill_distance": 0.5,
        "controller.time_headway": 0.3,
        "vehicle.length": 4.5,
        "leader.profile": "brake",
        "leader.start": 1.0,
        "leader.deceleration": 9.0,
        "run.duration": 6.0,
    }
    ended = Scenario.from_values({**crash, **channel})
    wanted = recording_of(simulate(ended))
    whole = recording_of(simulate(ended.with_values({"run.stop_on_collision": False})))
    samples = len(wanted["/platoon/vehicle_1/pose"].messages)
    assert 100 < samples < 601
    found = first_samples(whole, Graph.of(ended), samples * ended.step_ns)
    assert found.keys() == wanted.keys()
    for name, rows in wanted.items():
        np.testing.assert_array_equal(found[name].messages, rows.messages, err_msg=name)


def test_counts_that_stand_for_more_samples_are_those_of_every_sample() -> None:
    """Of a bag as nodes write it: the same deliveries, the same samples, the same counts."""
    one = Scenario.from_values({"v2v.loss": 0.6, "run.duration": 2.0, "platoon.followers": 1})
    graph, whole = Graph.of(one), recording_of(simulate(one))
    ((accel, complete),) = graph.counted_links.values()
    each = whole[complete.name].messages
    counts = complete.codec.values(each)
    first = np.flatnonzero(np.diff(counts, prepend=-1.0))
    more = np.diff(first, append=len(counts)) - 1
    rows = np.stack(
        [
            np.frombuffer(
                complete.codec.encode(int(k) * one.step_ns, counts[k], float(n)), np.uint8
            )
            for k, n in zip(first, more, strict=True)
        ]
    )
    assert len(rows) < len(each)
    few = {**whole, complete.name: whole[complete.name]._replace(messages=rows)}
    found = count_of_each_sample(complete, rows, one.step_ns, one.samples)
    np.testing.assert_array_equal(found, each)
    assert len(count_of_each_sample(complete, rows, one.step_ns, 7)) == 7 + len(rows) - int(
        (first < 7).sum()
    )
    np.testing.assert_array_equal(
        with_deliveries(few, graph)[accel.name].delivered, whole[accel.name].delivered
    )
    assert recorded_samples(few, graph, one.samples) == dict.fromkeys(whole, one.samples)
