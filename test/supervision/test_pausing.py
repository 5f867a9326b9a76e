"""Runs that wait in the middle, step by step, and go on; no clock, no process, no message."""

from __future__ import annotations

from typing import Any

import pytest

from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.run_event import MOST_TURNS, EventKind
from cacc_platoon.supervision import pausing
from cacc_platoon.supervision.run_events import Action, PauseAsked, ResumeAsked, StepAsked, Tell
from cacc_platoon.supervision.run_state import Run, Stage

STARTED = 50.0
"""When the runs here began to run [s]."""


def scenario(**settings: object) -> Scenario:
    values: dict[str, object] = {"platoon.followers": 1, "run.window": 8}
    return Scenario.from_values(values | {k.replace("__", "."): v for k, v in settings.items()})


def running(allowed: int = 20, **changes: Any) -> Run:
    """Return a run whose leader may go as far as a sample."""
    run = Run("f00d", Stage.RUNNING, STARTED, started=STARTED, allowed=allowed, progress=12)
    return run._replace(**changes)


def kinds(actions: list[Action]) -> list[tuple[EventKind, int]]:
    return [(one.event.kind, one.event.sample) for one in actions if isinstance(one, Tell)]


def test_a_pause_is_where_the_leader_has_been_let_go() -> None:
    run, _ = pausing.heed(running(20), PauseAsked(), scenario(), 60.0)
    run, told = pausing.allow(run, 33, 60.0)
    assert run.allowed == run.held == 20
    assert kinds(told) == [(EventKind.PAUSE, 20)]
    run, told = pausing.allow(run, 40, 61.0)
    assert (run.allowed, told) == (20, [])


def test_a_planned_pause_lets_the_run_come_that_far() -> None:
    assert pausing.planned_pause(scenario()) is None
    assert pausing.planned_pause(scenario(run__pause_at=0.3)) == 30
    assert pausing.planned_pause(scenario(run__pause_at=0.0)) == 0
    run, told = pausing.allow(running(20, held=30), 29, 60.0)
    assert (run.allowed, told, run.held_since) == (29, [], None)
    run, told = pausing.allow(run, 31, 61.0)
    assert (run.allowed, kinds(told), run.held_since) == (30, [(EventKind.PAUSE, 30)], 61.0)


def test_a_step_goes_on_by_its_samples_and_is_a_pause_still() -> None:
    held = running(20, held=20, held_since=60.0)
    run, told = pausing.heed(held, StepAsked(3), scenario(), 70.0)
    run, more = pausing.allow(run, 33, 70.0)
    assert (run.allowed, run.held, run.held_since, run.moved) == (23, 23, 60.0, 70.0)
    assert (told, more) == ([], [])


def test_after_a_pause_the_leader_goes_on_at_once() -> None:
    held = running(20, held=20, held_since=60.0)
    run, told = pausing.heed(held, ResumeAsked(), scenario(), 75.0)
    assert kinds(told) == [(EventKind.RESUME, 20)]
    run, told = pausing.allow(run, 33, 75.0)
    assert (run.allowed, run.held, told) == (33, None, [])


def test_a_pause_takes_no_time_of_the_run() -> None:
    held = running(20, held=20, held_since=60.0)
    run, _ = pausing.heed(held, ResumeAsked(), scenario(), 75.0)
    assert run.started == STARTED + 15.0
    assert run.moved == 75.0
    paced = scenario(run__real_time_factor=2.0)
    run, _ = pausing.heed(held._replace(allowed=400), ResumeAsked(), paced, 75.0)
    assert run.started == pytest.approx(75.0 - 400 * 0.01 / 2.0)


def test_a_run_rests_when_the_last_word_of_its_recorders_has_come() -> None:
    one = scenario(run__window=8)  # a word every 2 samples
    assert one.run.stride == 2
    held = running(21, held=21, held_since=60.0)
    assert not pausing.rests(held._replace(progress=19), one)
    assert pausing.rests(held._replace(progress=20), one)
    assert not pausing.rests(running(20, held=30, progress=29), one)


def test_what_cannot_be_is_refused_with_the_reason() -> None:
    starting = Run("f00d", Stage.MATCHING, STARTED)
    assert pausing.refused(starting, PauseAsked()) == (
        "the run is connecting nodes: it can be paused while it is running"
    )
    assert pausing.refused(running(), ResumeAsked()) == "the run is not paused"
    assert pausing.refused(running(), StepAsked(1)) == "the run is not paused"
    assert pausing.refused(running(20, held=30), ResumeAsked()) == "the run is not paused"
    held = running(20, held=20, held_since=60.0)
    assert pausing.refused(held, PauseAsked()) == "paused at sample 20 already"
    assert not pausing.refused(running(20, held=30), PauseAsked())  # sooner than was planned
    assert not pausing.refused(running(), PauseAsked())
    assert not pausing.refused(held, StepAsked(1))
    assert not pausing.refused(held, ResumeAsked())


def test_pauses_without_end_are_not_told_without_end() -> None:
    run, told = running(), 0
    for _ in range(3 * MOST_TURNS):
        run, actions = pausing.heed(run, PauseAsked(), scenario(), 60.0)
        run, more = pausing.allow(run, 99, 60.0)
        run, on = pausing.heed(run, ResumeAsked(), scenario(), 60.0)
        told += len([*actions, *more, *on])
    assert told == 2 * MOST_TURNS
