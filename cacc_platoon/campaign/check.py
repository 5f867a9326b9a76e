"""Whether what came of a fault is in the table, and whether what always holds did hold."""

from __future__ import annotations

import re
import signal
from collections.abc import Iterator
from dataclasses import dataclass

from cacc_platoon.campaign.plan import Fault
from cacc_platoon.campaign.table import BY_SIGNAL, FINISHED, SIGNALLED, Ending, row_of

SHOWN = 400
"""Characters of what a command said that a line shows."""


@dataclass(frozen=True)
class Outcome:
    """What came of a fault.

    Attributes
    ----------
    seconds : float
        How long the command took [s].
    exit_code : int, optional
        How it ended; None when it had to be ended.
    said : str
        What it printed on standard error.
    state, message : str
        What run.json says after `platoon report`; "none" and empty without one.
    report_code : int, optional
        How `platoon report` ended; None when there was nothing to report on.
    report_said : str
        What that printed on standard error.
    suspects : tuple of str
        Texts of which one has to be told where the table asks for a name.
    late : bool
        Whether the run was over before the fault came.
    samples, wrong_from : int, optional
        Samples in the bag, and the first that is not what it has to be; None without such.
    doubted_from : int, optional
        The first sample of which the run itself says that it may be wrong.
    intact : bool, optional
        Whether a finished run has all samples, with the digest that they have to have.
    collided : bool
        Whether vehicles collided, which they never do in these scenarios.
    broken : tuple of str
        What cannot be read or hold anything else than it should: bag, run.json, other platoons.
    tracebacks : tuple of str
        Where there is one: a log or what was printed.
    living : tuple of int
        Processes that did not end.
    left : tuple of str
        Files that were left behind in shared memory or the temporary folder.
    """

    seconds: float = 0.0
    exit_code: int | None = None
    said: str = ""
    state: str = "none"
    message: str = ""
    report_code: int | None = None
    report_said: str = ""
    suspects: tuple[str, ...] = ()
    late: bool = False
    samples: int | None = None
    wrong_from: int | None = None
    doubted_from: int | None = None
    intact: bool | None = None
    collided: bool = False
    broken: tuple[str, ...] = ()
    tracebacks: tuple[str, ...] = ()
    living: tuple[int, ...] = ()
    left: tuple[str, ...] = ()


def findings(fault: Fault, outcome: Outcome) -> list[str]:
    """Return a line for everything that did not hold; none when all is well."""
    return [*_unlike_the_table(fault, outcome), *_never(fault, outcome)]


def _unlike_the_table(fault: Fault, outcome: Outcome) -> Iterator[str]:
    """Say that a run ended in no state of the table."""
    row = row_of(fault)
    endings = (FINISHED, *row.endings) if outcome.late else row.endings
    reasons = [_differs(fault, outcome, ending) for ending in endings]
    if all(reasons):
        yield f"ended in no state of the table: {'; or '.join(dict.fromkeys(reasons))}"


def _differs(fault: Fault, outcome: Outcome, ending: Ending) -> str:
    """Return why an outcome is not an ending; empty when it is."""
    codes = {_code(fault, code) for code in ending.codes}
    if outcome.state != ending.state or outcome.exit_code not in codes:
        wanted = ", ".join(map(str, sorted(codes)))
        return (
            f"{outcome.state} with exit code {outcome.exit_code}, not {ending.state} with {wanted}"
        )
    text = f"{outcome.message}\n{outcome.said}\n{outcome.report_said}"
    for words in ending.words:
        if not re.search(words, text):
            return f"nothing says {words!r}: {text.strip()[:SHOWN]!r}"
    if ending.named and not any(name in text for name in outcome.suspects):
        return f"names none of {', '.join(outcome.suspects)}: {text.strip()[:SHOWN]!r}"
    return ""


def _code(fault: Fault, code: int | str) -> int:
    name = "SIGKILL" if fault.kind == "kill" else fault.variant
    number = signal.Signals[name] if name in signal.Signals.__members__ else 0
    if isinstance(code, int):
        return code
    return {SIGNALLED: 128 + number, BY_SIGNAL: -number}[code]


def _never(fault: Fault, outcome: Outcome) -> Iterator[str]:
    """Say what must never be, whatever happened."""
    if outcome.exit_code is None:
        yield f"did not end within {outcome.seconds:.0f} s"
    for where in outcome.tracebacks:
        yield f"a traceback in {where}"
    yield from outcome.broken
    if outcome.report_code not in (None, 0, 1, 2):
        yield f"report ends with {outcome.report_code}: {outcome.report_said[-SHOWN:]!r}"
    if outcome.state == "finished" and outcome.intact is False:
        yield "finished, and is not what it has to be"
    if outcome.collided:
        yield "vehicles collided"
    if outcome.wrong_from is not None:
        yield from _wrong_data(fault, outcome, outcome.wrong_from)
    if outcome.living:
        yield f"processes {', '.join(map(str, outcome.living))} live on"
    for name in outcome.left:
        yield f"{name} was left behind"


def _wrong_data(fault: Fault, outcome: Outcome, sample: int) -> Iterator[str]:
    """Wrong samples may be in a bag only where the run says from which on that may be."""
    doubted = outcome.doubted_from
    if not fault.kind.startswith(("flood", "forged", "foreign")):
        yield f"sample {sample} in the bag is wrong, and nobody was there to make it so"
    elif doubted is None and "publisher" not in outcome.message:
        yield f"sample {sample} in the bag is wrong, and nothing says so"
    elif doubted is not None and sample < doubted:
        yield f"sample {sample} in the bag is wrong, before {doubted} of which the run warns"
