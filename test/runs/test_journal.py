"""What a host that may be started again has recorded, and what others have then."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from cacc_platoon.runs.folder import ENDED
from cacc_platoon.runs.journal import Journal
from cacc_platoon.runs.parts import PartWriter
from cacc_platoon.runs.past import Past
from cacc_platoon.scenario import Scenario
from msg_adapters.topics import Graph, Topic

CLOCKED = Scenario.from_values({"platoon.followers": 2, "run.sync": "wall", "run.duration": 5.0})
GRAPH = Graph.of(CLOCKED)
STEP = CLOCKED.step_ns
OWN, BEHIND = GRAPH.vehicles[1], GRAPH.vehicles[2]


AGAIN = 100


class Process:
    """A host that records one vehicle, whose messages go to the lists `sent` and `got`."""

    def __init__(self, folder: Path, past: Past | None = None) -> None:
        topics = [OWN.pose, OWN.timing, OWN.received]
        self.part = PartWriter(folder, topics, buffered=False)
        self.journal = Journal(self.part.writers, STEP, AGAIN, past)
        self.sent, self.got = list[bytes](), list[bytes]()
        self.send = self.journal.sending(OWN.pose, self.publish)
        self.receive = self.journal.receiving(OWN.received, self.use)

    def publish(self, data: bytes) -> None:
        """Take note of what others get, which is recorded by then."""
        assert data in self.recorded(OWN.pose)
        self.sent.append(data)

    def use(self, data: bytes) -> None:
        """Take note of a packet, which is recorded by then."""
        assert data in self.recorded(OWN.received)
        self.got.append(data)

    def recorded(self, topic: Topic) -> list[bytes]:
        """Return what is in the part."""
        count = self.part.count(topic.name)
        return [self.part.message(topic.name, k) for k in range(count)]


@contextmanager
def process_in(folder: Path, past: Past | None = None) -> Iterator[Process]:
    process = Process(folder, past)
    with closing(process.part):
        yield process


def rows(topic: Topic, samples: range) -> list[bytes]:
    return [topic.codec.encode(k * STEP, float(k)) for k in samples]


def killed(tmp_path: Path, samples: int) -> Past:
    """Return what a process leaves that was killed behind a sample."""
    with process_in(tmp_path / ENDED / "host_1") as process:
        for data in rows(OWN.pose, range(samples)):
            process.send(data)
        for data in rows(OWN.timing, range(samples)):
            process.part.writers[OWN.timing.name](data)
        for data in rows(OWN.received, range(3)):
            process.receive(data)
        assert (len(process.sent), len(process.got)) == (samples, 3)
    return Past(tmp_path / ENDED, tmp_path / "parts")


def test_nobody_knows_what_is_not_recorded(tmp_path: Path) -> None:
    past = killed(tmp_path, 5)
    assert past.rows(OWN.pose.name) == rows(OWN.pose, range(5))
    assert past.rows(OWN.received.name) == rows(OWN.received, range(3))


def test_the_last_messages_come_again_once_all_are_connected(tmp_path: Path) -> None:
    known = AGAIN + 20
    with process_in(tmp_path / "parts" / "host_1", killed(tmp_path, known)) as process:
        process.journal.resume()
        assert process.got == rows(OWN.received, range(3))
        for data in rows(OWN.pose, range(known + 1)):
            process.send(data)
        assert process.sent == []
        process.journal.begin(known + 300)
        process.send(*rows(OWN.pose, range(known + 1, known + 2)))
        assert process.sent == rows(OWN.pose, range(20, known + 2))
        assert process.recorded(OWN.pose) == rows(OWN.pose, range(known + 2))
        process.receive(*rows(OWN.received, range(9, 10)))
        assert process.recorded(OWN.received) == process.got


def test_packets_count_again_from_a_sample_on(tmp_path: Path) -> None:
    journal = Journal({}, STEP, AGAIN, Past(tmp_path / ENDED, tmp_path / "parts"))
    sent: list[bytes] = []
    send = journal.sending(BEHIND.received, sent.append)
    for data in rows(BEHIND.received, range(4)):
        send(data)
    assert sent == []
    journal.begin(3)
    assert sent == rows(BEHIND.received, range(3, 4))
    for data in rows(BEHIND.received, range(2, 6)):
        send(data)
    assert sent[1:] == rows(BEHIND.received, range(3, 6))


def test_what_came_meanwhile_is_taken_from_the_record_of_another_host(tmp_path: Path) -> None:
    past = killed(tmp_path, 4)
    journal, got = Journal({}, STEP, AGAIN, past), list[bytes]()
    receive = journal.receiving(OWN.pose, got.append)
    journal.resume()
    with closing(PartWriter(tmp_path / "parts" / "host_1", [OWN.pose], buffered=False)) as later:
        write = later.writers[OWN.pose.name]
        for data in rows(OWN.pose, range(6)):
            write(data)
        receive(*rows(OWN.pose, range(7, 8)))
        assert got == rows(OWN.pose, range(6))
        receive(*rows(OWN.pose, range(8, 9)))
        write(*rows(OWN.pose, range(6, 7)))
        receive(*rows(OWN.pose, range(9, 10)))
    assert got == rows(OWN.pose, range(10))
