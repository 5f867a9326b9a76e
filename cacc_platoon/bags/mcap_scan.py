"""MCAP files, record by record and without their index: a file cut short is read to its end."""

from __future__ import annotations

import mmap
import struct
import zlib
from pathlib import Path

import numpy as np

from cacc_platoon.bags.raw import (
    BagError,
    Bytes,
    Integers,
    Location,
    Progress,
    RawFile,
    RawTopic,
    split_by_channel,
)
from cacc_platoon.bags.unpack import TooLargeError, Unpacker, UnpackError

MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x03, 0x04, 0x05, 0x06, 0x0F
_PREFIX = 9  # opcode and length
_BATCH = 1_000_000
_MESSAGE_HEAD = 22  # channel, sequence, log time, publish time
_CHUNK_HEAD = 28  # start, end, uncompressed size, checksum
_HEAD = struct.Struct("<BQ")
_LENGTH = struct.Struct("<Q").unpack_from


def read_mcap(path: Path, unpacker: Unpacker, progress: Progress | None = None) -> RawFile:
    """Find every message of an MCAP file.

    Parameters
    ----------
    path : Path
        The file.
    unpacker : Unpacker
        What its compressed chunks are unpacked by, that of the whole bag.
    progress : callable, optional
        Called periodically with what is being done, how much is done and how much there is.

    Raises
    ------
    BagError
        When the file is no MCAP file.
    """
    size = path.stat().st_size
    if size < len(MAGIC):
        raise BagError(f"{path}: is empty, there is no run in it. Record it again.")
    with path.open("rb") as file:
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    if data[: len(MAGIC)] != MAGIC:
        raise BagError(f"{path}: is not an MCAP file, it does not begin as one. Give a bag.")
    scan = _Scan(data, unpacker)
    try:
        scan.walk_file(progress)
    except TooLargeError as error:
        scan.damage.append(str(error))
    return RawFile(scan.topics(), scan.damage)


