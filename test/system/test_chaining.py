"""A platoon grown piece by piece on real nodes: 3 + 3 are 6, bit for bit."""

import hashlib
from collections.abc import Callable
from pathlib import Path

from rosbags.rosbag2 import Reader

from cacc_platoon.bags.digest import run_digest
from cacc_platoon.model import Topology
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.testing import Platoon
from msg_adapters.topics import Graph

Start = Callable[..., Platoon]
SHORT = ("run.duration=8", "leader.start=1")
REAR = ("platoon.followers=3", "platoon.first_follower=4", "leader.profile=bag")


def topic_hashes(bag: Path) -> dict[str, str]:
    """Hash every vehicle's topics as they stand in the bag."""
    found: dict[str, list[bytes]] = {}
    with Reader(bag) as reader:
        for connection, _, data in reader.messages():
            if "/vehicle_" in connection.topic:
                found.setdefault(connection.topic, []).append(bytes(data))
    return {name: hashlib.sha256(b"".join(data)).hexdigest() for name, data in found.items()}


def finished(run: Platoon) -> Platoon:
    result = run.result()
    assert result.status == "finished", result.errors
    return run


def test_three_and_three_are_six(platoon: Start) -> None:
    front = platoon(*SHORT, "platoon.followers=3", hosts=2)
    whole = platoon(*SHORT, "platoon.followers=6", hosts=2)
    finished(front), finished(whole)
    rear = finished(platoon(*SHORT, *REAR, f"leader.file={front.folder.path}", hosts=2))
    six, three = topic_hashes(whole.folder.bag), topic_hashes(rear.folder.bag)
    assert set(three) == {
        topic.name for topic in Graph("/platoon", Topology(range(4, 7))).run_topics
    }
    for name, found in three.items():
        assert found == six[name], name
    led = rear.folder.scenario().leader
    assert (led.vehicle, led.file) == (3, str(front.folder.path))
    trajectory = rear.result().trajectory()
    again = run_digest(recording_of(trajectory), Graph.of(trajectory.scenario))
    assert rear.result().digest == again


def test_a_recorded_leader_may_be_started_manually(platoon: Start) -> None:
    front = finished(platoon(*SHORT, "run.duration=3", "platoon.followers=2"))
    settings = ("run.duration=3", "platoon.followers=1", "platoon.first_follower=2")
    source = ("leader.profile=bag", f"leader.file={front.folder.path}", "leader.vehicle=1")
    rear = platoon(*settings, *source, "run.manual_nodes=[vehicle_1/leader]")
    rear.start("vehicle_1/leader")
    finished(rear)
    before, after = topic_hashes(front.folder.bag), topic_hashes(rear.folder.bag)
    assert {name: before[name] for name in after} == after


def test_a_bag_that_cannot_lead_starts_nothing(platoon: Start, tmp_path: Path) -> None:
    result = platoon(*REAR, f"leader.file={tmp_path / 'nowhere'}").result()
    assert result.exit_code == 2
    assert "is not there, and only it holds the leader's motion" in result.errors
    assert not result.folder.path.exists()
