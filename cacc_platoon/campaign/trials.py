"""Tries the faults of a campaign, each in a process of its own and within a time limit."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from cacc_platoon.campaign.check import Outcome, findings
from cacc_platoon.campaign.plan import Fault

TRIAL_LIMIT = 480.0
"""How long one trial may take, all its waiting included [s]."""
GOODBYE = 15.0
"""How long a trial may take to end its platoon [s]."""
NAMESPACE = ("unshare", "--user", "--map-root-user", "--net")
OUTCOME_FILE = "outcome.json"
ERRORS_FILE = "trial.txt"


class Trial(NamedTuple):
    """A fault, what came of it, what did not hold, and where the files are that show it.

    Attributes
    ----------
    fault : Fault
        What happened.
    outcome : Outcome
        What came of it.
    findings : tuple of str
        What did not hold; empty when all is well.
    folder : Path, optional
        What is left of the run; None when all is well.
    """

    fault: Fault
    outcome: Outcome
    findings: tuple[str, ...]
    folder: Path | None


@cache
def namespaces_work() -> bool:
    """Return whether this user may make a network of its own on this machine."""
    with contextlib.suppress(OSError):
        return (
            subprocess.run([*NAMESPACE, "true"], capture_output=True, check=False).returncode == 0
        )
    return False


def try_all(
    faults: Sequence[Fault],
    folder: Path,
    *,
    scenario: Path | None = None,
    jobs: int = 1,
    tell: Callable[[Trial], None] = lambda _: None,
) -> list[Trial]:
    """Try faults, so many at once, and return what came of each, in their order.

    Parameters
    ----------
    faults : sequence of Fault
        What happens.
    folder : Path
        Below which each has a folder; those in which all was well are removed again.
    scenario : Path, optional
        Whose platoon it is.
    jobs : int, optional
        How many platoons run at once.
    tell : callable, optional
        Called with each trial as it ends.
    """
    processes: set[subprocess.Popen[bytes]] = set()
    done: list[Trial] = []
    with ThreadPoolExecutor(jobs) as pool:
        asked = [pool.submit(_try, fault, folder, scenario, processes) for fault in faults]
        try:
            for one in as_completed(asked):
                done.append(one.result())
                tell(done[-1])
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in [*processes]:
                process.send_signal(signal.SIGTERM)
            raise
    return sorted(done, key=lambda trial: trial.fault.index)


def _try(
    fault: Fault,
    folder: Path,
    scenario: Path | None,
    processes: set[subprocess.Popen[bytes]],
) -> Trial:
    """Try one fault; whatever happens, its process comes to an end."""
    own = folder / f"{fault.seed}-{fault.index}-{fault.kind}"
    own.mkdir(parents=True)
    command = [sys.executable, "-m", "cacc_platoon.campaign.trial"]
    command += [json.dumps(dataclasses.asdict(fault)), str(own)]
    if scenario:
        command += ["--scenario", str(scenario)]
    if fault.needs_namespace:
        command = [*NAMESPACE, *command]
    begun = time.monotonic()
    with (own / ERRORS_FILE).open("wb") as said:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=said, stderr=subprocess.STDOUT
        )
        processes.add(process)
        in_time = _ended(process)
        processes.discard(process)
    try:
        outcome = _outcome(json.loads((own / OUTCOME_FILE).read_text(encoding="utf-8")))
        found = findings(fault, outcome)
    except (OSError, ValueError, KeyError, TypeError):
        outcome = Outcome(time.monotonic() - begun)
        last = (own / ERRORS_FILE).read_text(errors="replace").strip()[-400:]
        found = [f"the trial {'failed' if in_time else 'did not end'}: {last!r}"]
    if not found:
        shutil.rmtree(own, ignore_errors=True)
    return Trial(fault, outcome, tuple(found), own if found else None)


def _ended(process: subprocess.Popen[bytes]) -> bool:
    """Wait for the end of a trial; return whether it came by itself."""
    for limit, number in ((TRIAL_LIMIT, signal.SIGTERM), (GOODBYE, signal.SIGKILL)):
        try:
            process.wait(limit)
        except subprocess.TimeoutExpired:
            process.send_signal(number)
        else:
            return number is signal.SIGTERM
    process.wait()
    return False


def _outcome(document: dict[str, Any]) -> Outcome:
    """Return the outcome that a trial has written down."""
    lists = {key: tuple(value) for key, value in document.items() if isinstance(value, list)}
    return Outcome(**{**document, **lists})
