"""How a platoon's run ended."""

from __future__ import annotations

from dataclasses import dataclass

from cacc_platoon.runs.folder import RunFolder
from cacc_platoon.runs.info import RunInfo
from cacc_platoon.simulation import Trajectory


@dataclass(frozen=True)
class Result:
    """How a platoon's run ended.

    Attributes
    ----------
    exit_code : int
        Of the command.
    status, message, digest : str
        As in run.json: "finished", "failed" or "interrupted", why, and the run's digest.
    info : RunInfo or None
        All of run.json; None when there is none.
    folder : RunFolder
        The run's files.
    output, errors : str
        What the command printed.
    """

    exit_code: int
    status: str
    message: str
    digest: str
    info: RunInfo | None
    folder: RunFolder
    output: str
    errors: str

    def trajectory(self) -> Trajectory:
        """Return the arrays of the run, read from its bag."""
        from cacc_platoon.runs.recorded_run import read_run  # noqa: PLC0415  (heavy)

        return read_run(self.folder.bag).trajectory
