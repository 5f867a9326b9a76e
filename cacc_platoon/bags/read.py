"""Which storage files make up a bag, with or without its metadata."""

from __future__ import annotations

import re
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from cacc_platoon.bags.compressed import unpack_file, unpack_messages
from cacc_platoon.bags.mcap_scan import read_mcap
from cacc_platoon.bags.raw import BagError, Progress, RawFile, RawTopic
from cacc_platoon.bags.rows import FORMAT, FORMAT_KEY
from cacc_platoon.bags.sqlite_scan import read_sqlite
from cacc_platoon.bags.unpack import Unpacker
from cacc_platoon.formats import Format
from cacc_platoon.scenario.yaml_text import YamlTextError, load_yaml
from cacc_platoon.texts import TextError, read_text

METADATA = "metadata.yaml"
_STORAGE = (".mcap", ".db3")
_COMPRESSED = ".zstd"
_MOST_DAMAGE = 20
_TOPICS = re.compile(r"^  topics_with_message_count:\n(?:(?: {4}|  -).*\n)*", re.MULTILINE)
"""What a bag's metadata says of its topics: not needed, and long where there are many."""


class RawBag(NamedTuple):
    """All messages of a bag.

    Attributes
    ----------
    path : Path
        Its folder, or its one storage file.
    topics : dict of str to list of RawTopic
        By name; one part per storage file, in their order.
    damage : list of str
        What was wrong with the files, one line each.
    custom_data : dict of str to str
        What the recorder wrote into the metadata.
    """

    path: Path
    topics: dict[str, list[RawTopic]]
    damage: list[str]
    custom_data: dict[str, str]


def read_bag(path: Path, progress: Progress | None = None) -> RawBag:
    """Read a rosbag2 bag: MCAP or sqlite3, whole or split, compressed or not.

    Parameters
    ----------
    path : Path
        A bag's folder or one of its storage files.
    progress : callable, optional
        Called periodically with what is being done, how much is done and how much there is.

    Raises
    ------
    BagError
        When nothing in it can be read.
    UserError
        When it follows conventions newer than ours.
    """
    try:
        path.stat()
    except OSError as error:
        raise BagError(f"{path}: {error.strerror}. Give a run folder or a bag.") from error
    metadata, damage = _metadata(path)
    custom = _custom_data(metadata)
    version = custom.get(FORMAT_KEY)
    FORMAT.check(None if version is None else Format.number(version), str(path))
    files = _storage_files(path, metadata, damage)
    reading = _Reading(
        Unpacker(sum(file.stat().st_size for file in files)),
        str(metadata.get("compression_mode")).lower() == "message",
        progress,
    )
    parts: list[RawFile] = []
    refusals: list[BagError] = []
    for file in files:
        try:
            part = reading.read(file)
        except BagError as error:
            refusals.append(error)
            damage.append(str(error))
            continue
        parts.append(part)
        damage += [f"{file.name} {line}" for line in part.damage]
    if not parts and refusals:
        raise refusals[0]
    topics: dict[str, list[RawTopic]] = {}
    for part in parts:
        for topic in part.topics:
            topics.setdefault(topic.name, []).append(topic)
    if len(damage) > _MOST_DAMAGE:
        damage[_MOST_DAMAGE:] = [f"and {len(damage) - _MOST_DAMAGE} more faults"]
    return RawBag(path, topics, damage, custom)


def _custom_data(metadata: dict[str, Any]) -> dict[str, str]:
    custom = metadata.get("custom_data")
    return {str(k): str(v) for k, v in custom.items()} if isinstance(custom, dict) else {}


class _Reading(NamedTuple):
    """How the storage files of a bag are read."""

    unpacker: Unpacker
    message_by_message: bool
    progress: Progress | None

    def read(self, file: Path) -> RawFile:
        """Find every message of a storage file, compressed or not."""
        try:
            if file.suffix == _COMPRESSED:
                with TemporaryDirectory() as folder:
                    unpacked, damage = unpack_file(file, Path(folder), self.unpacker)
                    found = self._read_storage(unpacked)
                found.damage[:0] = damage
            else:
                found = self._read_storage(file)
        except OSError as error:
            raise BagError(f"{file}: cannot be read ({error.strerror}).") from error
        if self.message_by_message:
            return unpack_messages(found, self.unpacker, self.progress)
        return found

    def _read_storage(self, file: Path) -> RawFile:
        if file.suffix == ".mcap":
            return read_mcap(file, self.unpacker, self.progress)
        return read_sqlite(file, self.unpacker, self.progress)


def _metadata(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Return the bag's metadata as far as it can be read, and what is wrong with it."""
    if path.is_file():
        return {}, []
    file = path / METADATA
    if not file.is_file():
        return {}, [f"{METADATA} is missing; the storage files were read without it"]
    try:
        document = load_yaml(_TOPICS.sub("", read_text(file)))
    except (TextError, YamlTextError):
        document = None
    metadata = document.get("rosbag2_bagfile_information") if isinstance(document, dict) else None
    if not isinstance(metadata, dict):
        return {}, [f"{METADATA} is damaged; the storage files were read without it"]
    return metadata, []


def _is_storage(file: Path) -> bool:
    name = file.with_suffix("") if file.suffix == _COMPRESSED else file
    return name.suffix in _STORAGE and file.is_file()


def _storage_files(path: Path, metadata: dict[str, Any], damage: list[str]) -> list[Path]:
    if not path.is_dir():
        if not _is_storage(path):
            raise BagError(f"{path}: is no .mcap or .db3 file. Give a run folder or a bag.")
        return [path]
    found = {file.name: file for file in sorted(path.iterdir()) if _is_storage(file)}
    named = metadata.get("relative_file_paths")
    listed = [PurePath(str(name)).name for name in named] if isinstance(named, list) else []
    damage += [f"{name} is named in {METADATA} and missing" for name in listed if name not in found]
    files = [found[name] for name in dict.fromkeys([*listed, *found]) if name in found]
    if not files:
        raise BagError(f"{path}: holds no .mcap or .db3 file. Give a run folder or a bag.")
    return files
