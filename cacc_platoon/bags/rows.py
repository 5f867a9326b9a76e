"""Recorded messages in memory: per topic, the CDR bytes of all of them as rows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from cacc_platoon.formats import Format

FORMAT = Format("bag", 1)
FORMAT_KEY = "cacc_platoon_format"
"""Where a bag's metadata says which version of our conventions it follows."""


class TopicRows(NamedTuple):
    """The messages of one topic, in the order of their delivery.

    Attributes
    ----------
    type_name : str
        Message type.
    messages : ndarray of uint8, shape (n, size)
        CDR bytes; the header stamp in them is that of the source.
    delivered : ndarray of int64, shape (n,), optional
        Stamps [ns] of the samples at which they are delivered, never decreasing. Without them row k
        is the message of sample k, delivered at that sample.
    """

    type_name: str
    messages: npt.NDArray[np.uint8]
    delivered: npt.NDArray[np.int64] | None = None


Recording: TypeAlias = Mapping[str, TopicRows]
