"""Recorded messages in memory: per topic, the CDR bytes of all of them as rows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt


class TopicRows(NamedTuple):
    """The messages of one topic: row k, of shape (size,), is the message of sample k."""

    type_name: str
    messages: npt.NDArray[np.uint8]


Recording: TypeAlias = Mapping[str, TopicRows]
