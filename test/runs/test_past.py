"""What hosts that are started again find of the run so far."""

import threading
from pathlib import Path

from cacc_platoon.runs.folder import ENDED, RunFolder
from cacc_platoon.runs.parts import PartWriter, newest_of
from cacc_platoon.runs.past import Past
from cacc_platoon.scenario import Scenario
from msg_adapters.topics import Graph, Topic

CLOCKED = Scenario.from_values({"platoon.followers": 1, "run.sync": "wall", "run.duration": 1.0})
VEHICLE = Graph.of(CLOCKED).vehicles[1]
STEP = CLOCKED.step_ns


def record(folder: Path, topic: Topic, samples: int) -> list[bytes]:
    """Record the first samples of a topic."""
    part = PartWriter(folder, [topic])
    rows = [topic.codec.encode(k * STEP, float(k)) for k in range(samples)]
    for row in rows:
        part.writers[topic.name](row)
    part.close()
    return rows


def test_the_longest_record_counts_whoever_was_killed_while_recording_anew(tmp_path: Path) -> None:
    rows = record(tmp_path / ENDED / "host_1_0", VEHICLE.pose, 9)
    record(tmp_path / ENDED / "host_1_1", VEHICLE.pose, 4)
    record(tmp_path / "parts" / "host_1", VEHICLE.pose, 2)
    past = Past(tmp_path / ENDED, tmp_path / "parts")
    assert past.rows(VEHICLE.pose.name) == rows
    assert past.count(VEHICLE.pose.name) == 9
    assert past.between(VEHICLE.pose.name, 5, 7) == rows[5:7]
    folder = RunFolder(tmp_path)
    assert len(folder.recording()[VEHICLE.pose.name].messages) == 9


def test_a_host_may_end_before_it_has_a_part(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    record(folder.parts / "host_1", VEHICLE.pose, 9)
    for _ in range(3):
        assert folder.ended_part(folder.parts / "host_1") == tmp_path / ENDED
    assert Past(tmp_path / ENDED, folder.parts).count(VEHICLE.pose.name) == 9


def test_of_a_sample_that_was_begun_it_does_not_count_what_was_used(tmp_path: Path) -> None:
    for n, topic in enumerate((VEHICLE.pose, VEHICLE.complete, VEHICLE.received)):
        record(tmp_path / ENDED / f"host_{n}", topic, 6)
    record(tmp_path / ENDED / "host_9", VEHICLE.timing, 5)
    past = Past(tmp_path / ENDED, tmp_path / "parts")
    counts = [past.count(topic.name) for topic in (VEHICLE.pose, VEHICLE.complete)]
    assert counts == [6, 5]  # how it moved at a sample follows from those before
    assert past.count(VEHICLE.received.name) == 6
    assert past.rows("/platoon/vehicle_9/pose") == []


def test_of_equal_records_the_newest_counts(tmp_path: Path) -> None:
    for number, value in ((2, 1.0), (10, 2.0)):
        part = PartWriter(tmp_path / ENDED / f"host_1_{number}", [VEHICLE.complete])
        part.writers[VEHICLE.complete.name](VEHICLE.complete.codec.encode(0, value))
        part.close()
    (row,) = newest_of(tmp_path / "parts", tmp_path / ENDED)[VEHICLE.complete.name].messages
    assert VEHICLE.complete.codec.decode(row.tobytes()) == (0, 2.0)


def test_a_part_that_is_moved_meanwhile_is_never_missed(tmp_path: Path) -> None:
    for number in range(30):
        folder = RunFolder(tmp_path / f"{number}")
        record(folder.parts / "host_1", VEHICLE.pose, 9)
        mover = threading.Thread(target=folder.ended_part, args=(folder.parts / "host_1",))
        mover.start()
        while mover.is_alive():
            past = Past(folder.path / ENDED, folder.parts)
            assert past.count(VEHICLE.pose.name) == 9
        mover.join()
        assert Past(folder.path / ENDED, folder.parts).count(VEHICLE.pose.name) == 9
