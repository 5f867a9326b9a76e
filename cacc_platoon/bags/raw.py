"""Messages as they lie in a storage file: where each one is, and nothing copied yet."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from cacc_platoon.errors import UserError

Bytes: TypeAlias = npt.NDArray[np.uint8]
Integers: TypeAlias = npt.NDArray[np.int64]
Progress: TypeAlias = Callable[[str, int, int], None]
"""Called periodically with what is being done, how much of it is done, how much there is."""


_BLOCK = 1 << 16


class BagError(UserError):
    """A bag that cannot be read: the line names the file, what is wrong and what helps."""


class RawTopic(NamedTuple):
    """The messages of one topic in one storage file.

    Attributes
    ----------
    name, type_name : str
        Topic and message type.
    data : ndarray of uint8
        The file, or the decompressed messages.
    offsets, lengths : ndarray of int64, shape (n,)
        Where each message's CDR bytes begin in `data`, and how many they are.
    log_times : ndarray of int64, shape (n,)
        Time of recording [ns].
    """

    name: str
    type_name: str
    data: Bytes
    offsets: Integers
    lengths: Integers
    log_times: Integers

    def gather(self, at: Integers | int, width: int) -> Bytes:
        """Return `width` bytes of every message from its byte `at` on, shape (n, width)."""
        begin, columns = self.offsets + at, np.arange(width)
        rows = np.empty((len(begin), width), np.uint8)
        for first in range(0, len(begin), _BLOCK):  # an index takes eight times what it finds
            block = slice(first, first + _BLOCK)
            rows[block] = self.data[begin[block, np.newaxis] + columns]
        return rows

    def select(self, rows: npt.NDArray[np.bool_] | Integers) -> RawTopic:
        """Return some of the messages."""
        return self._replace(
            offsets=self.offsets[rows],
            lengths=self.lengths[rows],
            log_times=self.log_times[rows],
        )

    def messages(self) -> Iterator[bytes]:
        """Yield the CDR bytes of each message."""
        for offset, length in zip(self.offsets.tolist(), self.lengths.tolist(), strict=True):
            yield self.data[offset : offset + length].tobytes()


class RawFile(NamedTuple):
    """What one storage file holds, and what was wrong with it."""

    topics: list[RawTopic]
    damage: list[str]


class Location(NamedTuple):
    """Positions of messages of all topics, in the order of the file; arrays of one length."""

    channel: Integers
    offset: Integers
    length: Integers
    log_time: Integers


def split_by_channel(
    data: Bytes, locations: list[Location], channels: dict[int, tuple[str, str]]
) -> list[RawTopic]:
    """Return the topics of a file from the positions of its messages.

    Parameters
    ----------
    data : ndarray of uint8
        What the offsets point into.
    locations : list of Location
        Consecutive parts of the file.
    channels : dict of int to (topic, type)
        Channels by number; messages of other channels are left out.
    """
    if not locations:
        locations = [Location(*(np.empty(0, np.int64) for _ in Location._fields))]
    channel, offset, length, log_time = (
        np.concatenate(columns) for columns in zip(*locations, strict=True)
    )
    order = np.argsort(channel, kind="stable")
    numbers = np.array(sorted(channels), np.int64)
    begins = np.searchsorted(channel[order], numbers, "left")
    ends = np.searchsorted(channel[order], numbers, "right")
    topics = []
    for number, begin, end in zip(numbers.tolist(), begins, ends, strict=True):
        rows = order[begin:end]
        topics.append(RawTopic(*channels[number], data, offset[rows], length[rows], log_time[rows]))
    return topics
