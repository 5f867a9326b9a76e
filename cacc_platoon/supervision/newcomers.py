"""Two platoons of one name: a newcomer looks before it shows itself, and one of two gives way."""

from __future__ import annotations

from collections.abc import Sequence

from cacc_platoon.supervision.belief import ADVICE, FOREIGN
from cacc_platoon.supervision.protocol import RunPhase
from cacc_platoon.supervision.run_events import RivalHeard
from cacc_platoon.supervision.run_state import Run, refuse

NEWCOMER_WAIT = 0.4
"""How long a run looks for a platoon of the same name before it shows itself [s], at least."""
NEWCOMER_LOOKS = 10
"""How often it looks meanwhile, at least: on a busy machine, time alone shows nothing."""
RIVAL_PATIENCE = 5.0
"""How long another supervisor may take to give way [s]."""
_FURTHER = (RunPhase.WAITING, RunPhase.MATCHING, RunPhase.RUNNING)


def looked_enough(run: Run, now: float, wait: float) -> bool:
    """Whether a platoon of the same name would have been seen; with no `wait`, one look is."""
    return now - run.since > wait and run.looks >= (NEWCOMER_LOOKS if wait else 1)


def met(run: Run, rival: RivalHeard, now: float, topic: str) -> Run:
    """Return the run after another supervisor of the same name was heard on a topic.

    Who is further stays, and of two that begin at once, the run that comes first by its name; the
    other one gives way. So exactly one does.
    """
    if rival.run == run.id:
        return refuse(run, f"{topic}: a message in the name of this run, from {FOREIGN}")
    if rival.phase.ended or run.end is not None:
        return run
    ours, theirs = _FURTHER.index(run.phase), _FURTHER.index(rival.phase)
    both_begin = ours == theirs and run.phase is not RunPhase.RUNNING
    if ours < theirs or (both_begin and rival.run < run.id):
        return refuse(run, f"{topic}: run {rival.run!r:.50} was there before. {ADVICE}")
    return run if run.rival_since is not None else run._replace(rival_since=now)


def without_rival(
    run: Run, foreign: Sequence[str], now: float, control: Sequence[str]
) -> Sequence[str]:
    """Leave out, for a while, what comes from a supervisor that has to give way.

    Parameters
    ----------
    run : Run
        The state of the run.
    foreign : sequence of str
        A line, which begins with the topic, for each topic that others publish.
    now : float
        The time [s].
    control : sequence of str
        The topics of a supervisor. Once the run runs, only what is found there is left out.
    """
    if run.rival_since is None or now - run.rival_since > RIVAL_PATIENCE:
        return foreign
    if run.phase is RunPhase.WAITING:
        return ()
    return [line for line in foreign if line.partition(" ")[0] not in control]
