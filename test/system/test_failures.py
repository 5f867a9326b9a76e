"""What goes wrong with real processes, and what then happens."""

import json
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from geometry_msgs.msg import Vector3Stamped
from rosbags.rosbag2 import Reader
from std_msgs.msg import Int64, String

from cacc_platoon.testing import Platoon
from msg_adapters.topics import VehicleTopics

SMALL = ("run.duration=60", "platoon.followers=3", "run.real_time_factor=10")
"""Six seconds of wall time, slow enough to interfere."""

Start = Callable[..., Platoon]


def assert_bag_is_readable(run: Platoon, at_least: int) -> None:
    """Every topic of the digest has at least so many samples in the bag, up to the end."""
    with Reader(run.folder.bag) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections if "vehicle_" in c.topic}
        topics = [connection.topic for connection, _, _ in reader.messages()]
    assert sum("vehicle_" in topic for topic in topics) == sum(counts.values())
    assert topics.count("/platoon/scenario") == 1
    assert topics.count("/platoon/events") >= 1
    assert len(counts) == 15
    assert min(counts.values()) > at_least


@pytest.mark.parametrize("node", ["vehicle_0/leader", "vehicle_2/vehicle", "vehicle_2/noise_relay"])
def test_a_killed_node_ends_the_run(platoon: Start, node: str) -> None:
    run = platoon(*SMALL, hosts="per_node")
    run.wait_sample(200)
    run.kill(node)
    result = run.result()
    assert (result.exit_code, result.status) == (1, "failed")
    assert node in result.message
    assert "was killed by SIGKILL" in result.message
    assert "last complete sample" in result.message
    assert json.loads((run.folder.path / "run.json").read_text())["status"] == "failed"
    assert_bag_is_readable(run, at_least=100)


def test_a_killed_node_that_was_started_manually_ends_the_run(platoon: Start) -> None:
    settings = (*SMALL, "run.stall_timeout=2", "run.manual_nodes=[vehicle_2/vehicle]")
    run = platoon(*settings)
    run.start("vehicle_2/vehicle")
    run.wait_sample(200)
    run.kill("vehicle_2/vehicle")
    result = run.result()
    assert result.exit_code == 1
    assert "no progress for" in result.message
    assert "vehicle_2/vehicle" in result.message
    assert_bag_is_readable(run, at_least=100)


def test_a_killed_recorder_ends_the_run(platoon: Start, tmp_path: Path) -> None:
    parts = f"record.parts={tmp_path / 'parts'}"
    run = platoon(*SMALL, "run.spawn=false", "run.stall_timeout=2", parts)
    run.start("recorder", parameters=[f"record:={tmp_path / 'parts'}"])
    run.wait_node("host_recorder/recorder")
    for node in run.scenario.node_names:
        run.start(node)
    run.wait_sample(200)
    run.kill("recorder")
    result = run.result()
    assert result.exit_code == 1
    assert "host_recorder/recorder" in result.message
    assert_bag_is_readable(run, at_least=100)


@pytest.mark.parametrize(("number", "exit_code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_the_run_in_good_order(
    platoon: Start, number: signal.Signals, exit_code: int
) -> None:
    run = platoon(*SMALL, hosts=2)
    run.wait_sample(200)
    run.kill("supervisor", number)
    result = run.result()
    assert (result.exit_code, result.status) == (exit_code, "interrupted")
    assert "Traceback" not in result.errors
    assert number.name in result.message
    assert_bag_is_readable(run, at_least=200)


def test_a_terminated_host_ends_the_run_in_good_order(platoon: Start) -> None:
    run = platoon(*SMALL, hosts=2)
    run.wait_sample(200)
    run.kill("vehicle_3/vehicle", signal.SIGTERM)
    result = run.result()
    assert (result.exit_code, result.status) == (1, "failed")
    assert "SIGTERM" in result.message
    assert_bag_is_readable(run, at_least=200)


def test_a_node_that_never_appears_is_named(platoon: Start) -> None:
    run = platoon(*SMALL, "run.manual_nodes=[vehicle_2/noise_relay]", "run.start_timeout=4")
    result = run.result()
    assert result.exit_code == 1
    assert "vehicle_2/noise_relay" in result.message
    assert "have not appeared" in result.message


def test_a_stall_names_who_stopped(platoon: Start) -> None:
    run = platoon(*SMALL, "run.stall_timeout=1.5", hosts="per_node")
    run.wait_sample(200)
    run.kill("vehicle_2/vehicle", signal.SIGSTOP)
    result = run.result()
    assert result.exit_code == 1
    assert "no progress for" in result.message
    assert "vehicle_2/vehicle) does not answer" in result.message
    assert_bag_is_readable(run, at_least=100)


def test_a_foreign_publisher_is_named(platoon: Start) -> None:
    run = platoon(*SMALL, hosts=2)
    run.wait_sample(100)
    publish = run.publisher(VehicleTopics("/platoon", 1).pose)
    publish(0, 1.0)
    result = run.result()
    assert result.exit_code == 1
    assert "/platoon/vehicle_1/pose" in result.message or "pose of vehicle_1" in result.message
    assert "another publisher" in result.message or "observer" in result.message


@pytest.mark.parametrize(
    ("message", "topic"),
    [
        (String(data="nonsense"), "/platoon/host_state"),
        (String(data="{}"), "/platoon/host_state"),
        (String(data="nonsense"), "/platoon/status"),
        (Int64(data=10**9), "/platoon/host_0/recorded"),
    ],
)
def test_a_strange_message_ends_the_run_by_name(
    platoon: Start, message: String | Int64, topic: str
) -> None:
    run = platoon(*SMALL, hosts=2)
    run.wait_sample(100)
    run.send(message, topic)
    result = run.result()
    assert result.exit_code == 1
    assert "Traceback" not in result.errors
    named = topic.removeprefix("/platoon/").replace("/recorded", "")
    assert named.replace("host_0", "host 0") in result.message or topic in result.message
    assert "publisher" in result.message
    assert_bag_is_readable(run, at_least=100)


def test_a_count_of_another_publisher_ends_the_run_by_name(platoon: Start) -> None:
    run = platoon(*SMALL, "v2v.loss=0.1", hosts=2)
    run.wait_sample(100)
    run.send(Vector3Stamped(), "/platoon/vehicle_2/v2v/complete")
    result = run.result()
    assert result.exit_code == 1
    assert "Traceback" not in result.errors
    assert "/platoon/vehicle_2/v2v/complete" in result.message
    assert "publisher" in result.message


@pytest.mark.parametrize(
    ("node", "parameter"),
    [
        ("vehicle_2/vehicle", "controller.k_p:=0.01"),
        ("vehicle_2/noise_relay", "run.seed:=7"),
    ],
)
def test_a_node_with_other_parameters_is_named(platoon: Start, node: str, parameter: str) -> None:
    run = platoon(*SMALL, f"run.manual_nodes=[{node}]")
    run.start(node, parameters=[parameter])
    result = run.result()
    assert result.exit_code == 1
    assert f"{node}: {parameter.partition(':=')[0]} = " in result.message


def test_nan_on_a_topic_is_named(platoon: Start) -> None:
    relay = [sys.executable, str(Path(__file__).with_name("spoiled_relay.py"))]
    run = platoon(*SMALL, manual_nodes={"vehicle_2/noise_relay": relay})
    result = run.result()
    assert result.exit_code == 1
    assert "vehicle_2" in result.message
    assert "nan" in result.message
