"""Where the limits of actuators acted in a run, and what else of a vehicle no theorem knows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import Trajectory
from cacc_platoon.simulation.course import limits_act

_SENSORS = {"delay": "s", "range_std": "m", "range_rate_std": "m/s"}


class LimitUse(NamedTuple):
    """How the limits of a follower's actuator acted.

    Attributes
    ----------
    follower : int
        Index.
    share : float
        Share of time in which it could not carry out its command, or stood.
    begin, end : float
        From when until when [s] that was so; NaN when it never was.
    """

    follower: int
    share: float
    begin: float
    end: float


def limit_use(run: Trajectory) -> list[LimitUse]:
    """Return how the limits of each follower that has some acted, from front to rear.

    Commands of custom laws are not known, nor is what limits made of them.

    Examples
    --------
    >>> from cacc_platoon.simulation import simulate
    >>> weak = {"vehicle.limits": "constant", "vehicle.max_jerk": 0.1, "run.duration": 30.0}
    >>> round(limit_use(simulate(Scenario.from_values(weak)))[0].begin, 2)
    10.2
    """
    followers = run.scenario.followers
    limited = np.array([bool(one.limits()) and not one.law_name for one in followers])
    stops = np.array([one.stops for one in followers])
    if not (limited.any() or stops.any()):
        return []
    acts = limits_act(run)
    found = []
    for column, follower in enumerate(followers):
        if not (limited[column] or stops[column]):
            continue
        samples = np.flatnonzero(acts[:, column])
        begin, end = (run.time[samples[[0, -1]]]).tolist() if samples.size else (np.nan,) * 2
        found.append(LimitUse(follower.index, float(acts[:, column].mean()), begin, end))
    return found


def limit_premises(scenario: Scenario, used: Sequence[LimitUse]) -> Iterator[str]:
    """Say when limits acted, and that sensors are not those of a theorem."""
    acted = [one for one in used if one.share]
    if acted:
        begin, end = min(one.begin for one in acted), max(one.end for one in acted)
        yield (
            f"limits of actuators acted on {len(acted)} of {len(scenario.followers)} vehicles "
            f"between {begin:g} and {end:g} s (vehicle.limits, vehicle.stops): what is proven is "
            "of a linear vehicle"
        )
    given = {
        name: max(getattr(one.sensors, name) for one in scenario.followers) for name in _SENSORS
    }
    if any(given.values()):
        named = ", ".join(
            f"sensing.{name} up to {value:g} {_SENSORS[name]}"
            for name, value in given.items()
            if value
        )
        yield (
            f"range and range rate are not measured as they are ({named}): what is proven is of "
            "sensors that measure what is, at once"
            + ("; the expectation run is late too, and without noise" * bool(given["delay"]))
        )
