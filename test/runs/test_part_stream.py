"""A part as a stream: what arrives is what was recorded, or it is refused."""

import numpy as np
import pytest

from cacc_platoon.runs.part_stream import CHUNK, PartSink, PartSource, StreamError
from cacc_platoon.runs.parts import PartWriter, read_parts
from msg_adapters.topics import VehicleTopics

SAMPLES = 400
TOPICS = list(VehicleTopics("/platoon", 3).motion)


@pytest.fixture
def part(tmp_path):
    """A part with three topics, one of them empty."""
    writer = PartWriter(tmp_path / "part", TOPICS)
    for topic in TOPICS[:2]:
        for k in range(SAMPLES):
            writer.writers[topic.name](topic.codec.encode(k * 10_000_000, 0.1 * k))
    writer.close()
    return tmp_path / "part"


@pytest.fixture
def sink(tmp_path):
    made = PartSink(tmp_path / "copy", TOPICS, SAMPLES)
    yield made
    made.close()


def pieces(part):
    return list(PartSource(part, [topic.name for topic in TOPICS]).pieces())


def send(sink, sent):
    offset = 0
    for piece in sent:
        sink.take(offset, piece)
        offset += len(piece)


@pytest.mark.parametrize("size", [1, 7, 100, CHUNK, 10**9])
def test_a_part_arrives_as_it_is_in_pieces_of_any_size(part, sink, tmp_path, size):
    stream = b"".join(pieces(part))
    step = max(1, min(size, len(stream)))
    if size == 1:  # the last bytes one by one are enough
        send(sink, [stream[:-200]])
        for at in range(len(stream) - 200, len(stream)):
            assert not sink.complete
            sink.take(at, stream[at : at + 1])
    else:
        send(sink, [stream[at : at + step] for at in range(0, len(stream), step)])
    assert sink.complete
    sink.close()
    before, after = read_parts([part]), read_parts([tmp_path / "copy"])
    assert before.keys() == after.keys()
    for name, rows in before.items():
        assert np.array_equal(rows.messages, after[name].messages)


def test_a_piece_that_comes_twice_is_taken_once(part, sink):
    sent = pieces(part)
    sink.take(0, sent[0])
    sink.take(0, sent[0])
    assert sink.received == len(sent[0])


def test_pieces_are_small(part):
    assert max(map(len, pieces(part))) < 2 * CHUNK


def test_what_another_sends_is_refused(part, sink):
    stream = b"".join(pieces(part))
    with pytest.raises(StreamError, match="byte 8 came where 0 was due"):
        sink.take(8, stream)
    forged = bytearray(stream)
    forged[CHUNK] ^= 1
    with pytest.raises(StreamError, match="it is not what was sent"):
        sink.take(0, bytes(forged))


@pytest.mark.parametrize(
    "due", [TOPICS[0].codec.size * (SAMPLES + 1), TOPICS[0].codec.size - 1, 2**63]
)
def test_more_than_a_topic_can_have_is_refused(sink, due):
    with pytest.raises(StreamError, match=rf"/platoon/vehicle_3/pose cannot have {due} bytes"):
        sink.take(0, due.to_bytes(8, "little"))


def test_more_than_there_is_is_refused(part, sink):
    send(sink, pieces(part))
    with pytest.raises(StreamError, match="more came than there is"):
        sink.take(sink.received, b"more")
