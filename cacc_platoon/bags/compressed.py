"""Bags that rosbag2 has compressed as a whole, file by file or message by message."""

from __future__ import annotations

from pathlib import Path

from cacc_platoon.bags.collector import Collector
from cacc_platoon.bags.raw import Progress, RawFile
from cacc_platoon.bags.unpack import TooLargeError, Unpacker, UnpackError

FORMAT = "zstd"
"""The only compression that rosbag2 has."""


def unpack_file(file: Path, folder: Path, unpacker: Unpacker) -> tuple[Path, list[str]]:
    """Unpack a compressed storage file into a folder.

    Returns
    -------
    Path, list of str
        The storage file, and what was wrong with the compressed one.
    """
    target, damage = folder / file.stem, list[str]()
    with target.open("wb") as output:
        try:
            for piece in unpacker.pieces(FORMAT, file.read_bytes()):
                output.write(piece)
        except UnpackError as error:
            damage.append(_damage(error))
    return target, damage


def unpack_messages(file: RawFile, unpacker: Unpacker, progress: Progress | None) -> RawFile:
    """Return a storage file with its messages unpacked, up to the first that cannot be."""
    damage = list(file.damage)
    channels = {n: (topic.name, topic.type_name) for n, topic in enumerate(file.topics)}
    total = sum(len(topic.lengths) for topic in file.topics)
    collector, done = Collector(), 0
    try:
        for number, topic in enumerate(file.topics):
            for log_time, data in zip(topic.log_times.tolist(), topic.messages(), strict=True):
                collector.add(number, log_time, unpacker.unpack(FORMAT, data))
                done += 1
            if progress:
                progress("reading", done, total)
    except UnpackError as error:
        damage.append(_damage(error))
    return collector.finish(channels, damage)


def _damage(error: UnpackError) -> str:
    if isinstance(error, TooLargeError):
        return str(error)
    return f"is damaged ({error}); read as far as it goes"
