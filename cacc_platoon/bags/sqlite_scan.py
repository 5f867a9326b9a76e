"""rosbag2 sqlite3 files, read up to where they are damaged."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path
from tempfile import TemporaryDirectory

from cacc_platoon.bags.collector import BATCH, Collector
from cacc_platoon.bags.raw import BagError, Progress, RawFile
from cacc_platoon.bags.unpack import TooLargeError, Unpacker

_LARGEST = 1 << 36
_COLUMNS = {"topics": ("id", "name", "type"), "messages": ("id", "topic_id", "timestamp", "data")}
_INFO = "SELECT * FROM pragma_table_xinfo(?)"
_CUT_SHORT = "is cut short; read as far as it goes"


def read_sqlite(path: Path, unpacker: Unpacker, progress: Progress | None = None) -> RawFile:
    """Find every message of a rosbag2 sqlite3 file, up to where it is damaged.

    Raises
    ------
    BagError
        When the file is no rosbag2 database.
    """
    with TemporaryDirectory() as folder:
        whole = _padded(path, Path(folder))
        damage = [] if whole is None else [_CUT_SHORT]
        return _read_tables(path, whole or path, damage, unpacker, progress)


def _padded(path: Path, folder: Path) -> Path | None:
    """Return a copy of a file cut short, filled up with zeros; sqlite refuses it otherwise."""
    with path.open("rb") as file:
        header = file.read(32)
    page = int.from_bytes(header[16:18], "big")
    size = (65536 if page == 1 else page) * int.from_bytes(header[28:32], "big")
    if not path.stat().st_size < size < _LARGEST:
        return None
    copy = folder / "padded.db3"
    shutil.copyfile(path, copy)
    with copy.open("r+b") as file:
        file.truncate(size)
    return copy


def _refuse_computed(database: sqlite3.Connection) -> None:
    """Raise sqlite3.Error unless the messages are stored: a view can compute them without end."""
    database.execute("PRAGMA trusted_schema = OFF")
    for table, columns in _COLUMNS.items():
        kind = database.execute("SELECT type FROM sqlite_master WHERE name = ?", (table,))
        hidden = {name: hidden for _, name, *_, hidden in database.execute(_INFO, (table,))}
        if kind.fetchall() != [("table",)] or any(hidden.get(name, 1) for name in columns):
            raise sqlite3.DatabaseError(f"{table} is not stored as rosbag2 does")


def _read_tables(
    path: Path, source: Path, damage: list[str], unpacker: Unpacker, progress: Progress | None
) -> RawFile:
    database = sqlite3.connect(f"{source.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    collector, left = Collector(), path.stat().st_size
    try:
        _refuse_computed(database)
        channels = {
            int(number): (str(name), str(kind))
            for number, name, kind in database.execute("SELECT id, name, type FROM topics")
        }
    except (sqlite3.Error, ValueError, TypeError) as error:
        database.close()
        raise BagError(f"{path}: is not a rosbag2 database ({error}). Give a bag.") from error
    try:
        rows = database.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id")
        for count, (channel, log_time, data) in enumerate(rows):
            if isinstance(data, bytes) and isinstance(log_time, int) and isinstance(channel, int):
                left -= len(data) + 1
                if left < 0:
                    damage = ["has more in its messages than it is large; the rest is left out"]
                    break
                collector.add(channel, log_time, data)
            if count % BATCH == BATCH - 1:
                unpacker.count(BATCH)
                if progress:
                    progress("reading", count, 0)
    except TooLargeError as error:
        damage = [str(error)]
    except (sqlite3.Error, OverflowError, MemoryError) as error:
        if not damage:
            damage = [f"is damaged ({error}); read as far as it goes"]
    finally:
        database.close()
    return collector.finish(channels, damage)
