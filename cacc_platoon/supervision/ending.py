"""How a run ends: everybody is told, hosts take leave, and what they say then still counts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from cacc_platoon.runs.info import EndStatus
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.stepping.deliveries import DOUBT
from cacc_platoon.supervision.belief import ADVICE, FOREIGN
from cacc_platoon.supervision.protocol import HostPhase, RunPhase, sendable
from cacc_platoon.supervision.run_events import Action, CloseOwnHost, EndRun, PublishStatus, Tell
from cacc_platoon.supervision.run_state import (
    NAMED_FAILURES,
    OWN_HOST,
    Run,
    Stage,
    joined,
    some,
)

GOODBYE_TIMEOUT = 3.0
"""How long hosts may take to close their parts [s]."""
ANSWER_LIMIT = 0.5
"""A host that takes longer to answer when a run has come to a stop is told of [s]."""


def fail(run: Run, now: float, reasons: Sequence[str]) -> tuple[Run, list[Action]]:
    """End a run that cannot go on."""
    status = EndStatus.INTERRUPTED if run.signal else EndStatus.FAILED
    end = EndRun(status, joined(reasons))
    if run.stage is Stage.LOOKING:  # nobody knows of this run
        return run._replace(stage=Stage.OVER, phase=RunPhase.FAILED, end=end), [end]
    run, actions = leave(run, end, now)
    return run, [*_faults(run, end, reasons), *actions]


def leave(run: Run, end: EndRun, now: float) -> tuple[Run, list[Action]]:
    """Let everybody end, with what the run came to."""
    finished = end.status is EndStatus.FINISHED
    phase = RunPhase.FINISHED if finished else RunPhase.FAILED
    run = run._replace(stage=Stage.LEAVING, since=now, phase=phase, end=end)
    return run, [PublishStatus(), CloseOwnHost()]


def take_leave(run: Run, now: float) -> tuple[Run, list[Action]]:
    """Wait for hosts to close their parts, for some time."""
    run, actions = _spoiled(_with_late(run, now))
    assert run.end is not None
    if _silent_hosts(run) and now - run.since <= GOODBYE_TIMEOUT:
        return run, actions
    end = replace(run.end, silent=_silence(run))
    return run._replace(stage=Stage.OVER, end=end), [*actions, Tell(_over(run, end)), end]


def _faults(run: Run, end: EndRun, reasons: Iterable[str]) -> list[Action]:
    """Return what the supervisor says of why a run fails, as soon as that is known."""
    if end.status is not EndStatus.FAILED:
        return []
    sample = max(run.progress, 0)
    return [
        Tell(RunEvent(EventKind.FAULT, sample, OWN_HOST, sendable(one)))
        for one in reasons
        if one != ADVICE
    ]


def _over(run: Run, end: EndRun) -> RunEvent:
    """Return what the supervisor says of the end of a run."""
    how = ": ".join(filter(None, [end.status, end.message]))
    return RunEvent(EventKind.END, max(run.progress, 0), OWN_HOST, sendable(how))


def _spoiled(run: Run) -> tuple[Run, list[Action]]:
    """Let a complete run fail by what a host reports while it ends, such as a full disk.

    What others send after the last sample spoils nothing, unless it came before what is ours.
    """
    failures = [host.failure for host in run.hosts.values() if host.failure]
    own = [text for text in failures if FOREIGN not in text or DOUBT in text]
    if run.phase is not RunPhase.FINISHED or not own:
        return run, []
    end = EndRun(EndStatus.FAILED, joined(own[:NAMED_FAILURES]))
    return run._replace(phase=RunPhase.FAILED, end=end), [PublishStatus()]


def _silent_hosts(run: Run) -> tuple[str, ...]:
    """Return the hosts that live, as far as is known, and have not closed."""
    return tuple(
        name
        for name, host in run.hosts.items()
        if host.phase is not HostPhase.CLOSED and name not in run.ended_processes
    )


def _with_late(run: Run, now: float) -> Run:
    """Return a stalled run, once that is over, with the hosts that do not answer at once.

    Of these is who has stopped it, though it may be there again by the time all have left.
    """
    stalled = run.end is not None and run.end.stalled
    if not stalled or run.late is not None or now - run.since <= ANSWER_LIMIT:
        return run
    return run._replace(late=_silent_hosts(run))


def _silence(run: Run) -> tuple[str, ...]:
    """Return a line for each host that has not answered, or late."""
    silent = _silent_hosts(run)
    late = [name for name in run.late or () if name not in silent]
    lines = [f"{_host_named(run, name)} does not answer" for name in silent]
    lines += [f"{_host_named(run, name)} answered only after {ANSWER_LIMIT:g} s" for name in late]
    return tuple(lines)


def _host_named(run: Run, name: str) -> str:
    host = run.hosts[name]
    return f"host {name} (process {host.pid}: {some(host.nodes)})"
