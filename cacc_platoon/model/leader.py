"""Leader profiles: position, velocity and acceleration as exact functions of time."""

from __future__ import annotations

import csv
import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from cacc_platoon.errors import UserError
from cacc_platoon.model.vehicle import State
from cacc_platoon.texts import TextError, read_text

MAX_ROWS = 40_000
"""Of a table of speeds; more would make a scenario that nobody can read."""


class LeaderProfile(Protocol):
    """The motion of vehicle 0; replace it to study another disturbance."""

    def at(self, time: float) -> State[float]:
        """Return the leader's state at `time` [s] >= 0."""
        ...


class SinePulse:
    """The paper's disturbance: one full sine of acceleration, a_0 = A sin(Omega (t - start)).

    The leader gains 2 A / Omega of speed, gives it back, and ends 2 pi A / Omega^2 further on.

    Parameters
    ----------
    velocity : float
        Speed before and after [m/s].
    amplitude : float
        A [m/s^2].
    angular_frequency : float
        Omega [rad/s].
    start : float
        Time at which the pulse begins [s].
    """

    def __init__(
        self, velocity: float, amplitude: float, angular_frequency: float, start: float
    ) -> None:
        self._velocity, self._amplitude = velocity, amplitude
        self._omega, self._start = angular_frequency, start

    def at(self, time: float) -> State[float]:
        """Return the leader's state at `time` [s]."""
        omega = self._omega
        speed_gain = self._amplitude / omega
        elapsed = min(max(time - self._start, 0.0), 2.0 * math.pi / omega)
        if elapsed in (0.0, 2.0 * math.pi / omega):
            travel = speed_gain * elapsed
            return State(self._velocity * time + travel, self._velocity, 0.0)
        phase = omega * elapsed
        return State(
            self._velocity * time + speed_gain * (elapsed - math.sin(phase) / omega),
            self._velocity + speed_gain * (1.0 - math.cos(phase)),
            self._amplitude * math.sin(phase),
        )

    def acceleration_range(self, begin: float, end: float) -> tuple[float, float]:
        """Return the least and the largest acceleration [m/s^2] from `begin` to `end` [s].

        Examples
        --------
        >>> SinePulse(25.0, 0.5, 1.0, start=0.0).acceleration_range(0.0, 5.0)
        (-0.5, 0.5)
        """
        turns = [self._start + quarters * math.pi / self._omega for quarters in (0.5, 1.5)]
        times = (begin, *(turn for turn in turns if begin < turn < end), end)
        found = [self.at(time).acceleration for time in times]
        return min(found), max(found)


class PiecewiseConstantAcceleration:
    """Constant acceleration between given times, constant speed before the first.

    Parameters
    ----------
    velocity : float
        Speed at time 0 [m/s].
    times : sequence of float
        Increasing times >= 0 [s] at which the acceleration changes.
    accelerations : sequence of float, as long as `times`
        Acceleration [m/s^2] from each of these times on.

    Examples
    --------
    >>> brake = PiecewiseConstantAcceleration(25.0, [10.0, 15.0], [-5.0, 0.0])
    >>> brake.at(20.0)
    State(position=312.5, velocity=0.0, acceleration=0.0)
    """

    def __init__(
        self, velocity: float, times: Sequence[float], accelerations: Sequence[float]
    ) -> None:
        self._times = [0.0, *times]
        self._accelerations = [0.0, *accelerations]
        self._knots = [State(0.0, velocity, 0.0)]
        for index, end in enumerate(self._times[1:]):
            self._knots.append(self._advance(index, end))

    def at(self, time: float) -> State[float]:
        """Return the leader's state at `time` [s] >= 0."""
        return self._advance(bisect_right(self._times, time) - 1, time)

    def acceleration_range(self, begin: float, end: float) -> tuple[float, float]:
        """Return the least and the largest one [m/s^2] from `begin` until just before `end` [s].

        Examples
        --------
        >>> brake = PiecewiseConstantAcceleration(25.0, [0.2, 0.4], [-5.0, 0.0])
        >>> brake.acceleration_range(0, 1)
        (-5.0, 0.0)
        """
        first = bisect_right(self._times, begin) - 1
        found = self._accelerations[first : max(bisect_left(self._times, end), first + 1)]
        return min(found), max(found)

    def _advance(self, index: int, time: float) -> State[float]:
        position, velocity, _ = self._knots[index]
        acceleration = self._accelerations[index]
        elapsed = time - self._times[index]
        return State(
            position + (velocity + 0.5 * acceleration * elapsed) * elapsed,
            velocity + acceleration * elapsed,
            acceleration,
        )


