"""Messages that a reader hands over one by one, put into arrays."""

from __future__ import annotations

import numpy as np

from cacc_platoon.bags.raw import Location, RawFile, split_by_channel

BATCH = 20_000


class Collector:
    """Puts messages that arrive one by one into arrays, a batch at a time."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._locations: list[Location] = []
        self._rows: list[tuple[int, int, bytes]] = []

    def add(self, channel: int, log_time: int, data: bytes) -> None:
        """Take the next message."""
        self._rows.append((channel, log_time, data))
        if len(self._rows) >= BATCH:
            self._pack()

    def finish(self, channels: dict[int, tuple[str, str]], damage: list[str]) -> RawFile:
        """Return all of them, by channel."""
        self._pack()
        data = np.frombuffer(self._data, np.uint8)
        return RawFile(split_by_channel(data, self._locations, channels), damage)

    def _pack(self) -> None:
        if not self._rows:
            return
        channels, times, blobs = zip(*self._rows, strict=True)
        lengths = np.array([len(blob) for blob in blobs], np.int64)
        ends = len(self._data) + np.cumsum(lengths)
        self._locations.append(
            Location(np.array(channels), ends - lengths, lengths, np.array(times, np.int64))
        )
        self._data += b"".join(blobs)
        self._rows = []
