"""What an actuator can do: limits of acceleration, deceleration and jerk, and standing still."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from cacc_platoon.model.vehicle import State, ThirdOrderPlant, Value

Numbers: TypeAlias = float | npt.NDArray[np.float64]


class Limit(NamedTuple):
    """A limit that changes with speed, linearly between two speeds.

    Attributes
    ----------
    slow, fast : float or ndarray
        At the lower and at the higher speed of `Limits`, and beyond.
    """

    slow: Numbers
    fast: Numbers

    @property
    def rise(self) -> Numbers:
        """How much more it is at the higher speed; 0 where it is infinite at both."""
        with np.errstate(invalid="ignore"):
            return np.where(self.slow == self.fast, 0.0, np.subtract(self.fast, self.slow))


class Limits(NamedTuple):
    """Limits of the command: infinite where there is none.

    Attributes
    ----------
    acceleration, deceleration : Limit
        Largest command, and largest negative one [m/s^2].
    jerk : Limit
        Largest change of the command per second [m/s^3].
    speeds : tuple of float
        Speeds between which they change [m/s].

    Examples
    --------
    >>> ISO_15622.command(-9.0, previous=-3.4, velocity=30.0, step=0.01)
    -3.425
    >>> ISO_15622.command(-9.0, previous=-3.49, velocity=30.0, step=0.01)
    -3.5
    """

    acceleration: Limit
    deceleration: Limit
    jerk: Limit
    speeds: tuple[Numbers, Numbers] = (5.0, 20.0)

    def command(self, command: Value, previous: Value, velocity: Value, step: float) -> Value:
        """Return the command [m/s^2] that an actuator carries out, of what is commanded.

        Parameters
        ----------
        command, previous : float or ndarray
            What is commanded, and what was carried out a step before [m/s^2].
        velocity : float or ndarray
            Speed [m/s].
        step : float
            Control period [s].
        """
        slow, fast = self.speeds
        share = np.clip((velocity - slow) / (fast - slow), 0.0, 1.0)
        most, least, jerk = (
            one.slow + share * one.rise for one in (self.acceleration, self.deceleration, self.jerk)
        )
        nearer = np.clip(command, previous - jerk * step, previous + jerk * step)
        limited = np.clip(nearer, -least, most)
        return limited if isinstance(command, np.ndarray) else float(limited)


UNLIMITED = Limits(*(Limit(np.inf, np.inf),) * 3)

ISO_15622 = Limits(Limit(4.0, 2.0), Limit(5.0, 3.5), Limit(5.0, 2.5))
"""Those of adaptive cruise control in ISO 15622:2018, as secondary sources give them."""


def standing(before: State[Value], after: State[Value]) -> State[Value]:
    """Return a state without driving backwards: who would, stands.

    Examples
    --------
    >>> standing(State(7.0, 0.01, -2.0), State(6.99, -0.01, -2.0))
    State(position=7.0, velocity=0.0, acceleration=0.0)
    """
    backwards = after.velocity < 0.0
    if isinstance(backwards, np.ndarray):
        return State(
            np.where(backwards, np.maximum(before.position, after.position), after.position),
            np.where(backwards, 0.0, after.velocity),
            np.where(backwards, 0.0, after.acceleration),
        )
    if not backwards:
        return after
    return State(max(before.position, after.position), 0.0, 0.0)


class Body:
    """A plant that does not all that is commanded, from its first sample on.

    Parameters
    ----------
    plant : ThirdOrderPlant
        The plant.
    limits : Limits or None
        What its actuator can do; None for anything.
    stops : bool
        Whether it stands where it would drive backwards.
    """

    def __init__(self, plant: ThirdOrderPlant, limits: Limits | None, stops: bool) -> None:
        self._plant, self._limits, self._stops = plant, limits, stops
        self._carried_out = 0.0

    def command(self, command: float, velocity: float) -> float:
        """Return the command [m/s^2] that is carried out at the next sample, at this speed."""
        if self._limits:
            command = self._limits.command(command, self._carried_out, velocity, self._plant.step)
            self._carried_out = command
        return command

    def advance(self, state: State[float], command: float) -> State[float]:
        """Return the state one sample later."""
        after = self._plant.advance(state, command)
        return standing(state, after) if self._stops else after