class RecordedMotion:
    """What a vehicle did in an earlier run, sample by sample: given back, never integrated again.

    Parameters
    ----------
    step : float
        Control period T of the recording [s].
    position, velocity, acceleration : ndarray, shape (samples,)
        Recorded states [m], [m/s], [m/s^2] at t = k T.

    Examples
    --------
    >>> motion = RecordedMotion(0.01, np.zeros(2), np.array([25.0, 25.1]), np.array([0.0, 1.0]))
    >>> motion.at(0.01)
    State(position=0.0, velocity=25.1, acceleration=1.0)
    """

    def __init__(
        self,
        step: float,
        position: npt.NDArray[np.float64],
        velocity: npt.NDArray[np.float64],
        acceleration: npt.NDArray[np.float64],
    ) -> None:
        self._step = step
        self._columns = (position, velocity, acceleration)

    def at(self, time: float) -> State[float]:
        """Return the recorded state at `time` = k T [s]."""
        k = round(time / self._step)
        position, velocity, acceleration = (float(column[k]) for column in self._columns)
        return State(position, velocity, acceleration)


def step_profile(
    velocity: float, acceleration: float, start: float, hold: float
) -> PiecewiseConstantAcceleration:
    """Return a step of `acceleration` [m/s^2] from `start` [s] for `hold` [s]."""
    return PiecewiseConstantAcceleration(velocity, [start, start + hold], [acceleration, 0.0])


def brake_profile(
    velocity: float, deceleration: float, start: float, final_velocity: float
) -> PiecewiseConstantAcceleration:
    """Return braking at `deceleration` [m/s^2] from `start` [s] down to `final_velocity` [m/s]."""
    hold = (velocity - final_velocity) / deceleration
    return step_profile(velocity, -deceleration, start, hold)


def speed_profile(times: Sequence[float], speeds: Sequence[float]) -> PiecewiseConstantAcceleration:
    """Return the motion whose speed is linear between `times` [s] and constant after the last."""
    slopes = [
        (speeds[i + 1] - speeds[i]) / (times[i + 1] - times[i]) for i in range(len(times) - 1)
    ]
    return PiecewiseConstantAcceleration(speeds[0], times, [*slopes, 0.0])


def read_speed_profile(path: Path) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Read times [s] and speeds [m/s] from a CSV file, with or without a heading.

    Raises
    ------
    UserError
        When the file has no such table; the line names the row and the rule.
    """
    try:
        lines = csv.reader(read_text(path).splitlines())
        rows = [row for row in lines if row and not row[0].lstrip().startswith("#")]
    except (TextError, csv.Error) as error:
        raise UserError(f"{path}: cannot be read: {error}. Give a CSV file.") from error
    if len(rows) > MAX_ROWS:
        raise UserError(
            f"{path}: has {len(rows)} rows, more than the {MAX_ROWS} that a scenario can hold. "
            "Thin them out: the speed is linear between two rows."
        )
    table: list[tuple[float, float]] = []
    for number, row in enumerate(rows, start=1):
        try:
            time, speed = (float(cell) for cell in row)
        except ValueError:
            if number == 1:
                continue
            raise _bad_row(path, number, row, "is not a time [s] and a speed [m/s]") from None
        if not (math.isfinite(time) and math.isfinite(speed)):
            raise _bad_row(path, number, row, "is not finite")
        if table and time <= table[-1][0]:
            raise _bad_row(path, number, row, f"does not come after time {table[-1][0]:g} s")
        table.append((time, speed))
    if len(table) < 2 or table[0][0] != 0.0:
        raise UserError(
            f"{path}: a speed profile needs two rows or more, the first at time 0 s. "
            "Give columns time [s], speed [m/s]."
        )
    times, speeds = zip(*table, strict=True)
    return times, speeds


def _bad_row(path: Path, number: int, row: list[str], why: str) -> UserError:
    return UserError(f"{path}: row {number} ({','.join(row)}) {why}. Correct the row.")


_Known = SinePulse | PiecewiseConstantAcceleration


def largest_acceleration(profile: LeaderProfile, end: float) -> float:
    """Return the largest absolute acceleration [m/s^2] until `end` [s]; 0 of one that says none.

    Examples
    --------
    >>> largest_acceleration(brake_profile(25.0, 5.0, 0.123, 24.99), end=10.0)
    5.0
    """
    if not isinstance(profile, _Known):
        return 0.0
    least, most = profile.acceleration_range(0.0, end)
    return max(-least, most)


def least_accelerations(
    profile: LeaderProfile, step: float, samples: int
) -> npt.NDArray[np.float64]:
    """Return the least acceleration from each sample to the next [m/s^2], shape (samples - 1,).

    Of a motion that does not say, the lesser of the two: under a held command it is.
    """
    times = [k * step for k in range(samples)]
    if isinstance(profile, _Known):
        return np.array([profile.acceleration_range(*pair)[0] for pair in pairwise(times)])
    found = np.array([profile.at(time).acceleration for time in times])
    return np.asarray(np.minimum(found[1:], found[:-1]), np.float64)


def sample_profile(profile: LeaderProfile, step: float, samples: int) -> npt.NDArray[np.float64]:
    """Return position, velocity and acceleration at k T, shape (3, samples)."""
    return np.array([profile.at(k * step) for k in range(samples)]).T
