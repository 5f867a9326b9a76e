"""How a run ended, once it is known what was recorded."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from cacc_platoon.runs.info import EndStatus
from cacc_platoon.scenario import Scenario
from cacc_platoon.supervision.run_events import EndRun
from cacc_platoon.supervision.run_state import joined
from cacc_platoon.supervision.stall_diagnosis import (
    last_sample,
    stopped_first,
    stopped_together,
)


def lacking(topics: Iterable[str], samples: int, counts: Mapping[str, int]) -> str:
    """Say which topic lacks samples; empty when every topic has all of them.

    Parameters
    ----------
    topics : iterable of str
        What had to be recorded.
    samples : int
        How many samples of each.
    counts : mapping of str to int
        How many were.
    """
    for topic in topics:
        if (count := counts.get(topic, 0)) != samples:
            return f"{topic}: only {count} of {samples} samples were recorded"
    return ""


def conclude(
    scenario: Scenario,
    topics: Iterable[str],
    end: EndRun,
    counts: Mapping[str, int],
    samples: int,
) -> tuple[EndStatus, str]:
    """Return how a run ended and why it did not finish.

    Parameters
    ----------
    scenario : Scenario
        What was run.
    topics : iterable of str
        What had to be recorded.
    end : EndRun
        How the run ended as far as its nodes know.
    counts : mapping of str to int
        How many samples of each topic were recorded.
    samples : int
        How many there have to be.
    """
    status, message, stalled = end.status, end.message, end.stalled
    if status is EndStatus.FINISHED and (short := lacking(topics, samples, counts)):
        status, message, stalled = EndStatus.FAILED, short, True
    if status is EndStatus.FAILED:
        who = stopped_first(scenario, counts) if stalled else []
        if stalled and not who and not end.silent and counts:
            who = stopped_together(scenario, counts)
        message = joined([message, *end.silent, *who, last_sample(scenario, counts)])
    return status, message
