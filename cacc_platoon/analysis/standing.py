"""Whether the data of a run stand: what a verdict on its design says nothing about."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from cacc_platoon.analysis.consistency import (
    TOLERANCE,
    Consistency,
    check_consistency,
    check_leader,
    check_links,
)
from cacc_platoon.runs.info import EndStatus
from cacc_platoon.runs.recorded_run import RecordedRun
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import Trajectory


class DataState(StrEnum):
    """How the data of a run stand."""

    INTACT = "intact"
    ALTERED = "altered"
    CUT = "cut"
    FAILED = "failed"
    UNLIKE = "unlike"
    UNCHECKED = "unchecked"


_HEADLINES = {
    DataState.INTACT: "DATA INTACT",
    DataState.ALTERED: "DATA ALTERED",
    DataState.CUT: "DATA CUT SHORT",
    DataState.FAILED: "RUN FAILED",
    DataState.UNLIKE: "DATA UNLIKE THE SCENARIO",
    DataState.UNCHECKED: "DATA UNCHECKED",
}

_BY_DIGEST = "complete, with the digest that was written when the run ended"
_BY_SCENARIO = (
    "complete; no digest was written, but leader, links and followers do what the scenario gives, "
    f"within {TOLERANCE:g}"
)
_SUBJECTS = ("the leader's motion", "what arrives over V2V", "the followers' motion")


class Recomputation(NamedTuple):
    """The recorded values beside those that are due; see `cacc_platoon.analysis.consistency`."""

    leader: Consistency
    links: Consistency
    followers: Consistency

    @property
    def unknown(self) -> list[str]:
        """What nothing is known to compare with."""
        return [one.unknown for one in self if one.unknown]


@dataclass(frozen=True)
class Standing:
    """How the data of a run stand.

    Attributes
    ----------
    state : DataState
        In one word.
    line : str
        Why, for a sentence.
    unchecked : tuple of str
        What in the bag is beyond every check.
    """

    state: DataState
    line: str
    unchecked: tuple[str, ...] = ()

    @property
    def stands(self) -> bool:
        """Whether the data are known to be those of a whole run of the scenario."""
        return self.state is DataState.INTACT

    @property
    def headline(self) -> str:
        """The state, for a headline."""
        return _HEADLINES[self.state]

    def to_json(self) -> dict[str, Any]:
        """Return what metrics.json and replay.json say of it."""
        return {
            "state": str(self.state),
            "stands": self.stands,
            "line": self.line,
            "unchecked": list(self.unchecked),
        }


def recompute(run: Trajectory, followers: Consistency | None = None) -> Recomputation:
    """Compare the leader, the links and, unless that is known, the followers of a run."""
    followers = followers or check_consistency(run)
    return Recomputation(check_leader(run), check_links(run), followers)


def standing_of(run: RecordedRun, recomputed: Recomputation | None = None) -> Standing:
    """Say how the data of a run stand: how it ended, its length and its digest decide.

    Without a digest every value that a number rests on is compared with what the scenario gives.

    Parameters
    ----------
    run : RecordedRun
        What the bag says.
    recomputed : Recomputation, optional
        Of the run; by default it is made where it is needed.
    """
    digested = bool(run.digest_recorded)
    short = run.grid.samples < run.scenario.samples and not run.trajectory.ends_in_collision
    found: list[tuple[DataState, str]] = [*_unfinished(run)]
    if run.altered_scenario:
        found.append((DataState.ALTERED, run.altered_scenario))
    if digested and run.digest != run.digest_recorded:
        what = "the messages do not have the digest that was written when the run ended"
        found.append((DataState.CUT if short else DataState.ALTERED, what))
    if short:
        what = f"{run.grid.samples} of {run.scenario.samples} samples are there"
        found.append((DataState.CUT, what))
    if not digested:
        found += _without_digest(run, recomputed or recompute(run.trajectory))
    beyond = tuple(_beyond_checks(run.scenario, digested))
    if found:
        return Standing(found[0][0], "; ".join(what for _, what in found), beyond)
    line = _BY_DIGEST if digested else _BY_SCENARIO
    if run.trajectory.ends_in_collision:
        line = line.replace("complete", "complete up to the collision that ended the run", 1)
    return Standing(DataState.INTACT, line, beyond)


def _unfinished(run: RecordedRun) -> Iterator[tuple[DataState, str]]:
    """Yield what run.json says of a run that did not end well."""
    if run.info is None or run.info.status is EndStatus.FINISHED:
        return
    failed = run.info.status is EndStatus.FAILED
    why = f": {run.info.message}" if run.info.message else ""
    yield (
        DataState.FAILED if failed else DataState.CUT,
        f"the run {'failed' if failed else 'was ' + run.info.status}{why}",
    )


def _without_digest(run: RecordedRun, again: Recomputation) -> Iterator[tuple[DataState, str]]:
    """Yield what keeps data without a digest from standing: lacks, departures, what is unknown."""
    none = "no digest was written"
    states = (run.trajectory.position, run.trajectory.velocity, run.trajectory.acceleration)
    if any(np.isnan(part).any() for part in (*states, run.trajectory.received)):
        yield DataState.CUT, f"{none}, and values are missing"
    elif run.faults:
        yield DataState.UNCHECKED, f"{none}, and the messages have faults"
    for what, one in zip(_SUBJECTS, again, strict=True):
        if one.departures:
            yield DataState.UNLIKE, f"{none}, and {departure(what, one)}: altered, or another one"
    if again.unknown:
        yield DataState.UNCHECKED, f"{none}, and nothing tells {', nor '.join(again.unknown)}"


def departure(what: str, found: Consistency) -> str:
    """Say where something first departs from what its scenario gives."""
    vehicle, time, difference = min(found.departures, key=lambda one: one[1])
    by = f"by {difference:.3g}" if math.isfinite(difference) else "in what arrives and when"
    return f"{what} departs from the scenario's first at vehicle {vehicle} at {time:g} s {by}"


def _beyond_checks(scenario: Scenario, digested: bool) -> Iterator[str]:
    """Yield what no check sees."""
    record = scenario.record
    shown = [name for name in ("command", "spacing_error") if getattr(record, name)]
    if any(follower.fallback_law() for follower in scenario.followers):
        shown.append("reception")
    if any(follower.monitored for follower in scenario.followers):
        shown.append("monitor")
    if shown:
        yield (
            f"{' and '.join(shown)}: recorded for viewers, in no digest, and no number here "
            "rests on them"
        )
    if not digested:
        yield f"without a digest, changes below {TOLERANCE:g} and fields that no number rests on"
