"""A run on disk: its folder, its parts while it runs, what a bag says of it."""

from cacc_platoon.runs.folder import RunFolder
from cacc_platoon.runs.recorded_run import RecordedRun, read_run

__all__ = ["RecordedRun", "RunFolder", "read_run"]
