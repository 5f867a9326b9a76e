"""From the bytes of a topic to its stamps and values, all messages at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cacc_platoon.bags.raw import Bytes, Integers, RawTopic
from msg_adapters.stamped import SECOND, Kind

Floats = npt.NDArray[np.float64]

_CDR = 4  # bytes before the CDR stream; alignment counts from there
_FRAME_AT = 16
_LITTLE = np.array([0x00, 0x01], np.uint8)
_BIG = np.array([0x00, 0x00], np.uint8)


class Signal(NamedTuple):
    """One topic's values in the order of recording.

    Attributes
    ----------
    topic : str
        Name.
    stamps : ndarray of int64, shape (n,)
        Header stamps [ns].
    values : ndarray, shape (n,)
        The message's number along the road: x [m], v [m/s] or a [m/s^2].
    unreadable : int
        Messages that are no message of the topic's type, left out.
    """

    topic: str
    stamps: Integers
    values: Floats
    unreadable: int


def decode(parts: list[RawTopic], kind: Kind) -> Signal:
    """Return the signal of one topic.

    The layout is worked out for each message from its own header, so frames of any length and
    either byte order are read; y and z and all rotations are left alone.

    Parameters
    ----------
    parts : list of RawTopic
        Its messages, one part per storage file.
    kind : Kind
        The message type.
    """
    stamps, values, times, unreadable = [], [], [], 0
    for part in parts:
        readable = part.select(part.lengths >= _FRAME_AT)
        head = readable.gather(0, _FRAME_AT)
        good = np.zeros(len(head), np.bool_)
        for order, mark in (("<", _LITTLE), (">", _BIG)):
            rows = np.flatnonzero((head[:, :2] == mark).all(axis=1))
            chosen = readable.select(rows)
            begin, fits = _layout(head[rows], chosen.lengths, order, kind)
            good[rows] = fits
            rows, chosen, begin = rows[fits], chosen.select(fits), begin[fits]
            stamps.append(_stamps(head[rows], order))
            values.append(chosen.gather(begin, 8).view(f"{order}f8")[:, 0].astype(np.float64))
            times.append(chosen.log_times)
        unreadable += len(part.lengths) - int(good.sum())
    order_of_recording = np.argsort(np.concatenate(times), kind="stable")
    return Signal(
        parts[0].name,
        np.concatenate(stamps)[order_of_recording],
        np.concatenate(values)[order_of_recording],
        unreadable,
    )


def _layout(
    head: Bytes, lengths: Integers, order: str, kind: Kind
) -> tuple[Integers, npt.NDArray[np.bool_]]:
    """Return where the first double begins, and whether length and layout agree."""
    frame = head[:, 12:16].copy().view(f"{order}u4")[:, 0].astype(np.int64)
    begin = _CDR + -(-(_FRAME_AT - _CDR + frame) // 8) * 8
    size = begin + 8 * kind.doubles
    return begin, (lengths >= size) & (lengths < size + 8)


def _stamps(head: Bytes, order: str) -> Integers:
    seconds = head[:, 4:8].copy().view(f"{order}i4")[:, 0].astype(np.int64)
    nanoseconds = head[:, 8:12].copy().view(f"{order}u4")[:, 0]
    return np.asarray(seconds * SECOND + nanoseconds, np.int64)


def rows_in_stamp_order(parts: list[RawTopic]) -> Bytes | None:
    """Return a topic's messages as rows of bytes in stamp order, padding zeroed, for the digest.

    Returns
    -------
    ndarray of uint8, shape (n, size), or None
        None when the messages are not all of one length and frame.
    """
    rows = rows_in_order_of_recording(parts)
    if rows is None:
        return None
    stamps = _stamps(rows[:, :_FRAME_AT], "<")
    if (np.diff(stamps) < 0).any():
        rows = rows[np.argsort(stamps, kind="stable")]
    return rows


def rows_in_order_of_recording(parts: list[RawTopic]) -> Bytes | None:
    """Return a topic's messages as rows of bytes as they were recorded, padding zeroed.

    None as in `rows_in_stamp_order`.
    """
    blocks = [part.gather(0, int(part.lengths[0])) for part in parts if _uniform(part)]
    if len(blocks) != sum(1 for part in parts if len(part.lengths)) or not blocks:
        return None
    if len({block.shape[1] for block in blocks}) != 1 or blocks[0].shape[1] < _FRAME_AT:
        return None
    rows = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
    frames = rows[:, 12:16]
    if (frames != frames[0]).any():
        return None
    frame_end = _FRAME_AT + int(frames[0].copy().view("<u4")[0])
    rows[:, frame_end : _CDR + -(-(frame_end - _CDR) // 8) * 8] = 0
    return rows


def _uniform(part: RawTopic) -> bool:
    return len(part.lengths) > 0 and bool((part.lengths == part.lengths[0]).all())
