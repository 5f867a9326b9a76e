"""Longitudinal vehicle dynamics with an actuation lag (paper, section II)."""

from __future__ import annotations

import math
from typing import Generic, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

Value = TypeVar("Value", float, npt.NDArray[np.float64])


class State(NamedTuple, Generic[Value]):
    """Position [m], velocity [m/s] and acceleration [m/s^2] along the road; floats or arrays."""

    position: Value
    velocity: Value
    acceleration: Value


class ThirdOrderPlant:
    """x'' = a, tau a' + a = u, with u held over one step and integrated exactly.

    With E = exp(-T/tau) and r = a - u the zero-order-hold solution is a+ = u + E r,
    v+ = v + T u + tau (1 - E) r and x+ = x + T v + T^2/2 u + tau (T - tau (1 - E)) r.

    Parameters
    ----------
    tau : float or sequence of float
        Actuation lag [s], one value or one per vehicle.
    step : float
        Control period T [s].

    Examples
    --------
    >>> plant = ThirdOrderPlant(tau=0.5, step=0.01)
    >>> plant.advance(State(0.0, 25.0, 0.0), 0.0)
    State(position=0.25, velocity=25.0, acceleration=0.0)
    """

    def __init__(self, tau: float | npt.ArrayLike, step: float) -> None:
        self.step = step
        self._half_step_squared = 0.5 * step * step
        if isinstance(tau, float):
            self._decay, self._velocity_lag, self._position_lag = _lag_coefficients(tau, step)
        else:
            columns = np.array([_lag_coefficients(float(t), step) for t in np.asarray(tau)]).T
            self._decay, self._velocity_lag, self._position_lag = columns

    def advance(self, state: State[Value], command: Value) -> State[Value]:
        """Return the state one step later under the constant `command` [m/s^2]."""
        position, velocity, acceleration = state
        step = self.step
        residual = acceleration - command
        return State(
            position
            + step * velocity
            + self._half_step_squared * command
            + self._position_lag * residual,
            velocity + step * command + self._velocity_lag * residual,
            command + self._decay * residual,
        )


def _lag_coefficients(tau: float, step: float) -> tuple[float, float, float]:
    """Return E, tau (1 - E) and tau (T - tau (1 - E)); scalar `math` so that every user agrees."""
    shortfall = -math.expm1(-step / tau)
    velocity_lag = tau * shortfall
    return math.exp(-step / tau), velocity_lag, tau * (step - velocity_lag)
