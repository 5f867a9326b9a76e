"""What a vehicle measures of the one ahead: range and range rate, late and with noise."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cacc_platoon.model.keyed_random import RANGE, RANGE_RATE, keyed_normal

Noise = Callable[[int, int], npt.NDArray[np.float64]]


class Sensing(NamedTuple):
    """A sensor that looks ahead.

    Attributes
    ----------
    delay : int
        Samples by which what it measures is old.
    range_std, range_rate_std : float
        Standard deviations of the noise of range [m] and range rate [m/s].
    seed : int
        Seed of the run.
    vehicle : int
        Index of its vehicle; vehicles are independent of each other.
    """

    delay: int
    range_std: float
    range_rate_std: float
    seed: int
    vehicle: int

    @property
    def perfect(self) -> bool:
        """Whether it measures what is, at once."""
        return not (self.delay or self.range_std or self.range_rate_std)

    def errors(self) -> tuple[Noise, Noise]:
        """Return the errors of range [m] and range rate [m/s] at the samples start..stop-1."""
        return (
            _scaled(self.range_std, keyed_normal(self.seed, self.vehicle, RANGE)),
            _scaled(self.range_rate_std, keyed_normal(self.seed, self.vehicle, RANGE_RATE)),
        )


def _scaled(std: float, draw: Noise) -> Noise:
    if not std:
        return lambda start, stop: np.zeros(stop - start)
    return lambda start, stop: std * draw(start, stop)


class Sensor:
    """A sensor from its first sample on.

    Parameters
    ----------
    sensing : Sensing
        What it is like.

    Examples
    --------
    >>> sensor = Sensor(Sensing(1, 0.0, 0.0, seed=1, vehicle=1))
    >>> [sensor.ahead((-30.0 + k, 1.0), (0.0, 0.0)) for k in range(3)]
    [(0.0, 0.0), (1.0, 0.0), (1.0, 0.0)]
    """

    def __init__(self, sensing: Sensing) -> None:
        self._errors = sensing.errors()
        self._past: deque[tuple[float, float]] = deque(maxlen=sensing.delay + 1)
        self._sample = 0

    def ahead(self, own: tuple[float, float], ahead: tuple[float, float]) -> tuple[float, float]:
        """Return position [m] and velocity [m/s] of the vehicle ahead, as measured at a sample.

        Parameters
        ----------
        own, ahead : tuple of float
            True position and velocity of the vehicle and of the one ahead.
        """
        k = self._sample
        self._sample = k + 1
        self._past.append((ahead[0] - own[0], ahead[1] - own[1]))
        seen = (
            past + float(error(k, k + 1)[0])
            for past, error in zip(self._past[0], self._errors, strict=True)
        )
        position, velocity = (mine + other for mine, other in zip(own, seen, strict=True))
        return position, velocity
