"""What a platoon did: the record that simulations make and bags are read into."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from cacc_platoon.model import Delivery, Reception
from cacc_platoon.model.reception import picked
from cacc_platoon.scenario import Scenario

Array: TypeAlias = npt.NDArray[np.float64]


class Arrivals(NamedTuple):
    """What one follower received over V2V, in the order of delivery; arrays of one length.

    Attributes
    ----------
    source, sample : ndarray of int64
        Sample it was sent at, and the one it was delivered at.
    value : ndarray
        Received acceleration [m/s^2].
    """

    source: npt.NDArray[np.int64]
    sample: npt.NDArray[np.int64]
    value: Array

    def used(self, reception: Reception, samples: int) -> Array:
        """Return the acceleration [m/s^2] that the receiver uses at each sample, (samples,)."""
        chosen = reception.chosen(Delivery(*self), samples)
        return picked(self.value, chosen, 0.0)


@dataclass(frozen=True)
class Trajectory:
    """Positions, velocities, accelerations and received accelerations of one run.

    Attributes
    ----------
    scenario : Scenario
        What was run.
    position, velocity, acceleration : ndarray, shape (samples, N + 1)
        x_i [m], v_i [m/s] and a_i [m/s^2] at t = k T; column 0 is the leader, the others are
        those of `scenario.indices`.
    received : ndarray, shape (samples, L)
        Acceleration [m/s^2] that was used of every link of the topology, in its order: w a_{i-1}
        where every packet arrives. With one predecessor column 0 is the first follower's.
    arrivals : tuple of Arrivals or None
        What arrived over each link, where packets may be lost or late; None where every sample's
        packet arrives at that sample.
    """

    scenario: Scenario
    position: Array
    velocity: Array
    acceleration: Array
    received: Array
    arrivals: tuple[Arrivals, ...] | None = None

    @cached_property
    def arrived(self) -> Array:
        """Received accelerations by the sample they were sent at, NaN where lost, (samples, L)."""
        if self.arrivals is None:
            return self.received
        arrived = np.full(self.received.shape, np.nan)
        for column, (source, _, value) in enumerate(self.arrivals):
            arrived[source, column] = value
        return arrived

    @property
    def sent(self) -> Array:
        """Acceleration [m/s^2] of the sender of each link, (samples, L)."""
        return self.acceleration[:, self.scenario.topology.senders]

    @cached_property
    def time(self) -> Array:
        """Sample times k T [s], shape (samples,)."""
        return np.asarray(np.arange(len(self.position)) * self.scenario.run.step, np.float64)

    @cached_property
    def spacing_error(self) -> Array:
        """delta_i [m] of followers 1..N, shape (samples, N); positive means too close."""
        columns = [
            follower.spacing_policy().spacing_error(
                self.position[:, column],
                self.velocity[:, column],
                self.position[:, column - 1],
            )
            for column, follower in enumerate(self.scenario.followers, start=1)
        ]
        return np.stack(columns, axis=1)

    @cached_property
    def spacing(self) -> Array:
        """x_{i-1} - x_i [m] of followers 1..N, shape (samples, N)."""
        return self.position[:, :-1] - self.position[:, 1:]

    @cached_property
    def gap(self) -> Array:
        """`spacing` less the length of the vehicle ahead [m], shape (samples, N)."""
        return np.asarray(self.spacing - np.array(self.scenario.lengths[:-1]), dtype=np.float64)

    @cached_property
    def platoon_length(self) -> Array:
        """x_0 - x_N [m], shape (samples,)."""
        return self.position[:, 0] - self.position[:, -1]
