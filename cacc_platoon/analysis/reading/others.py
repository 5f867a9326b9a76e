"""Storage that is not plain MCAP: sqlite3 files, and whatever rosbags can decompress."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from cacc_platoon.analysis.reading.raw import (
    BagError,
    Location,
    Progress,
    RawFile,
    split_by_channel,
)

_BATCH = 20_000


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
    database = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    collector, damage = _Collector(), list[str]()
    try:
        try:
            channels = {
                int(number): (str(name), str(kind))
                for number, name, kind in database.execute("SELECT id, name, type FROM topics")
            }
            (total,) = database.execute("SELECT max(id) FROM messages").fetchone()
        except (sqlite3.Error, ValueError) as error:
            raise BagError(f"{path}: is not a rosbag2 database ({error}). Give a bag.") from error
        rows = database.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id")
        try:
            for count, (channel, log_time, data) in enumerate(rows):
                if isinstance(data, bytes) and isinstance(log_time, int):
                    collector.add(channel, log_time, data)
                if progress and count % _BATCH == 0:
                    progress("reading", count, total or 0)
        except sqlite3.Error as error:
            damage.append(f"is damaged ({error}); read as far as it goes")
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
