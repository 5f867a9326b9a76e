"""What followers measure and can carry out, in arrays: sensors and limits of a whole platoon."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cacc_platoon.model import Limits, State
from cacc_platoon.model.limits import UNLIMITED, Limit, standing
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.simulation.timing import Timing
from cacc_platoon.simulation.trajectory import Array


class Sensors(NamedTuple):
    """What all followers of some runs measure of the vehicle ahead.

    Attributes
    ----------
    delay : ndarray of int64, shape (N,)
        Samples by which it is old.
    errors : ndarray, shape (2, samples, runs, N)
        Of range [m] and range rate [m/s].
    perfect : ndarray of bool, shape (N,)
        Who measures what is.
    """

    delay: NDArray[np.int64]
    errors: Array
    perfect: NDArray[np.bool_]

    @classmethod
    def of(cls, runs: Sequence[Scenario], *, noise: bool = True) -> Sensors | None:
        """Return the sensors of runs of one platoon, without noise if asked; None for perfect."""
        sensing = [[follower.sensing() for follower in run.followers] for run in runs]
        perfect = np.array([one.perfect for one in sensing[0]])
        if perfect.all():
            return None
        samples = runs[0].samples
        errors = np.zeros((2, samples, len(runs), len(perfect)))
        for number, run in enumerate(sensing if noise else []):
            for column, one in enumerate(run):
                errors[:, :, number, column] = [draw(0, samples) for draw in one.errors()]
        return cls(np.array([one.delay for one in sensing[0]]), errors, perfect)

    def ahead(self, sample: int, motion: Array) -> tuple[Array, Array]:
        """Return positions [m] and velocities [m/s] ahead as measured at a sample, (runs, N)."""
        then = np.maximum(sample - self.delay, 0)
        follower = np.arange(1, len(self.delay) + 1)
        position, velocity = (
            np.where(
                self.perfect,
                part[sample, :, :-1],
                part[sample, :, 1:]
                + ((part[then, :, follower - 1] - part[then, :, follower]).T + error[sample]),
            )
            for part, error in zip(motion[:2], self.errors, strict=True)
        )
        return position, velocity


def measured_ahead(
    scenario: Scenario, motion: Array, timing: Timing | None = None
) -> tuple[Array, Array]:
    """Return positions [m] and velocities [m/s] ahead as followers measured them, (samples, N).

    Parameters
    ----------
    scenario : Scenario
        The run.
    motion : ndarray, shape (3, samples, N + 1)
        Positions [m], velocities [m/s] and accelerations [m/s^2].
    timing : Timing, optional
        Of the samples, where vehicles keep time by clocks.
    """
    own, ahead = motion[:2, :, 1:], motion[:2, :, :-1]
    if timing:
        ahead = np.stack(timing.ahead(ahead[0], ahead[1], scenario.run.step))
    if sensors := Sensors.of([scenario]):
        then = np.maximum(np.arange(own.shape[1])[:, np.newaxis] - sensors.delay, 0)
        seen = np.take_along_axis(ahead - own, then[np.newaxis], axis=1)
        errors = sensors.errors[:, : own.shape[1], 0]
        ahead = np.where(sensors.perfect, ahead, own + (seen + errors))
    return ahead[0], ahead[1]


def measured_velocities(
    scenario: Scenario, motion: Array, timing: Timing | None = None
) -> list[tuple[Array, Array]]:
    """Return each follower's own velocity and that ahead as measured [m/s], each (samples,).

    Parameters as in `measured_ahead`.
    """
    _, ahead = measured_ahead(scenario, motion, timing)
    return list(zip(motion[1][:, 1:].T, ahead.T, strict=True))


class Actuators:
    """What all followers carry out of their commands, from the first sample on.

    Parameters
    ----------
    followers : sequence of Follower
        Whose they are.
    step : float
        Control period [s].
    """

    def __init__(self, followers: Sequence[Follower], step: float) -> None:
        limits = [follower.limits() for follower in followers]
        self._step, self._stops = step, np.array([one.stops for one in followers])
        self._limits: Limits | None = None
        if any(one is not None for one in limits):
            given = [one or UNLIMITED for one in limits]
            acceleration, deceleration, jerk = (
                Limit(*np.array([getattr(one, name) for one in given]).T)
                for name in ("acceleration", "deceleration", "jerk")
            )
            slow, fast = np.array([one.speeds for one in given]).T
            self._limits = Limits(acceleration, deceleration, jerk, (slow, fast))
        self._carried_out = np.zeros(len(followers))

    @property
    def limited(self) -> bool:
        """Whether anybody has limits."""
        return self._limits is not None

    def command(self, command: Array, velocity: Array) -> Array:
        """Return what is carried out of commands [m/s^2] at speeds [m/s]."""
        if self._limits is None:
            return command
        self._carried_out = self._limits.command(command, self._carried_out, velocity, self._step)
        return self._carried_out

    def standing(self, before: State[Array], after: State[Array]) -> State[Array]:
        """Return states of which none drives backwards that may not."""
        if not self._stops.any():
            return after
        stood = standing(before, after)
        return State(
            *(np.where(self._stops, new, old) for new, old in zip(stood, after, strict=True))
        )
