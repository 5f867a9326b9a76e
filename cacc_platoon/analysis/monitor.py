"""What monitors said in a run, beside the false data that its scenario has."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cacc_platoon.scenario import Follower
from cacc_platoon.simulation import Trajectory
from cacc_platoon.simulation.monitoring import alarms

NO_ALARM = (
    "An alarm says that no w within rho and jerk within v2v.monitor_jerk explains both the packets "
    "and the measured motion of the vehicle ahead. That there is none proves nothing: false data "
    "within rho, or while the vehicle ahead hardly accelerates, cause none."
)


class Detection(NamedTuple):
    """False data on the link to a follower, and when its monitor noticed.

    Attributes
    ----------
    begin, end : float
        From when until when packets are false [s].
    delay : float
        From `begin` to the first alarm [s]; NaN where there was none in time.
    """

    begin: float
    end: float
    delay: float


class MonitorUse(NamedTuple):
    """What the monitor of a follower said.

    Attributes
    ----------
    follower : int
        Index.
    share : float
        Of time with an alarm.
    begin, end : float
        From when until when [s] there were alarms; NaN when there were none.
    alarms : int
        How often one began.
    false_alarms : int
        How many of them began neither while packets were false nor within the window after.
    detections : tuple of Detection
        The false data of its link, in order.
    spans : tuple of (float, float)
        Begin and end of each alarm [s].
    """

    follower: int
    share: float
    begin: float
    end: float
    alarms: int
    false_alarms: int
    detections: tuple[Detection, ...]
    spans: tuple[tuple[float, float], ...]


def monitor_use(run: Trajectory) -> list[MonitorUse]:
    """Return what each monitor of a run said, from front to rear.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> from cacc_platoon.simulation import simulate
    >>> tripled = {"v2v.monitor": "report", "v2v.false_data": ("15 20 factor=3",)}
    >>> run = simulate(Scenario.from_values({**tripled, "run.duration": 30.0}))
    >>> used = monitor_use(run)[0]
    >>> used.begin, used.end, used.alarms, used.false_alarms, used.detections
    (15.01, 21.69, 1, 0, (Detection(begin=15.0, end=20.0, delay=0.01),))
    """
    followers = run.scenario.followers
    found = alarms(run)
    return [_use(one, found[one.index], run) for one in followers if one.index in found]


def _use(follower: Follower, alarm: npt.NDArray[np.bool_], run: Trajectory) -> MonitorUse:
    step, late = run.scenario.run.step, follower.longest_latency_steps
    turns = np.flatnonzero(np.diff(alarm, prepend=False, append=False))
    begins, ends = turns[::2], turns[1::2]
    until = late + round(follower.v2v.monitor_window / step) + follower.sensing().delay
    due = np.zeros(len(begins), np.bool_)
    detections = []
    for one in follower.forgeries:
        if one.begin >= len(alarm):
            continue
        inside = (ends > one.begin) & (begins < one.end + until)
        due |= inside & (begins >= one.begin)
        first = np.maximum(begins[inside], one.begin)
        delay = _seconds(first[0] - one.begin, step) if first.size else np.nan
        detections.append(Detection(_seconds(one.begin, step), _seconds(one.end, step), delay))
    spans = tuple((_seconds(b, step), _seconds(e, step)) for b, e in zip(begins, ends, strict=True))
    return MonitorUse(
        follower.index,
        float(alarm.mean()),
        float(run.time[begins[0]]) if begins.size else np.nan,
        float(run.time[ends[-1] - 1]) if begins.size else np.nan,
        len(begins),
        int((~due).sum()),
        tuple(detections),
        spans,
    )


def _seconds(samples: float, step: float) -> float:
    """Return the time of so many samples, without the rounding of a product."""
    return round(float(samples) * step, 9)


def monitor_line(used: MonitorUse) -> str:
    """Say what a monitor said, for a sentence.

    Examples
    --------
    >>> found = (Detection(15.0, 20.0, 0.25), Detection(40.0, 41.0, float("nan")))
    >>> print(monitor_line(MonitorUse(2, 0.1, 15.25, 21.0, 3, 1, found, ())))
    vehicle 2: 3 alarms between 15.25 and 21 s, 1 of them false; false data from 15 s on noticed \
after 0.25 s; false data from 40 s on not noticed
    """
    parts = []
    if used.alarms:
        count = "1 alarm" if used.alarms == 1 else f"{used.alarms} alarms"
        parts.append(f"{count} between {used.begin:g} and {used.end:g} s")
        if used.detections and used.false_alarms:
            parts[-1] += f", {used.false_alarms} of them false"
    else:
        parts.append("no alarm")
    for one in used.detections:
        noticed = "not noticed" if np.isnan(one.delay) else f"noticed after {one.delay:g} s"
        parts.append(f"false data from {one.begin:g} s on {noticed}")
    return f"vehicle {used.follower}: {'; '.join(parts)}"
