"""Decompression that stops where no honest recording goes: what is really unpacked is counted."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from typing import Protocol

SPARE = 32 * 2**20
"""Bytes that a bag of any size may unpack to."""
MESSAGE = 64
"""Bytes that it takes to know where a message lies."""
MOST_TIMES = 40
"""How many times its own size a bag may unpack to beyond that; see docs/design/mcap_scan.md."""
_PIECE = 1 << 20
_MOST_FRAMES = 1000


class UnpackError(Exception):
    """Compressed data that cannot be unpacked; the words say why."""


class TooLargeError(UnpackError):
    """A bag that unpacks to more than an honest one of its size."""


class _Decompressor(Protocol):
    """What the libraries for zstd and lz4 have in common."""

    @property
    def eof(self) -> bool: ...
    @property
    def needs_input(self) -> bool: ...
    @property
    def unused_data(self) -> bytes | None: ...
    def decompress(self, data: bytes, max_length: int = -1) -> bytes: ...


class Unpacker:
    """Unpacks the compressed pieces of one bag, as long as it stays plausible what it holds.

    Parameters
    ----------
    size : int
        Bytes of the bag as it lies on disk.
    """

    def __init__(self, size: int) -> None:
        self._most = SPARE + MOST_TIMES * size
        self._left = self._most

    def unpack(self, name: str, data: bytes, declared: int | None = None) -> bytes:
        """Return the content of a compressed piece.

        Parameters
        ----------
        name : str
            The compression, zstd or lz4.
        data : bytes
            The piece.
        declared : int, optional
            How large the piece says that its content is.

        Raises
        ------
        UnpackError
            When the compression is unknown, the piece is damaged, or not of the declared size.
        TooLargeError
            When the bag has unpacked to more than it can honestly hold.
        """
        if declared is not None and declared > self._left:
            raise self._too_large()
        content = b"".join(self.pieces(name, data, declared))
        if declared is not None and len(content) != declared:
            raise UnpackError(f"unpacks to {len(content)} bytes instead of {declared}")
        return content

    def pieces(self, name: str, data: bytes, declared: int | None = None) -> Iterator[bytes]:
        """Yield the content of a compressed piece bit by bit; see `unpack`."""
        size = 0
        for content in _stream(name, data):
            size += len(content)
            self._left -= len(content)
            if declared is not None and size > declared:
                raise UnpackError(f"unpacks to more than the {declared} bytes that it declares")
            if self._left < 0:
                raise self._too_large()
            yield content

    def count(self, records: int) -> None:
        """Count records that were found, compressed or not.

        Raises
        ------
        TooLargeError
            When there are more than the bag can honestly hold.
        """
        self._left -= MESSAGE * records
        if self._left < 0:
            raise self._too_large()

    def _too_large(self) -> TooLargeError:
        return TooLargeError(
            f"unpacks to more than {self._most / 2**20:.0f} MiB, which no recording of its size "
            "does; the rest is left out"
        )


def _stream(name: str, data: bytes) -> Iterator[bytes]:
    """Yield what compressed data unpacks to, at most `_PIECE` bytes at a time."""
    frames = 0
    while data:
        frames += 1
        if frames > _MOST_FRAMES:
            raise UnpackError(f"has more than {_MOST_FRAMES} frames")
        decompressor = _decompressor(name)
        while not decompressor.eof:
            try:
                content = decompressor.decompress(data, _PIECE)
            except Exception as error:  # each library has its own kinds
                raise UnpackError(str(error) or type(error).__name__) from error
            data = b""
            if not content and decompressor.needs_input and not decompressor.eof:
                raise UnpackError("ends unfinished")
            yield content
        data = decompressor.unused_data or b""


def _decompressor(name: str) -> _Decompressor:
    """Return what unpacks a compression, from the libraries that rosbags brings along."""
    if name == "zstd":
        module = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
        made: _Decompressor = importlib.import_module(module).ZstdDecompressor()
    elif name == "lz4":
        made = importlib.import_module("lz4.frame").LZ4FrameDecompressor()
    else:
        raise UnpackError(f"unknown compression {name}")
    return made
