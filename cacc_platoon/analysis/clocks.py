"""How the samples of vehicles that keep time by clocks came: late ones, and with how old a pose."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from cacc_platoon.simulation import Trajectory
from cacc_platoon.simulation.trajectory import Array

BASIS = (
    "what is proven is of samples that all vehicles take together, or of a constant latency; no "
    "theorem covers ages that change"
)


class ClockUse(NamedTuple):
    """How the samples of one follower came.

    Attributes
    ----------
    follower : int
        Index.
    late_median, late_p99, late_max : float
        How long after they were due samples were taken [s].
    overruns : int
        Samples that came a control period late, or more, and kept the command before.
    unknown : int
        Samples of which nobody knows when they came.
    begin, end : float
        From when until when [s] there were such; NaN where there were none.
    age_median, age_p99, age_max : float
        How old the predecessor's pose was that was used [s].
    """

    follower: int
    late_median: float
    late_p99: float
    late_max: float
    overruns: int
    unknown: int
    begin: float
    end: float
    age_median: float
    age_p99: float
    age_max: float


class Distance(NamedTuple):
    """The largest distance of positions from those of another run.

    Attributes
    ----------
    largest : float
        That distance [m].
    vehicle : int
        Whose it is.
    time : float
        When it is so far [s].
    """

    largest: float
    vehicle: int
    time: float


def clock_use(run: Trajectory) -> list[ClockUse]:
    """Return how the samples of each follower came, from front to rear; empty in lockstep."""
    timing, step = run.timing, run.scenario.run.step
    if timing is None:
        return []
    found = []
    for column, index in enumerate(run.scenario.indices):
        late = timing.lateness[:, column] * run.scenario.run.clock_period
        late = late[np.isfinite(late)]
        over = np.flatnonzero(timing.overrun[:, column])
        begin, end = run.time[over[[0, -1]]].tolist() if over.size else (np.nan, np.nan)
        found.append(
            ClockUse(
                index,
                *_distribution(late),
                int(over.size),
                len(run.time) - int(late.size),
                begin,
                end,
                *_distribution(np.asarray(timing.age[:, column] * step, np.float64)),
            )
        )
    return found


def distance_from(run: Trajectory, other: Trajectory) -> Distance:
    """Return how far the vehicles of a run were at most from those of another one."""
    apart = np.abs(run.position - other.position)
    if not np.isfinite(apart).any():
        return Distance(np.nan, run.scenario.leader_index, np.nan)
    sample, column = np.unravel_index(int(np.nanargmax(apart)), apart.shape)
    return Distance(
        float(apart[sample, column]),
        run.scenario.leader_index + int(column),
        float(run.time[sample]),
    )


def clock_premises(used: Sequence[ClockUse]) -> Iterator[str]:
    """Say what of a run by clocks no theorem covers."""
    late = [one for one in used if one.overruns]
    if late:
        first, number = min(late, key=lambda one: one.begin), sum(one.overruns for one in late)
        yield (
            f"{number} sample{'s' * (number > 1)} of {len(late)} of {len(used)} vehicles came a "
            f"control period late, or more, the first of vehicle {first.follower} at "
            f"{first.begin:g} s, and kept the command before (run.sync = wall)"
        )
    if unknown := sum(one.unknown for one in used):
        yield f"of {unknown} samples nothing tells when they came (run.sync = wall)"
    old = [one for one in used if one.age_max]
    if old:
        worst = max(old, key=lambda one: one.age_max)
        yield (
            f"{len(old)} of {len(used)} vehicles used poses that were old, up to "
            f"{worst.age_max:g} s (vehicle {worst.follower}), since each keeps time by its own "
            f"clock: {BASIS}"
        )


def _distribution(values: Array) -> tuple[float, float, float]:
    """Return median, 99th percentile and maximum."""
    if not values.size:
        return np.nan, np.nan, np.nan
    return float(np.median(values)), float(np.quantile(values, 0.99)), float(np.max(values))