class _Scan:
    """One pass over a file; what its chunks unpack to is kept beside the file itself."""

    def __init__(self, data: mmap.mmap, unpacker: Unpacker) -> None:
        self.data = data
        self.damage: list[str] = []
        self._unpacker = unpacker
        self._unpacked = bytearray()
        self._in_file: list[Location] = []
        self._in_unpacked: list[Location] = []
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[int, str]] = {}

    def topics(self) -> list[RawTopic]:
        """Return the messages of every channel, those that were compressed by themselves."""
        channels = {
            number: (topic, self._schemas.get(schema, ""))
            for number, (schema, topic) in self._channels.items()
        }
        both = ((self.data, self._in_file), (self._unpacked, self._in_unpacked))
        filled = [source for source in both if source[1]]
        return [
            topic
            for data, locations in filled or both[:1]
            for topic in split_by_channel(np.frombuffer(data, np.uint8), locations, channels)
        ]

    def walk_file(self, progress: Progress | None) -> None:
        """Visit all records outside and inside of chunks."""
        position, end, chunks = len(MAGIC), len(self.data), 0
        while position + _PREFIX <= end:
            code, length = _HEAD.unpack_from(self.data, position)
            begin, stop = position + _PREFIX, position + _PREFIX + length
            if code == _DATA_END:
                return
            if code == _CHUNK:
                self._walk_chunk(begin, min(stop, end), whole=stop <= end)
                chunks += 1
                if progress and chunks % 16 == 0:
                    progress("reading", position, end)
            elif stop <= end:
                self._walk_records(self.data, position, stop, self._in_file)
            if stop > end:
                break
            position = stop
        self.damage.append(f"ends unfinished at byte {end}; read as far as it goes")

    def _walk_chunk(self, begin: int, end: int, *, whole: bool) -> None:
        if begin + _CHUNK_HEAD + 4 > end:
            return
        size, checksum = struct.unpack_from("<QI", self.data, begin + 16)
        (name_length,) = struct.unpack_from("<I", self.data, begin + _CHUNK_HEAD)
        start = begin + _CHUNK_HEAD + 4 + name_length + 8
        if start > end:
            return
        stop = min(start + _LENGTH(self.data, start - 8)[0], end)
        if not name_length:
            self._check(memoryview(self.data)[start:stop], checksum, begin)
            self._walk_records(self.data, start, stop, self._in_file, whole=whole)
            return
        name = self.data[begin + _CHUNK_HEAD + 4 : start - 8]
        try:
            content = self._unpacker.unpack(
                name.decode(errors="replace"), self.data[start:stop], size
            )
        except TooLargeError:
            raise
        except UnpackError as error:
            self.damage.append(f"has an unreadable chunk at byte {begin} ({error})")
            return
        self._check(content, checksum, begin)
        self._walk_records(content, 0, len(content), self._in_unpacked, base=len(self._unpacked))
        self._unpacked += content

    def _check(self, content: bytes | memoryview, checksum: int, at: int) -> None:
        if checksum and zlib.crc32(content) != checksum:
            self.damage.append(f"has a chunk at byte {at} that differs from its checksum")

    def _walk_records(
        self,
        data: mmap.mmap | bytes,
        position: int,
        end: int,
        locations: list[Location],
        *,
        base: int = 0,
        whole: bool = True,
    ) -> None:
        """Record the messages between two bytes; the loop does nothing but hop."""
        while position + _PREFIX <= end:
            hops: list[int] = []
            while position + _PREFIX <= end and len(hops) < _BATCH:
                hops.append(position)
                position += _PREFIX + _LENGTH(data, position + 1)[0]
            if position > end:
                last = hops.pop()
                if whole:
                    self.damage.append(
                        f"is unreadable at byte {base + last}; that part is left out"
                    )
            self._unpacker.count(len(hops))
            self._record(data, hops, locations, base)

    def _record(
        self, data: mmap.mmap | bytes, hops: list[int], locations: list[Location], base: int
    ) -> None:
        """Record the messages among the records that begin at some bytes."""
        content = np.frombuffer(data, np.uint8)
        starts = np.array(hops, np.int64)
        codes = content[starts]
        for at in starts[(codes == _SCHEMA) | (codes == _CHANNEL)].tolist():
            self._define(data, at)
        starts = starts[codes == _MESSAGE]
        if not starts.size:
            return
        lengths = _number(content, starts + 1, "<u8").astype(np.int64) - _MESSAGE_HEAD
        starts, lengths = starts[lengths >= 0], lengths[lengths >= 0]
        begin = starts + _PREFIX
        locations.append(
            Location(
                _number(content, begin, "<u2").astype(np.int64),
                base + begin + _MESSAGE_HEAD,
                lengths,
                _number(content, begin + 6, "<i8"),
            )
        )

    def _define(self, data: mmap.mmap | bytes, at: int) -> None:
        """Record a schema or a channel."""
        code, length = _HEAD.unpack_from(data, at)
        body = data[at + _PREFIX : at + _PREFIX + length]
        try:
            if code == _SCHEMA:
                (number,) = struct.unpack_from("<H", body)
                self._schemas.setdefault(number, _text(body, 2))
            else:
                number, schema = struct.unpack_from("<HH", body)
                self._channels.setdefault(number, (schema, _text(body, 4)))
        except (struct.error, UnicodeDecodeError):
            self.damage.append(f"has an unreadable topic definition at byte {at}")


def _number(content: Bytes, at: Integers, kind: str) -> Integers:
    width = np.dtype(kind).itemsize
    return np.asarray(content[at[:, np.newaxis] + np.arange(width)].view(kind)[:, 0])


def _text(body: bytes, at: int) -> str:
    (length,) = struct.unpack_from("<I", body, at)
    return body[at + 4 : at + 4 + length].decode()
