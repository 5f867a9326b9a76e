"""Where a run lies on disk; the run of a killed supervisor is finished first."""

from __future__ import annotations

from pathlib import Path

from cacc_platoon.bags.raw import BagError
from cacc_platoon.runs.folder import BAG, PARTS, SCENARIO_FILE, RunFolder
from cacc_platoon.runs.info import INFO_FILE, EndStatus, RunInfo


def locate(path: Path) -> tuple[Path, Path | None]:
    """Return the bag and the run folder around it; a killed run is finished first."""
    if not path.is_dir():
        return path, None
    folder = RunFolder(path)
    if folder.parts.is_dir() and not folder.bag.exists():
        _salvage(folder)
    if folder.bag.is_dir():
        return folder.bag, path
    if path.name == BAG and any(
        (path.parent / name).is_file() for name in (INFO_FILE, SCENARIO_FILE)
    ):
        return path, path.parent
    return path, None


def _salvage(folder: RunFolder) -> None:
    """Make the bag of a run whose supervisor was killed."""
    try:
        recording = folder.recording()
        scenario = folder.scenario()
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BagError(
            f"{folder.path}: its {PARTS}/ cannot be read ({error}). Run it again."
        ) from error
    if not any(len(record.messages) for record in recording.values()):
        raise BagError(f"{folder.path}: the run ended before anything was recorded. Run it again.")
    folder.finish(
        scenario,
        recording,
        RunInfo(EndStatus.FAILED, "its supervisor was killed; this is what had been recorded"),
    )
