"""Bags that unpack to more than they can honestly hold: what is unpacked is bounded, and said."""

import sqlite3
import struct
import sys
import tracemalloc
from itertools import product

import lz4.frame
import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from cacc_platoon.bags.raw import BagError
from cacc_platoon.bags.read import read_bag
from cacc_platoon.bags.unpack import MESSAGE, MOST_TIMES, SPARE, Unpacker, UnpackError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MIB = 2**20
MEMORY = 150 * MIB
WHOLE = (CompressionMode.NONE, CompressionMode.FILE, CompressionMode.MESSAGE)
PACK = {"zstd": zstd.compress, "lz4": lz4.frame.compress}
MAGIC = b"\x89MCAP0\r\n"


def record(code, body):
    return struct.pack("<BQ", code, len(body)) + body


def chunk(content, name, declared=None):
    packed = PACK[name](content)
    declared = len(content) if declared is None else declared
    head = struct.pack("<QQQII", 0, 0, declared, 0, len(name)) + name.encode()
    return record(6, head + struct.pack("<Q", len(packed)) + packed)


def read(path):
    """Return the bag and the most memory [bytes] that reading it took."""
    tracemalloc.start()
    try:
        return read_bag(path), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", PACK)
@pytest.mark.parametrize("declared", [100, 0])
def test_a_chunk_that_lies_about_its_size(tmp_path, name, declared):
    file = tmp_path / "bomb.mcap"
    file.write_bytes(MAGIC + chunk(bytes(300 * MIB), name, declared))
    bag, memory = read(file)
    assert memory < MEMORY
    assert f"more than the {declared} bytes that it declares" in bag.damage[0]


@pytest.mark.parametrize("name", PACK)
def test_honest_chunks_that_are_too_many(tmp_path, name):
    file = tmp_path / "bomb.mcap"
    file.write_bytes(MAGIC + chunk(record(5, bytes(16 * MIB - 9)), name) * 20)
    bag, memory = read(file)
    assert memory < MEMORY
    assert "unpacks to more than" in bag.damage[0]
    assert "which no recording of its size does" in bag.damage[0]


@pytest.mark.slow
def test_a_chunk_of_nothing_but_heads_of_records(tmp_path):
    file = tmp_path / "bomb.mcap"
    file.write_bytes(MAGIC + chunk(bytes(9) * (3 * MIB), "zstd"))
    bag, memory = read(file)
    assert memory < 3 * MEMORY
    assert "which no recording of its size does" in bag.damage[0]


@pytest.mark.slow
def test_a_bag_compressed_file_by_file(tmp_path):
    content = MAGIC + record(5, bytes(300 * MIB))
    (tmp_path / "bomb.mcap.zstd").write_bytes(zstd.compress(content))
    bag, memory = read(tmp_path)
    assert memory < MEMORY
    assert any("which no recording of its size does" in line for line in bag.damage)


def test_a_bag_compressed_message_by_message(bags, tmp_path, scenario, recording):
    bag = bags.foreign(tmp_path / "bag", scenario, recording, compression=CompressionMode.MESSAGE)
    with sqlite3.connect(bag / "bag.db3") as database:
        bomb = zstd.compress(bytes(50 * MIB))
        database.execute("UPDATE messages SET data = ? WHERE id % 10 = 5", (bomb,))
    database.close()
    found, memory = read(bag)
    assert memory < 3 * MEMORY
    assert any("which no recording of its size does" in line for line in found.damage)


@pytest.mark.parametrize(
    ("plugin", "mode"),
    [*product(StoragePlugin, WHOLE), (StoragePlugin.MCAP, CompressionMode.STORAGE)],
)
def test_honest_bags_are_read_whole(bags, tmp_path, recording, plugin, mode):
    """A platoon that stands still compresses best of all."""
    still = bags.scenario({"platoon.initial_speed": 0.0, "leader.profile": "constant"})
    rest = bags.record(still)
    bag = bags.foreign(tmp_path / "bag", still, rest, plugin, compression=mode)
    found = read_bag(bag)
    assert found.damage == []
    assert {len(found.topics[name][0].lengths) for name in rest} == {still.samples}


def test_a_compressed_storage_file_is_read_without_its_metadata(
    bags, tmp_path, scenario, recording
):
    bag = bags.foreign(tmp_path / "bag", scenario, recording, compression=CompressionMode.FILE)
    (bag / "metadata.yaml").unlink()
    assert set(recording) <= set(read_bag(bag).topics)


ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS id"


@pytest.mark.parametrize(
    "messages",
    [
        f"CREATE VIEW messages AS {ENDLESS}, 1 AS topic_id, 1 AS timestamp, x'00' AS data FROM n",
        "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, "
        "data BLOB AS (zeroblob(900000000)))",
    ],
)
def test_a_database_that_computes_its_messages(tmp_path, messages):
    file = tmp_path / "forged.db3"
    with sqlite3.connect(file) as database:
        database.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT)")
        database.execute(messages)
        if "TABLE" in messages:
            database.execute("INSERT INTO messages (topic_id, timestamp) VALUES (1, 1)")
    database.close()
    with pytest.raises(BagError, match="messages is not stored as rosbag2 does"):
        read_bag(file)


def test_metadata_is_bounded_too(bags, tmp_path, scenario, recording):
    bag = bags.bag(tmp_path / "bag", scenario, recording)
    lists = "".join(f"    k{i}: &k{i} [{f'*k{i - 1}, ' * 9 if i else 1}]\n" for i in range(12))
    for text in (
        f"rosbag2_bagfile_information:\n  custom_data:\n{lists}",
        "# " + "x" * 5_000_000,
        "a: " + "[" * 10_000,
    ):
        (bag / "metadata.yaml").write_text(text)
        assert "metadata.yaml is damaged" in read_bag(bag).damage[0]


def test_the_bound_counts_bytes_and_records_of_the_whole_bag():
    unpacker = Unpacker(MIB)
    packed = zstd.compress(bytes(MIB))
    pieces = (SPARE + MOST_TIMES * MIB) // MIB
    for _ in range(pieces // 2):
        assert len(unpacker.unpack("zstd", packed, MIB)) == MIB
    with pytest.raises(UnpackError, match="which no recording of its size does"):
        unpacker.count((pieces // 2 + 2) * MIB // MESSAGE)


@pytest.mark.parametrize("name", PACK)
def test_what_is_cut_short_or_no_such_thing(name):
    packed = PACK[name](bytes(range(256)) * 100)
    with pytest.raises(UnpackError, match="ends unfinished"):
        Unpacker(1000).unpack(name, packed[:-5])
    with pytest.raises(UnpackError):
        Unpacker(1000).unpack(name, b"nonsense")
    with pytest.raises(UnpackError, match="unknown compression"):
        Unpacker(1000).unpack("zip", packed)
