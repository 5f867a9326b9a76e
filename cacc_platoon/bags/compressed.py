"""Compressed bags, by way of rosbags."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from cacc_platoon.bags.collector import BATCH, Collector
from cacc_platoon.bags.raw import BagError, Progress, RawFile


def read_with_rosbags(path: Path, progress: Progress | None = None) -> RawFile:
    """Find every message of a compressed bag by way of rosbags.

    Parameters
    ----------
    path : Path
        A bag's folder, or one storage file.

    Raises
    ------
    BagError
        When rosbags cannot open it.
    """
    from rosbags.rosbag2 import Reader  # noqa: PLC0415  (seldom needed)

    collector, damage = Collector(), list[str]()
    channels: dict[int, tuple[str, str]] = {}
    try:
        with Reader(path) as reader:
            connections = reader.connections
            channels = {c.id: (c.topic, c.msgtype) for c in connections}
            total = reader.message_count
            messages: Iterable[tuple[object, int, bytes]] = reader.messages(connections)
            for count, (connection, log_time, data) in enumerate(messages):
                collector.add(connection.id, log_time, bytes(data))  # type: ignore[attr-defined]
                if progress and count % BATCH == 0:
                    progress("reading", count, total)
    except Exception as error:  # rosbags lets errors of its decompressors through
        reason = " ".join(str(error).split()) or type(error).__name__
        if not channels:
            raise BagError(f"{path}: cannot be read as a bag ({reason}). Give a bag.") from error
        damage.append(f"is damaged ({reason}); read as far as it goes")
    return collector.finish(channels, damage)
