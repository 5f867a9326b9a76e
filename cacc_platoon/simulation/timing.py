"""When vehicles that keep time by clocks took their samples, and what they then knew."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cacc_platoon.model.packets import Floats


class Timing(NamedTuple):
    """The timing of the samples of all followers, shape (samples, N).

    Attributes
    ----------
    age : ndarray of int64
        How many samples old the predecessor's pose was that was used.
    lateness : ndarray
        How long after it was due a sample was taken [control periods]; NaN where that is unknown.
    """

    age: NDArray[np.int64]
    lateness: Floats

    @classmethod
    def perfect(cls, samples: int, followers: int) -> Timing:
        """Return the timing of clocks that agree and computers that are never late."""
        shape = samples, followers
        return cls(np.zeros(shape, np.int64), np.zeros(shape))

    @property
    def overrun(self) -> NDArray[np.bool_]:
        """Whether a sample came a control period late, or more, and kept the command before."""
        with np.errstate(invalid="ignore"):
            late: NDArray[np.bool_] = self.lateness >= 1.0
        return late

    def ahead(self, position: Floats, velocity: Floats, step: float) -> tuple[Floats, Floats]:
        """Return the predecessors' positions and velocities as they were used, (samples, N).

        Parameters
        ----------
        position, velocity : ndarray, shape (samples, N)
            Of the predecessors [m, m/s].
        step : float
            Control period [s].
        """
        then = np.arange(len(position))[:, np.newaxis] - self.age
        seen_velocity = np.take_along_axis(velocity, then, 0)
        seen_position = np.take_along_axis(position, then, 0)
        return seen_position + seen_velocity * (self.age * step), seen_velocity

    def carried(self, command: Floats) -> Floats:
        """Return commands with those before in place of what a late sample would have been."""
        sample = np.where(self.overrun, 0, np.arange(len(command))[:, np.newaxis] + 1)
        evaluated = np.maximum.accumulate(sample, axis=0)
        first = np.zeros((1, command.shape[1]))  # before the first one there is none
        return np.take_along_axis(np.concatenate([first, command]), evaluated, 0)
