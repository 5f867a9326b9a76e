"""Texts of files that anybody may have written: bounded before anything is made of them."""

from __future__ import annotations

import json
import stat
from pathlib import Path

MAX_TEXT = 4 * 2**20
"""Bytes of a scenario, a bag's metadata, a table of speeds; the largest there can be takes less."""
MAX_JSON = 8 * 2**20
"""Bytes of a JSON file; run.json of the largest platoon takes a tenth of it."""


class TextError(Exception):
    """A text that cannot be used; the words say why, without the name of the file."""


def read_text(path: Path, most: int = MAX_TEXT) -> str:
    """Return the text of a regular file of at most `most` bytes.

    Raises
    ------
    TextError
        When it is none: absent, a pipe or a device, too large, no UTF-8.
    """
    try:
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode):
            raise TextError("is a directory" if stat.S_ISDIR(mode) else "is a pipe or a device")
        with path.open("rb") as file:
            data = file.read(most + 1)
        check_size(len(data), most)
        return data.decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except OSError as error:
        raise TextError(str(error.strerror)) from error
    except UnicodeDecodeError as error:
        raise TextError("is not a text file") from error
    except ValueError as error:  # a NUL in its name
        raise TextError("is no name that a file can have") from error


def check_size(size: int, most: int = MAX_TEXT) -> None:
    """Raise TextError when there is more of a text than can be wanted."""
    if size > most:
        raise TextError(f"is larger than {most / 2**20:g} MiB")


def read_json(path: Path) -> object:
    """Return what a JSON file holds.

    Raises
    ------
    TextError
        When it is no JSON file, or larger or deeper than anything that is written here.
    """
    try:
        return json.loads(read_text(path, MAX_JSON))
    except (ValueError, RecursionError) as error:
        why = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise TextError(f"is no JSON that can be read ({why})") from error
