"""Storage that is not plain MCAP: sqlite3 files, and whatever rosbags can decompress."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from cacc_platoon.analysis.reading.raw import (
    BagError,
    Location,
    Progress,
    RawFile,
    split_by_channel,
)

_BATCH = 20_000
_LARGEST = 1 << 36
_CUT_SHORT = "is cut short; read as far as it goes"


class _Collector:
    """Puts messages that arrive one by one into arrays, a batch at a time."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._locations: list[Location] = []
        self._rows: list[tuple[int, int, bytes]] = []
        self._size = 0

    def add(self, channel: int, log_time: int, data: bytes) -> None:
        self._rows.append((channel, log_time, data))
        if len(self._rows) >= _BATCH:
            self._pack()

    def finish(self, channels: dict[int, tuple[str, str]], damage: list[str]) -> RawFile:
        self._pack()
        data = np.frombuffer(b"".join(self._parts), np.uint8)
        return RawFile(split_by_channel(data, self._locations, channels), damage)

    def _pack(self) -> None:
        if not self._rows:
            return
        channels, times, blobs = zip(*self._rows, strict=True)
        lengths = np.array([len(blob) for blob in blobs], np.int64)
        ends = self._size + np.cumsum(lengths)
        self._locations.append(
            Location(np.array(channels), ends - lengths, lengths, np.array(times, np.int64))
        )
        self._parts.append(b"".join(blobs))
        self._size = int(ends[-1])
        self._rows = []


def read_sqlite(path: Path, progress: Progress | None = None) -> RawFile:
    """Find every message of a rosbag2 sqlite3 file, up to where it is damaged.

    Raises
    ------
    BagError
        When the file is no rosbag2 database.
    """
    with TemporaryDirectory() as folder:
        whole = _padded(path, Path(folder))
        return _read_tables(path, whole or path, [] if whole is None else [_CUT_SHORT], progress)


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


def _read_tables(path: Path, source: Path, damage: list[str], progress: Progress | None) -> RawFile:
    database = sqlite3.connect(f"{source.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    collector = _Collector()
    try:
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
                collector.add(channel, log_time, data)
            if progress and count % _BATCH == 0:
                progress("reading", count, 0)
    except (sqlite3.Error, OverflowError) as error:
        if not damage:
            damage = [f"is damaged ({error}); read as far as it goes"]
    finally:
        database.close()
    return collector.finish(channels, damage)


def read_with_rosbags(path: Path, progress: Progress | None = None) -> RawFile:
    """Find every message of a compressed bag by way of rosbags.

    Parameters
    ----------
    path : Path
        A bag's folder, or one storage file.

    Raises
    ------
    BagError
        When rosbags cannot open it.
    """
    from rosbags.rosbag2 import Reader  # noqa: PLC0415  (seldom needed)

    collector, damage = _Collector(), list[str]()
    channels: dict[int, tuple[str, str]] = {}
    try:
        with Reader(path) as reader:
            connections = reader.connections
            channels = {c.id: (c.topic, c.msgtype) for c in connections}
            total = reader.message_count
            messages: Iterable[tuple[object, int, bytes]] = reader.messages(connections)
            for count, (connection, log_time, data) in enumerate(messages):
                collector.add(connection.id, log_time, bytes(data))  # type: ignore[attr-defined]
                if progress and count % _BATCH == 0:
                    progress("reading", count, total)
    except Exception as error:  # rosbags lets errors of its decompressors through
        reason = " ".join(str(error).split()) or type(error).__name__
        if not channels:
            raise BagError(f"{path}: cannot be read as a bag ({reason}). Give a bag.") from error
        damage.append(f"is damaged ({reason}); read as far as it goes")
    return collector.finish(channels, damage)
