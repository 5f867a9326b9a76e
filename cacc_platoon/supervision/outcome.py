"""How a run ended, once it is known what was recorded."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from cacc_platoon.runs.info import EndStatus
from cacc_platoon.scenario import Scenario
from cacc_platoon.supervision.run_events import EndRun
from cacc_platoon.supervision.run_state import joined
from cacc_platoon.supervision.stall_diagnosis import diagnose


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
    scenario: Scenario, topics: Iterable[str], end: EndRun, counts: Mapping[str, int]
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
    """
    status, message = end.status, end.message
    if status is EndStatus.FINISHED and (short := lacking(topics, scenario.samples, counts)):
        status, message = EndStatus.FAILED, short
    if status is EndStatus.FAILED:
        message = joined([message, *end.silent, diagnose(scenario, counts)])
    return status, message
