"""What one host has recorded: one append-only file of CDR bytes a topic, readable at any moment."""

from __future__ import annotations

import contextlib
import json
import os
import re
from collections.abc import Callable, Iterable
from errno import ENOENT, ENOSPC
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from cacc_platoon.bags.rows import TopicRows
from cacc_platoon.errors import UserError
from cacc_platoon.formats import Format
from cacc_platoon.texts import TextError, read_json
from msg_adapters.topics import Topic

INDEX_FILE = "topics.json"
FORMAT = Format(f"{INDEX_FILE} of a part", 1)
_FILE = re.compile(r"\d{1,9}\.cdr")
_LARGEST_MESSAGE = 1 << 16
_LOOKS = 20


class PartWriter:
    """Records the messages of some topics in a folder, one file per topic, append-only.

    A part needs no closing to be readable: what was flushed is there, whatever happened later.

    Parameters
    ----------
    folder : Path
        Made by the writer; must not exist.
    topics : list of Topic
        What will be written.
    run : str, optional
        What tells the run from every other, where that is known.
    buffered : bool, optional
        Whether the last messages wait in this process, where they are lost if it is killed.
    """

    def __init__(
        self, folder: Path, topics: list[Topic], run: str = "", *, buffered: bool = True
    ) -> None:
        folder.mkdir(parents=True)
        self._folder, self._made = folder, folder.stat()
        topics_index = [
            {
                "name": topic.name,
                "type": topic.kind.type_name,
                "size": topic.codec.size,
                "file": f"{number:04d}.cdr",
            }
            for number, topic in enumerate(topics)
        ]
        index = {"format": FORMAT.version, "run": run, "topics": topics_index}
        unfinished = folder / f"{INDEX_FILE}.new"  # whoever reads meanwhile finds all of it or none
        unfinished.write_text(json.dumps(index, indent=1))
        unfinished.replace(folder / INDEX_FILE)
        self._files = {
            str(entry["name"]): _opened(folder / str(entry["file"]), buffered=buffered)
            for entry in topics_index
        }
        self._sizes = {topic.name: topic.codec.size for topic in topics}
        self.writers: dict[str, Callable[[bytes], object]] = {
            name: file.write if buffered else _writing_all(file)
            for name, file in self._files.items()
        }

    def count(self, name: str) -> int:
        """Return how many messages of a topic were flushed so far; none once closed."""
        file = self._files[name]
        return 0 if file.closed else os.fstat(file.fileno()).st_size // self._sizes[name]

    def message(self, name: str, number: int) -> bytes:
        """Return one of the messages of a topic that were flushed.

        Raises
        ------
        LookupError
            When there is none of that number.
        """
        if not 0 <= number < self.count(name):
            raise LookupError(f"{name} has no message {number}")
        size = self._sizes[name]
        return os.pread(self._files[name].fileno(), size, number * size)

    def flush(self) -> None:
        """Hand everything to the operating system; harmless once closed.

        Raises
        ------
        OSError
            When the disk does not take it, or the files are no longer where they were made.
        """
        for file in self._files.values():
            if not file.closed:
                file.flush()
                if not os.fstat(file.fileno()).st_nlink:
                    raise FileNotFoundError(ENOENT, "deleted while the run goes on", file.name)
        if not _is(self._folder, self._made):
            raise FileNotFoundError(ENOENT, "moved while the run goes on", str(self._folder))

    def close(self) -> None:
        """Flush and close as far as the disk lets it; harmless when done twice."""
        for file in self._files.values():
            with contextlib.suppress(OSError):
                file.close()


def _opened(path: Path, *, buffered: bool) -> BinaryIO:
    """Open a new file to be written, whose descriptor can be read from."""

    def opener(name: str, flags: int) -> int:
        return os.open(name, flags & ~os.O_WRONLY | os.O_RDWR, 0o666)

    return open(path, "wb", -1 if buffered else 0, opener=opener)


def _writing_all(file: BinaryIO) -> Callable[[bytes], object]:
    """Return what writes to a file without a buffer: a disk may take the beginning alone."""

    def write(data: bytes) -> None:
        if file.write(data) < len(data):
            raise OSError(ENOSPC, os.strerror(ENOSPC), file.name)

    return write


