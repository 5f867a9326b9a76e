"""Lets a run in lockstep wait in the middle: the leader gets no further than a sample.

All follow the data, so a platoon whose leader waits comes to rest by itself, with every message
delivered; what it publishes later is what it would have published without the pause.
"""

from __future__ import annotations

from typing import TypeAlias

from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.run_event import MOST_TURNS, EventKind, RunEvent
from cacc_platoon.supervision.run_events import Action, PauseAsked, ResumeAsked, StepAsked, Tell
from cacc_platoon.supervision.run_state import OWN_HOST, Run, Stage

Asked: TypeAlias = PauseAsked | ResumeAsked | StepAsked


def planned_pause(scenario: Scenario) -> int | None:
    """Return the sample at which a run pauses by itself."""
    run = scenario.run
    return None if run.pause_at < 0.0 else round(run.pause_at / run.step)


def refused(run: Run, asked: Asked) -> str:
    """Say why nothing comes of what a user asks for; empty when something does."""
    if run.stage is not Stage.RUNNING:
        return f"the run is {run.stage}: it can be paused while it is running"
    if isinstance(asked, PauseAsked):
        return f"paused at sample {run.held} already" if run.held_since is not None else ""
    return "the run is not paused" if run.held_since is None else ""


def heed(run: Run, asked: Asked, scenario: Scenario, now: float) -> tuple[Run, list[Action]]:
    """Return the run after a user was heeded, and what everybody is told."""
    match asked:
        case PauseAsked():
            return run._replace(held=max(run.allowed, 0)), []
        case StepAsked(samples):
            return run._replace(held=(run.held or 0) + samples, moved=now), []
        case _:
            started = _started(run, scenario, now)
            on = run._replace(held=None, held_since=None, moved=now, started=started)
            return on, _told(run, EventKind.RESUME)


def allow(run: Run, sample: int, now: float) -> tuple[Run, list[Action]]:
    """Let the leader go as far as a sample, or to where the run pauses if that comes first."""
    if run.held is None or sample < run.held:
        return run._replace(allowed=sample), []
    run = run._replace(allowed=run.held)
    if run.held_since is not None:
        return run, []
    run = run._replace(held_since=now, pauses=run.pauses + 1)
    return run, _told(run, EventKind.PAUSE)


def _told(run: Run, kind: EventKind) -> list[Action]:
    """Return what everybody is told, unless that has come too often."""
    if run.pauses > MOST_TURNS:
        return []
    return [Tell(RunEvent(kind, run.held or 0, OWN_HOST))]


def _started(run: Run, scenario: Scenario, now: float) -> float:
    """Return when a run would have started that has come as far without a pause."""
    assert run.started is not None
    if pace := scenario.run.real_time_factor:
        return now - run.allowed * scenario.run.step / pace
    return run.started + now - (now if run.held_since is None else run.held_since)


def rests(run: Run, scenario: Scenario) -> bool:
    """Return whether a run is paused and has come to where it waits.

    Recorders say how far they are every so many samples, so the last ones are not waited for.
    """
    return run.held_since is not None and run.progress + scenario.run.stride > (run.held or 0)
