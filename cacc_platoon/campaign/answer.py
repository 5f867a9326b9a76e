"""A campaign as one table for a terminal and as one JSON object."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cacc_platoon.campaign.trials import Trial
from cacc_platoon.formats import Format

FORMAT = Format("campaign --json", 1)
_HEAD = ("fault", "kind", "how", "to", "in a run", "at", "state", "exit", "s", "")


def line_of(trial: Trial) -> tuple[str, ...]:
    """Return the cells of one trial."""
    fault, outcome = trial.fault, trial.outcome
    lossy = " lossy" if fault.lossy else ""
    code = "-" if outcome.exit_code is None else str(outcome.exit_code)
    return (
        str(fault.index),
        fault.kind,
        fault.how,
        fault.target,
        f"{fault.sync} {fault.hosts}{lossy}",
        f"{fault.moment} {fault.fraction:.2f}",
        outcome.state,
        code,
        f"{outcome.seconds:.1f}",
        "NOT" if trial.findings else "ok",
    )


def table(trials: Sequence[Trial], arguments: str = "") -> list[str]:
    """Return the lines of a campaign's table; below it what did not hold and how to repeat it.

    Parameters
    ----------
    trials : sequence of Trial
        What came of each fault.
    arguments : str, optional
        What `platoon campaign` needs to repeat them besides seed and index.
    """
    rows = [_HEAD, *map(line_of, trials)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_HEAD))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    for trial in trials:
        if trial.findings:
            lines += ["", *_not_held(trial, arguments)]
    held = sum(not trial.findings for trial in trials)
    return [*lines, "", f"{len(trials)} faults, {held} ended as they may, {len(trials) - held} not"]


def _not_held(trial: Trial, arguments: str) -> list[str]:
    fault = trial.fault
    again = f"platoon campaign --seed {fault.seed} --only-index {fault.index}{arguments}"
    return [
        f"{fault.index} {fault.kind}:",
        *(f"  {line}" for line in trial.findings),
        f"  in {trial.folder}; again: {again}",
    ]


def document(seed: int, trials: Sequence[Trial]) -> dict[str, Any]:
    """Return what `campaign --json` prints."""
    return {
        "format": FORMAT.version,
        "seed": seed,
        "held": all(not trial.findings for trial in trials),
        "faults": [_entry(trial) for trial in trials],
    }


def _entry(trial: Trial) -> dict[str, Any]:
    fault, outcome = trial.fault, trial.outcome
    return {
        "index": fault.index,
        "kind": fault.kind,
        "target": fault.target,
        "variant": fault.variant,
        "amount": fault.amount,
        "moment": str(fault.moment),
        "fraction": fault.fraction,
        "sync": fault.sync,
        "hosts": fault.hosts,
        "lossy": fault.lossy,
        "state": outcome.state,
        "exit_code": outcome.exit_code,
        "seconds": outcome.seconds,
        "samples": outcome.samples,
        "message": outcome.message,
        "findings": list(trial.findings),
        "folder": None if trial.folder is None else str(trial.folder),
    }
