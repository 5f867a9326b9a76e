"""The folder of a study: what it is, its rows as they come, and what is made of them."""

from __future__ import annotations

import json
from pathlib import Path

from cacc_platoon.errors import UserError
from cacc_platoon.formats import Format
from cacc_platoon.runs.folder import versions
from cacc_platoon.sweep.plan import Plan
from cacc_platoon.sweep.rows import ROWS_FILE, RowsFile
from cacc_platoon.texts import TextError, read_json

FORMAT = Format("sweep.json", 1)
STUDY_FILE = "sweep.json"


def open_study(folder: Path, plan: Plan, backend: str) -> RowsFile:
    """Begin a study in a new folder, or go on with the same one.

    Parameters
    ----------
    folder : Path
        Made where it is not there.
    plan : Plan
        The study.
    backend : str
        How its rows are evaluated.

    Raises
    ------
    UserError
        When the folder holds anything else.
    """
    file = folder / STUDY_FILE
    described = {
        "format": FORMAT.version,
        "plan": plan.name,
        "rows": plan.rows,
        "backend": backend,
        "fingerprint": plan.fingerprint,
        "versions": {name: versions()[name] for name in ("cacc_platoon", "numpy")},
    }
    unfinished = folder / f"{STUDY_FILE}.new"
    if not folder.exists() or {*folder.iterdir()} <= {unfinished}:
        folder.mkdir(parents=True, exist_ok=True)
        unfinished.write_text(json.dumps(described, indent=1), encoding="utf-8")
        unfinished.replace(file)
    elif (found := _read(file)) != described:
        differs = [key for key, value in described.items() if found.get(key) != value]
        raise UserError(
            f"{folder}: holds another study (its {differs[0]} is not that of this one), and rows "
            "of two would be mixed. Choose another folder with -o."
        )
    return RowsFile(folder / ROWS_FILE)


def _read(file: Path) -> dict[str, object]:
    try:
        found = read_json(file)
    except TextError as error:
        raise UserError(
            f"{file.parent}: is there and holds no study ({file.name} {error}). Choose another "
            "folder with -o."
        ) from error
    if not isinstance(found, dict):
        raise UserError(f"{file}: is no description of a study. Choose another folder with -o.")
    FORMAT.check(found.get("format"), str(file))
    return found
