"""MCAP files, record by record and without their index: a file cut short is read to its end."""

from __future__ import annotations

import mmap
import struct
import zlib
from pathlib import Path

import numpy as np

from cacc_platoon.analysis.reading.raw import (
    BagError,
    Bytes,
    Integers,
    Location,
    Progress,
    RawFile,
    split_by_channel,
)

MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0F
_PREFIX = 9  # opcode and length
_MESSAGE_HEAD = 22  # channel, sequence, log time, publish time
_CHUNK_HEAD = 28  # start, end, uncompressed size, checksum
_HEAD = struct.Struct("<BQ")
_LENGTH = struct.Struct("<Q").unpack_from


class CompressedError(Exception):
    """The file has compressed chunks, which are left to rosbags."""


def read_mcap(path: Path, progress: Progress | None = None) -> RawFile:
    """Find every message of an MCAP file with uncompressed chunks.

    Raises
    ------
    BagError
        When the file is no MCAP file.
    CompressedError
        When its chunks are compressed.
    """
    size = path.stat().st_size
    if size < len(MAGIC):
        raise BagError(f"{path}: is empty, there is no run in it. Record it again.")
    with path.open("rb") as file:
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    if data[: len(MAGIC)] != MAGIC:
        raise BagError(f"{path}: is not an MCAP file, it does not begin as one. Give a bag.")
    scan = _Scan(data)
    scan.walk_file(progress)
    topics = split_by_channel(scan.bytes, scan.locations, scan.topics())
    return RawFile(topics, scan.damage)


class _Scan:
    """One pass over a file."""

    def __init__(self, data: mmap.mmap) -> None:
        self.data = data
        self.bytes: Bytes = np.frombuffer(data, np.uint8)
        self.locations: list[Location] = []
        self.damage: list[str] = []
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[int, str]] = {}

    def topics(self) -> dict[int, tuple[str, str]]:
        """Topic and type of every channel."""
        return {
            number: (topic, self._schemas.get(schema, ""))
            for number, (schema, topic) in self._channels.items()
        }

    def walk_file(self, progress: Progress | None) -> None:
        """Visit all records outside and inside of chunks."""
        position, end, chunks = len(MAGIC), len(self.data), 0
        while position + _PREFIX <= end:
            code, length = _HEAD.unpack_from(self.data, position)
            begin, stop = position + _PREFIX, position + _PREFIX + length
            if code == _DATA_END:
                return
            if code == _CHUNK:
                self._walk_chunk(begin, min(stop, end))
                chunks += 1
                if progress and chunks % 16 == 0:
                    progress("reading", position, end)
            elif stop <= end:
                self._walk_records(position, stop)
            if stop > end:
                break
            position = stop
        self.damage.append(f"ends unfinished at byte {end}; read as far as it goes")

    def _walk_chunk(self, begin: int, end: int) -> None:
        if begin + _CHUNK_HEAD + 4 > end:
            return
        (checksum,) = struct.unpack_from("<I", self.data, begin + 24)
        (name_length,) = struct.unpack_from("<I", self.data, begin + _CHUNK_HEAD)
        start = begin + _CHUNK_HEAD + 4 + name_length + 8
        if start > end:
            return
        if name_length:
            raise CompressedError
        stop = min(start + _LENGTH(self.data, start - 8)[0], end)
        if checksum and zlib.crc32(memoryview(self.data)[start:stop]) != checksum:
            self.damage.append(f"has a chunk at byte {begin} that differs from its checksum")
        self._walk_records(start, stop)

    def _walk_records(self, position: int, end: int) -> None:
        """Take down the messages between two bytes; the loop does nothing but hop."""
        data, hops = self.data, []
        while position + _PREFIX <= end:
            hops.append(position)
            position += _PREFIX + _LENGTH(data, position + 1)[0]
        if not hops:
            return
        if position > end:
            self.damage.append(f"is unreadable at byte {hops.pop()}; that part is left out")
        starts = np.array(hops, np.int64)
        codes = self.bytes[starts]
        for at in starts[(codes == _SCHEMA) | (codes == _CHANNEL)].tolist():
            self._define(at)
        starts = starts[codes == _MESSAGE]
        lengths = self._number(starts + 1, "<u8").astype(np.int64) - _MESSAGE_HEAD
        starts, lengths = starts[lengths >= 0], lengths[lengths >= 0]
        begin = starts + _PREFIX
        self.locations.append(
            Location(
                self._number(begin, "<u2").astype(np.int64),
                begin + _MESSAGE_HEAD,
                lengths,
                self._number(begin + 6, "<i8"),
            )
        )

    def _number(self, at: Integers, kind: str) -> Integers:
        width = np.dtype(kind).itemsize
        return np.asarray(self.bytes[at[:, np.newaxis] + np.arange(width)].view(kind)[:, 0])

    def _define(self, at: int) -> None:
        """Take down a schema or a channel."""
        code, length = _HEAD.unpack_from(self.data, at)
        body = self.data[at + _PREFIX : at + _PREFIX + length]
        try:
            if code == _SCHEMA:
                (number,) = struct.unpack_from("<H", body)
                self._schemas.setdefault(number, _text(body, 2))
            else:
                number, schema = struct.unpack_from("<HH", body)
                self._channels.setdefault(number, (schema, _text(body, 4)))
        except (struct.error, UnicodeDecodeError):
            self.damage.append(f"has an unreadable topic definition at byte {at}")


def _text(body: bytes, at: int) -> str:
    (length,) = struct.unpack_from("<I", body, at)
    return body[at + 4 : at + 4 + length].decode()
