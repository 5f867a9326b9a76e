"""The digest of a run: equal digests mean equal bits."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

import numpy as np

from cacc_platoon.bags.rows import Recording, TopicRows
from msg_adapters.stamped import stamps_of
from msg_adapters.topics import Graph


def run_digest(recording: Recording, graph: Graph) -> str:
    """Return the digest of a run: over pose, twist, accel and v2v/accel of all its vehicles."""
    return digest_of(recording, [topic.name for topic in graph.run_topics])


def digest_of(recording: Recording, names: Iterable[str]) -> str:
    """Return the SHA-256 over some topics of a recording.

    The digest is the hash of the lines `<topic> <hash>`, sorted by topic; see `topic_digest`. Two
    runs agree to the last bit exactly when their digests do.
    """
    lines = sorted(
        f"{name} {topic_digest(recording[name])}\n" for name in names if name in recording
    )
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def topic_digest(record: TopicRows) -> str:
    """Return the SHA-256 of one topic's messages in the order of their delivery.

    Where any is delivered at another sample than it was sent at, the delivery stamps follow.
    """
    found = hashlib.sha256(np.ascontiguousarray(record.messages).data)
    if record.delivered is not None and (record.delivered != stamps_of(record.messages)).any():
        found.update(np.ascontiguousarray(record.delivered, "<i8").data)
    return found.hexdigest()