def _is(path: Path, made: os.stat_result) -> bool:
    """Return whether a path still leads to what was made there."""
    try:
        return os.path.samestat(path.stat(), made)
    except FileNotFoundError:
        return False


def read_parts(folders: list[Path]) -> dict[str, TopicRows]:
    """Return what the parts hold, mapped from disk; a message cut short at the end is left out.

    Raises
    ------
    UserError
        When the index of a part is damaged, or its format is newer than ours.
    """
    records: dict[str, TopicRows] = {}
    for folder in folders:
        index = folder / INDEX_FILE
        if not index.is_file():
            continue
        for entry in _entries(index):
            path, size = folder / entry.file, entry.size
            count = path.stat().st_size // size if path.is_file() else 0
            messages = (
                np.memmap(path, np.uint8, "r", shape=(count, size))
                if count
                else np.empty((0, size), np.uint8)
            )
            records[entry.name] = TopicRows(entry.type_name, messages)
    return records


def run_of_part(folder: Path) -> str | None:
    """Return what a part says of which run it is, "" where it does not; None for no part.

    Raises
    ------
    UserError
        When its format is newer than ours.
    """
    index = folder / INDEX_FILE
    try:
        document = read_json(index)
    except TextError:
        return None
    if not isinstance(document, dict):
        return "" if isinstance(document, list) else None
    FORMAT.check(document.get("format"), str(index))
    run = document.get("run", "")
    return run if isinstance(run, str) else None


def longest_of(folders: Iterable[Path]) -> dict[str, TopicRows]:
    """Return of each topic what the part holds that has most of it, the first of equal ones."""
    found: dict[str, TopicRows] = {}
    for folder in folders:
        for name, rows in read_parts([folder]).items():
            if name not in found or len(rows.messages) > len(found[name].messages):
                found[name] = rows
    return found


def newest_of(parts: Path, ended: Path) -> dict[str, TopicRows]:
    """Return of each topic what was recorded last, of hosts that may be started again meanwhile.

    Parameters
    ----------
    parts, ended : Path
        The folder in which hosts record, and that of the parts of hosts that ended, to which parts
        are moved.
    """
    for attempt in range(_LOOKS):
        # A part that moves is seen in the second folder, if not in the first.
        found = [*sorted(parts.glob("*")), *sorted(ended.glob("*"), key=_age, reverse=True)]
        try:
            records = longest_of(found)
        except (FileNotFoundError, UserError):
            if attempt == _LOOKS - 1:
                raise
            continue
        if all(folder.is_dir() for folder in found):
            break
    return records


def _age(part: Path) -> tuple[int, str]:
    """Sort parts of hosts that ended by their number, the last part of their names."""
    number = part.name.rpartition("_")[2]
    return (int(number) if number.isdecimal() else -1, part.name)


class _Entry(NamedTuple):
    """What an index says of a topic."""

    name: str
    type_name: str
    size: int
    file: str

    @classmethod
    def of(cls, found: Any) -> _Entry:
        """Return a checked entry; a file lies beside its index, whatever the index says."""
        entry = cls(found["name"], found["type"], found["size"], found["file"])
        sized = type(entry.size) is int and 0 < entry.size <= _LARGEST_MESSAGE
        texts = all(isinstance(text, str) for text in (entry.name, entry.type_name))
        if not (sized and texts and _FILE.fullmatch(entry.file)):
            raise ValueError("an entry is none of a topic")
        return entry


def _entries(index: Path) -> list[_Entry]:
    """Return what an index says of each topic; format 0 was that list alone."""
    try:
        document = read_json(index)
        if isinstance(document, dict):
            FORMAT.check(document.get("format"), str(index))
            document = document["topics"]
        if not isinstance(document, list):
            raise ValueError("no list of topics")
        return [_Entry.of(entry) for entry in document]
    except (TextError, ValueError, TypeError, KeyError) as error:
        raise UserError(
            f"{index}: is damaged ({error}), so nothing says what was recorded beside it. "
            f"Restore it, or remove {index.parent} to go on without."
        ) from error
