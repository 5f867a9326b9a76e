"""Which storage files make up a bag, with or without its metadata."""

from __future__ import annotations

from pathlib import Path, PurePath
from typing import Any, NamedTuple

from ruamel.yaml import YAML

from cacc_platoon.bags.compressed import read_with_rosbags
from cacc_platoon.bags.mcap_scan import read_mcap
from cacc_platoon.bags.raw import BagError, Progress, RawFile, RawTopic
from cacc_platoon.bags.rows import FORMAT, FORMAT_KEY
from cacc_platoon.bags.sqlite_scan import read_sqlite

METADATA = "metadata.yaml"
_READERS = {".mcap": read_mcap, ".db3": read_sqlite}
_COMPRESSED = ".zstd"


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
    FORMAT.check(int(version) if version and version.isdecimal() else version, str(path))
    parts: list[RawFile] = []
    refusals: list[BagError] = []
    mode = str(metadata.get("compression_mode") or "").lower()
    if mode not in ("", "none"):
        parts.append(read_with_rosbags(path, progress))
    else:
        for file in _storage_files(path, metadata, damage):
            try:
                part = _read_file(file, progress)
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
    return RawBag(path, topics, damage, custom)


def _custom_data(metadata: dict[str, Any]) -> dict[str, str]:
    custom = metadata.get("custom_data")
    return {str(k): str(v) for k, v in custom.items()} if isinstance(custom, dict) else {}


def _read_file(file: Path, progress: Progress | None) -> RawFile:
    if file.suffix == _COMPRESSED:
        raise BagError(f"{file}: is compressed and its metadata is missing. Unpack it with zstd.")
    try:
        return _READERS[file.suffix](file, progress)
    except OSError as error:
        raise BagError(f"{file}: cannot be read ({error.strerror}).") from error


def _metadata(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Return the bag's metadata as far as it can be read, and what is wrong with it."""
    if path.is_file():
        return {}, []
    file = path / METADATA
    if not file.is_file():
        return {}, [f"{METADATA} is missing; the storage files were read without it"]
    try:
        document = YAML(typ="safe", pure=True).load(file.read_text(encoding="utf-8"))
        metadata = document["rosbag2_bagfile_information"]
        if not isinstance(metadata, dict):
            raise TypeError
    except Exception:  # a damaged document fails in many ways, all of them mean the same
        return {}, [f"{METADATA} is damaged; the storage files were read without it"]
    return metadata, []


def _storage_files(path: Path, metadata: dict[str, Any], damage: list[str]) -> list[Path]:
    if path.is_file():
        if path.suffix not in (*_READERS, _COMPRESSED):
            raise BagError(f"{path}: is no .mcap or .db3 file. Give a run folder or a bag.")
        return [path]
    found = sorted(
        file
        for file in path.iterdir()
        if file.suffix in (*_READERS, _COMPRESSED) and file.is_file()
    )
    named = metadata.get("relative_file_paths")
    listed = [path / PurePath(str(n)).name for n in named] if isinstance(named, list) else []
    for file in listed:
        if not file.is_file():
            damage.append(f"{file.name} is named in {METADATA} and missing")
    files = [file for file in listed if file in found]
    files += [file for file in found if file not in files]
    if not files:
        raise BagError(f"{path}: holds no .mcap or .db3 file. Give a run folder or a bag.")
    return files
