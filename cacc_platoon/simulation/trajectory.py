"""What a platoon did: the record that simulations make and bags are read into."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from cacc_platoon.model import (
    ChoosingReception,
    ConstantTimeHeadway,
    Delivery,
    Gains,
    MonitoredReception,
    Reception,
)
from cacc_platoon.model.reception import picked
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.simulation.timing import Timing

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

    def of_bag(self, receiver: Follower, measured: tuple[Array, Array]) -> ReceptionHistory:
        """Return what a receiver makes of it; NaN where only code knows that a bag names.

        Parameters
        ----------
        receiver : Follower
            Whose packets they are.
        measured : tuple of ndarray, shape (samples,)
            Its velocity and that of the vehicle ahead, as it measures it [m/s].
        """
        samples = len(measured[0])
        if receiver.v2v.receiver:
            known = self.history(receiver.watching_reception(), samples, measured)
            return ReceptionHistory(np.full(samples, np.nan), None, None, known.alarm)
        return self.history(receiver.reception(), samples, measured)

    def history(
        self, reception: Reception, samples: int, measured: tuple[Array, Array] | None = None
    ) -> ReceptionHistory:
        """Return what the receiver makes of it at each sample; see `of_bag`."""
        if isinstance(reception, ChoosingReception):
            chosen = reception.chosen(Delivery(*self), samples)
            return ReceptionHistory(picked(self.value, chosen, 0.0), None, None)
        used, share = np.empty(samples), np.ones(samples)
        state, alarm = np.zeros(samples, np.int64), np.zeros(samples, np.bool_)
        watched = reception if isinstance(reception, MonitoredReception) and measured else None
        seen = list(zip(*(part.tolist() for part in measured or ()), strict=True))
        ends = np.searchsorted(self.sample, np.arange(samples + 1)).tolist()
        packets = list(zip(self.source.tolist(), self.value.tolist(), strict=True))
        for k, (begin, end) in enumerate(pairwise(ends)):
            if watched:
                watched.measure(*seen[k])
            used[k] = reception.use(packets[begin:end])
            alarm[k] = watched is not None and watched.monitor.alarm
            share[k] = getattr(reception, "share", 1.0)
            state[k] = getattr(reception, "state", 0)
        return ReceptionHistory(used, share, state, alarm if watched else None)


class ReceptionHistory(NamedTuple):
    """What the receiver of one link made of it; arrays of shape (samples,).

    Attributes
    ----------
    used : ndarray
        Acceleration [m/s^2] that was used.
    share : ndarray or None
        Of the control law in the command; None where it is always 1.
    state : ndarray of int64 or None
        `ReceptionState`; None where it is always normal.
    alarm : ndarray of bool or None
        Whether its monitor says that packets contradict what is measured; None where it has none.
    """

    used: Array
    share: Array | None
    state: npt.NDArray[np.int64] | None
    alarm: npt.NDArray[np.bool_] | None = None


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
    share : ndarray or None, shape (samples, N)
        Of the control law in each follower's command, the rest being that of its law without V2V;
        None where nobody falls back.
    timing : Timing or None
        Of the followers' samples, where they keep time by clocks; None in lockstep.
    """

    scenario: Scenario
    position: Array
    velocity: Array
    acceleration: Array
    received: Array
    arrivals: tuple[Arrivals, ...] | None = None
    share: Array | None = None
    timing: Timing | None = None

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
    def motion(self) -> tuple[Array, Array, Array]:
        """Positions [m], velocities [m/s] and accelerations [m/s^2], each (samples, N + 1)."""
        return self.position, self.velocity, self.acceleration

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
        return spacing_errors(self.scenario, self.position, self.velocity)

    @cached_property
    def spacing(self) -> Array:
        """x_{i-1} - x_i [m] of followers 1..N, shape (samples, N)."""
        return self.position[:, :-1] - self.position[:, 1:]

    @cached_property
    def gap(self) -> Array:
        """`spacing` less the length of the vehicle ahead [m], shape (samples, N)."""
        return gaps(self.scenario, self.position)

    @property
    def ends_in_collision(self) -> bool:
        """Whether the last sample is the first one at which vehicles touch, and is to be."""
        last = len(self.position) - 1
        return self.scenario.stops_on_collision and first_collision(self.gap) == last

    @cached_property
    def platoon_length(self) -> Array:
        """x_0 - x_N [m], shape (samples,)."""
        return self.position[:, 0] - self.position[:, -1]


def spacing_errors(scenario: Scenario, position: Array, velocity: Array) -> Array:
    """Return delta_i [m] of followers at positions [m] and velocities [m/s].

    They are of shape (samples, N + 1) or (samples, runs, N + 1).
    """
    policy = policy_of(scenario.followers, len(position))
    headway = np.asarray(policy.gains.time_headway)
    if headway.ndim > 1 and position.ndim > headway.ndim:
        policy = policy.with_headway(headway[:, np.newaxis])
    return np.asarray(
        policy.spacing_error(position[..., 1:], velocity[..., 1:], position[..., :-1])
    )


def policy_of(
    followers: Sequence[Follower],
    samples: int,
    laws: Sequence[ConstantTimeHeadway] | None = None,
) -> ConstantTimeHeadway:
    """Return headways and gains of followers, or of laws given for them, as one law of arrays.

    They are of shape (N,), and headways that change of shape (samples, N).
    """
    gains = Gains(*np.array([one.gains for one in laws or followers]).T)
    moving = [follower.headways(samples) for follower in followers]
    policy = ConstantTimeHeadway(gains, followers[0].standstill_distance)
    if all(headway is None for headway in moving):
        return policy
    columns = [
        np.full(samples, follower.gains.time_headway) if headway is None else headway
        for follower, headway in zip(followers, moving, strict=True)
    ]
    return policy.with_headway(np.stack(columns, axis=1))


def gaps(scenario: Scenario, position: Array) -> Array:
    """Return the gaps [m] between vehicles at these positions [m], shape (samples, N + 1)."""
    return np.asarray(position[:, :-1] - position[:, 1:] - np.array(scenario.lengths[:-1]))


def first_collision(gap: Array) -> int | None:
    """Return the first sample at which vehicles touch, of gaps of shape (samples, N)."""
    touching = (gap <= 0.0).any(axis=1)
    return int(np.argmax(touching)) if touching.any() else None


def law_shares(scenario: Scenario, links: Mapping[int, Array]) -> Array | None:
    """Return the share of each follower's law in its command, the least of its links.

    Parameters
    ----------
    scenario : Scenario
        The run.
    links : Mapping of int to ndarray, shape (samples,)
        By link, in the order of the topology, those that have less than all at times.
    """
    if not links:
        return None
    share = np.ones((len(next(iter(links.values()))), len(scenario.topology.columns)))
    for number, own in enumerate(scenario.topology.columns):
        for column in range(own.start, own.stop):
            if column in links:
                share[:, number] = np.minimum(share[:, number], links[column])
    return share
