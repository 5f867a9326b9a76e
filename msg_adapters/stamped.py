"""Stamped geometry_msgs as CDR bytes: what nodes publish and subscribe to, and bags hold.

A message of a topic with a fixed frame_id has one fixed layout (little-endian CDR): stamp at byte
4, frame_id at byte 12, zero padding to a multiple of 8 behind the 4-byte header, then doubles.
Only the stamp and the leading one or two doubles carry the domain's values.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

HEADER = b"\x00\x01\x00\x00"
SECOND = 1_000_000_000
_FRAME_AT = 16


class LayoutError(ValueError):
    """Bytes that are no message of the expected type and frame."""


class Kind(NamedTuple):
    """A message type: a header, then `doubles` numbers, all zero but the first two and `tail`.

    `field` is the path of the first of them inside of the message.
    """

    type_name: str
    field: str
    doubles: int
    tail: tuple[float, ...] = ()


POSE = Kind("geometry_msgs/msg/PoseStamped", "pose.position.x", 7, (1.0,))
TWIST = Kind("geometry_msgs/msg/TwistStamped", "twist.linear.x", 6)
ACCEL = Kind("geometry_msgs/msg/AccelStamped", "accel.linear.x", 6)
VECTOR = Kind("geometry_msgs/msg/Vector3Stamped", "vector.x", 3)


class StampedCodec:
    """Packs and unpacks the messages of one kind and frame.

    x is the position [m], velocity [m/s] or acceleration [m/s^2] along the road; y is used by
    Vector3Stamped alone.

    Examples
    --------
    >>> codec = StampedCodec(ACCEL, "vehicle_1/base_link")
    >>> codec.decode(codec.encode(20_000_000, 0.5))
    (20000000, 0.5)
    """

    def __init__(self, kind: Kind, frame_id: str) -> None:
        frame = frame_id.encode() + b"\0"
        gap = struct.pack("<I", len(frame)) + frame
        gap += bytes(-(len(gap) + 8) % 8)
        tail = bytes(8 * (kind.doubles - 2 - len(kind.tail)))
        tail += struct.pack(f"<{len(kind.tail)}d", *kind.tail)
        self.size = len(HEADER) + 8 + len(gap) + 8 * kind.doubles
        self._gap, self._tail = gap, tail
        self.padding = (_FRAME_AT + len(frame), 12 + len(gap))
        self._packer = struct.Struct(f"<4siI{len(gap)}sdd{len(tail)}s")
        self._unpacker = struct.Struct(f"<4xiI{len(gap)}xd")
        self._both_unpacker = struct.Struct(f"<4xiI{len(gap)}xdd")
        self._record = np.dtype(
            {
                "names": ["sec", "nanosec", "x", "y"],
                "formats": ["<i4", "<u4", "<f8", "<f8"],
                "offsets": [4, 8, 12 + len(gap), 20 + len(gap)],
                "itemsize": self.size,
            }
        )

    def encode(self, stamp: int, x: float, y: float = 0.0) -> bytes:
        """Return the CDR bytes of a message stamped `stamp` [ns]; padding is zero."""
        seconds, nanoseconds = divmod(stamp, SECOND)
        return self._packer.pack(HEADER, seconds, nanoseconds, self._gap, x, y, self._tail)

    def decode(self, data: bytes) -> tuple[int, float]:
        """Return stamp [ns] and x.

        Raises
        ------
        LayoutError
            When the length is not that of this kind and frame.
        """
        if len(data) != self.size:
            raise LayoutError(f"has {len(data)} bytes where {self.size} are due")
        seconds, nanoseconds, x = self._unpacker.unpack_from(data)
        return seconds * SECOND + nanoseconds, x

    def decode_both(self, data: bytes) -> tuple[int, float, float]:
        """Return stamp [ns], x and y; see `decode`."""
        if len(data) != self.size:
            raise LayoutError(f"has {len(data)} bytes where {self.size} are due")
        seconds, nanoseconds, x, y = self._both_unpacker.unpack_from(data)
        return seconds * SECOND + nanoseconds, x, y

    def values(self, messages: npt.NDArray[np.uint8], field: str = "x") -> npt.NDArray[np.float64]:
        """Return x, or y, of many messages given as rows of bytes, shape (n, size) -> (n,)."""
        return np.array(self._fields(messages)[field], np.float64)

    def stamps(self, messages: npt.NDArray[np.uint8]) -> npt.NDArray[np.int64]:
        """Return the stamps [ns] of many messages, shape (n, size) -> (n,)."""
        fields = self._fields(messages)
        return np.asarray(fields["sec"].astype(np.int64) * SECOND + fields["nanosec"])

    def encode_many(
        self, stamps: npt.ArrayLike, x: npt.ArrayLike, y: npt.ArrayLike = 0.0
    ) -> npt.NDArray[np.uint8]:
        """Return the CDR bytes of many messages, shape (len(stamps), size)."""
        stamps = np.asarray(stamps)
        template = np.frombuffer(self.encode(0, 0.0), np.uint8)
        messages = np.tile(template, (len(stamps), 1))
        records = messages.view(self._record)[:, 0]
        records["sec"], records["nanosec"] = stamps // SECOND, stamps % SECOND
        records["x"], records["y"] = x, y
        return messages

    def _fields(self, messages: npt.NDArray[np.uint8]) -> npt.NDArray[np.void]:
        return np.ascontiguousarray(messages).view(self._record)[:, 0]

    def zero_padding(self, data: bytes) -> bytes:
        """Return a message of this layout with its frame's padding zeroed, for comparison."""
        begin, end = self.padding
        return data[:begin] + bytes(end - begin) + data[end:]


def stamps_of(messages: npt.NDArray[np.uint8]) -> npt.NDArray[np.int64]:
    """Return the header stamps [ns] of stamped messages given as rows, shape (n, size) -> (n,)."""
    head = np.ascontiguousarray(messages[:, 4:12])
    seconds, nanoseconds = head.view("<i4")[:, 0], head.view("<u4")[:, 1]
    return np.asarray(seconds.astype(np.int64) * SECOND + nanoseconds)
