"""A part as a stream of bytes: how it gets from the machine of a host to the one of the run.

The stream has the messages of each topic, in an order that both sides know, behind how many bytes
they are, and the SHA-256 of all that at its end. Who receives it writes a part of his own with the
topics that he expects, so that neither a name nor a size in the stream decides what is written.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path

from cacc_platoon.runs.parts import PartWriter, read_parts
from msg_adapters.topics import Topic

CHUNK = 8 * 2**10
"""Bytes of one piece: few packets of a network, so that few of them are sent in vain."""
_SIZE = struct.Struct("<Q")
_HASH = hashlib.sha256().digest_size


class StreamError(Exception):
    """A piece that is none of the stream; the line says why."""


class PartSource:
    """Reads the stream of a closed part.

    Parameters
    ----------
    folder : Path
        The part.
    topics : sequence of str
        What it holds, in the order of the stream.
    """

    def __init__(self, folder: Path, topics: Sequence[str]) -> None:
        records = read_parts([folder])
        self._messages = [records[topic].messages for topic in topics]

    def pieces(self) -> Iterator[bytes]:
        """Yield the stream piece by piece."""
        hashed, piece = hashlib.sha256(), b""
        for data in self._data():
            hashed.update(data)
            piece += data
            if len(piece) >= CHUNK:
                yield piece
                piece = b""
        yield piece + hashed.digest()

    def _data(self) -> Iterator[bytes]:
        for messages in self._messages:
            yield _SIZE.pack(messages.size)
            rows = max(1, CHUNK // messages.shape[1])
            for row in range(0, len(messages), rows):
                yield messages[row : row + rows].tobytes()


class PartSink:
    """Writes what arrives of a stream as a part.

    Parameters
    ----------
    folder : Path
        The part, made here.
    topics : list of Topic
        What it holds, in the order of the stream.
    samples : int
        Of the run: no topic has more messages.

    Attributes
    ----------
    received : int
        How many bytes of the stream are here.
    complete : bool
        Whether that is all of it.
    """

    def __init__(self, folder: Path, topics: list[Topic], samples: int) -> None:
        self.received, self.complete = 0, False
        self._part = PartWriter(folder, topics)
        self._left = list(topics)
        self._samples = samples
        self._hashed = hashlib.sha256()
        self._waiting = b""
        self._topic: Topic | None = None
        self._due = 0

    def take(self, offset: int, piece: bytes) -> None:
        """Take the piece that begins at an offset; one that is here already is passed over.

        Raises
        ------
        StreamError
            When it is none of the stream.
        OSError
            When it cannot be written.
        """
        if offset + len(piece) <= self.received:
            return
        if offset != self.received:
            raise StreamError(f"byte {offset} came where {self.received} was due")
        self.received += len(piece)
        data = self._waiting + piece
        while (rest := self._write(data)) is not None:
            data = rest
        self._waiting = data

    def close(self) -> None:
        """Close the part."""
        self._part.close()

    def _write(self, data: bytes) -> bytes | None:
        """Write what is complete at the beginning of the data; None where nothing is."""
        if self._topic is None:
            return self._begin(data)
        size = self._topic.codec.size
        whole = min(self._due, len(data) // size * size)
        if not whole:
            return None
        self._hashed.update(data[:whole])
        self._part.writers[self._topic.name](data[:whole])
        self._due -= whole
        if not self._due:
            self._topic = None
        return data[whole:]

    def _begin(self, data: bytes) -> bytes | None:
        """Read how many bytes the next topic has; behind the last one, whether all is well."""
        if not self._left:
            self._end(data)
            return None
        if len(data) < _SIZE.size:
            return None
        (due,) = _SIZE.unpack_from(data)
        topic = self._left.pop(0)
        if due % topic.codec.size or due > self._samples * topic.codec.size:
            raise StreamError(f"{topic.name} cannot have {due} bytes")
        self._hashed.update(data[: _SIZE.size])
        self._topic, self._due = (topic, due) if due else (None, 0)
        return data[_SIZE.size :]

    def _end(self, data: bytes) -> None:
        if len(data) > _HASH or self.complete:
            raise StreamError("more came than there is")
        if len(data) == _HASH:
            if data != self._hashed.digest():
                raise StreamError("it is not what was sent")
            self._part.flush()
            self.complete = True
