"""The rows of a study as they come: appended to one file, so that none is computed twice."""

from __future__ import annotations

import fcntl
import json
from collections.abc import Mapping
from io import BufferedRandom
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from cacc_platoon.errors import UserError

ROWS_FILE = "rows.jsonl"


class RowResult(NamedTuple):
    """What came of a row.

    Attributes
    ----------
    row : int
        Its number.
    values : dict of str to value
        By the plan's columns; empty where it failed.
    met : dict of str to bool
        Which criteria it meets.
    failed : str
        Why there are no values; empty where there are.
    """

    row: int
    values: Mapping[str, Any]
    met: Mapping[str, bool]
    failed: str = ""

    @property
    def passed(self) -> bool:
        """Whether it meets every criterion."""
        return not self.failed and all(self.met.values())

    def to_json(self) -> str:
        """Return the row as a line."""
        return json.dumps(
            {"row": self.row, "values": self.values, "met": self.met, "failed": self.failed}
        )

    @classmethod
    def from_json(cls, line: bytes) -> RowResult:
        """Return the row that a line holds.

        Raises
        ------
        ValueError
            When it holds none.
        """
        found = json.loads(line)
        try:
            return cls(found["row"], found["values"], found["met"], found["failed"])
        except (KeyError, TypeError) as error:
            raise ValueError("no row") from error


class RowsFile:
    """The rows so far, on disk before anybody counts them.

    A process that is killed leaves at most the beginning of its last line, which is removed.

    Parameters
    ----------
    path : Path
        Made where it is not there.

    Attributes
    ----------
    rows : dict of int to RowResult
        All rows so far, by number.

    Raises
    ------
    UserError
        When a line that is whole is no row, or another process writes to it.
    """

    def __init__(self, path: Path) -> None:
        path.touch()
        self._file: BufferedRandom = path.open("r+b")
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._file.close()
            raise UserError(
                f"{path.parent}: another process evaluates this study, and rows of both would be "
                "lost. Wait for it, or choose another folder with -o."
            ) from error
        self.rows: dict[int, RowResult] = {}
        kept = 0
        for number, line in enumerate(self._file, start=1):
            if not line.endswith(b"\n"):
                break
            try:
                row = RowResult.from_json(line)
            except ValueError as error:
                self._file.close()
                raise UserError(
                    f"{path}: line {number} is no row of a study, so that what it held would be "
                    "missing. Remove that line to compute it again."
                ) from error
            self.rows[row.row] = row
            kept += len(line)
        self._file.seek(kept)
        self._file.truncate()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def add(self, row: RowResult) -> None:
        """Write a row down; it is on its way to the disk when this returns."""
        self._file.write(row.to_json().encode() + b"\n")
        self._file.flush()
        self.rows[row.row] = row
