"""The constant time headway control law (paper, section III-B)."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from cacc_platoon.model.vehicle import Value


class Gains(NamedTuple):
    """What the designer chooses for one follower.

    Attributes
    ----------
    time_headway : float
        Time headway h_w [s].
    k_a : float
        Gain on the predecessor's communicated acceleration [-].
    k_v : float
        Gain on the velocity error [1/s].
    k_p : float
        Gain on the spacing error [1/s^2].
    """

    time_headway: float
    k_a: float
    k_v: float
    k_p: float


class ControlLaw(Protocol):
    """What a follower computes once per sample; replace it to test a controller of your own.

    Where a follower receives from several vehicles ahead, `command` is called with one received
    acceleration of each, the nearest first, and vehicles near the leader with fewer: such a law
    takes `*received_accelerations`.
    """

    def command(
        self,
        position: float,
        velocity: float,
        predecessor_position: float,
        predecessor_velocity: float,
        received_acceleration: float,
    ) -> float:
        """Return the commanded acceleration u_i [m/s^2], held until the next sample."""
        ...


class ConstantTimeHeadway:
    """u_i = k_a w a_{i-1} - k_v (v_i - v_{i-1}) - k_p delta_i.

    Floats and arrays go through the same operations in the same order, so a node and the array
    simulation agree to the last bit.

    Parameters
    ----------
    gains : Gains
        Gains, each a float or an array over followers.
    standstill_distance : float
        d [m], from front bumper to front bumper at rest.

    Examples
    --------
    >>> law = ConstantTimeHeadway(Gains(0.95, 0.5, 0.63, 0.009), standstill_distance=5.0)
    >>> law.spacing_error(position=-28.75, velocity=25.0, predecessor_position=0.0)
    0.0
    """

    def __init__(self, gains: Gains, standstill_distance: float) -> None:
        self.gains = gains
        self.standstill_distance = standstill_distance
        self._headway, self._k_a, self._k_v, self._k_p = gains

    def with_headway(self, time_headway: Value) -> ConstantTimeHeadway:
        """Return the law with another time headway [s], a float or an array."""
        gains = self.gains._replace(time_headway=time_headway)  # type: ignore[arg-type]
        return ConstantTimeHeadway(gains, self.standstill_distance)

    def spacing_error(self, position: Value, velocity: Value, predecessor_position: Value) -> Value:
        """Return delta_i = x_i - x_{i-1} + d + h_w v_i [m]; positive means too close."""
        gap_error = position - predecessor_position + self.standstill_distance
        return gap_error + self._headway * velocity

    def command(
        self,
        position: Value,
        velocity: Value,
        predecessor_position: Value,
        predecessor_velocity: Value,
        received_acceleration: Value,
    ) -> Value:
        """Return u_i [m/s^2] from the own state, the measured predecessor and w a_{i-1}."""
        delta = self.spacing_error(position, velocity, predecessor_position)
        feedforward = self._k_a * received_acceleration
        return feedforward - self._k_v * (velocity - predecessor_velocity) - self._k_p * delta
