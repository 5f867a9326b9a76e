"""Whether a recorded run is what its scenario gives: followers, links and leader, each by itself.

Every value that a number of a report rests on is compared by one of the three: a follower's state
with the step from the sample before, what arrives with what was sent, the leader's motion with its
profile. Together they see a change of any single value above `TOLERANCE`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from cacc_platoon.model import State, ThirdOrderPlant, sample_profile
from cacc_platoon.simulation import Arrivals, Trajectory
from cacc_platoon.simulation.bodies import Actuators
from cacc_platoon.simulation.platoon import arrivals_of, commands_of
from cacc_platoon.simulation.trajectory import Array

TOLERANCE = 1e-9
"""Departure [m, m/s, m/s^2] that is no rounding; other machines' exp differs by 1e-15."""


class Consistency(NamedTuple):
    """How well recorded values are those that are due.

    Attributes
    ----------
    steps : int
        What could be compared: steps of all followers, packets of all links, samples of the leader.
    largest : float
        Largest difference [m, m/s or m/s^2] between a recorded value and the one that is due;
        0.0 when they agree to the last bit, infinite where a packet arrived that is due at another
        sample or not at all, or the other way round.
    departures : tuple of (vehicle, time, difference)
        First departure above `TOLERANCE` of each vehicle, the receiver of a link, that has one.
    unknown : str
        What nothing is known to compare with, for a sentence; empty when there is none.
    """

    steps: int
    largest: float
    departures: tuple[tuple[int, float, float], ...]
    unknown: str = ""


def check_consistency(run: Trajectory) -> Consistency:
    """Compare every recorded state with the step from the recorded sample before.

    Followers whose law is custom code are left out, since nothing that reads a run may run it.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> from cacc_platoon.simulation import simulate
    >>> check_consistency(simulate(Scenario.from_values({"run.duration": 11.0}))).largest
    0.0
    """
    scenario = run.scenario
    followers = scenario.followers
    plant = ThirdOrderPlant(np.array([follower.tau for follower in followers]), scenario.run.step)
    own = State(*(part[:-1, 1:] for part in run.motion))
    with np.errstate(invalid="ignore", over="ignore"):
        due = plant.advance(own, commands_of(run).carried_out[:-1])
        due = Actuators(followers, scenario.run.step).standing(own, due)
        recorded = (part[1:, 1:] for part in run.motion)
        difference = _farthest(due, recorded)
    custom = [follower.law_name for follower in followers]
    receivers = [follower.v2v.receiver for follower in followers]
    unknown = [bool(law or receiver) for law, receiver in zip(custom, receivers, strict=True)]
    difference[:, unknown] = np.nan
    indices = [follower.index for follower in followers]
    code = (_of_custom_code(custom, "control law"), _of_custom_code(receivers, "reception"))
    return _compared(difference, run.time[1:], indices, ", nor ".join(filter(None, code)))


def check_links(run: Trajectory) -> Consistency:
    """Compare what arrived over every link with what its channel makes of what was sent.

    Noise and losses are keyed by seed, link and packet, so that they can be computed again. Links
    whose channel is custom code are left out.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> from cacc_platoon.simulation import simulate
    >>> check_links(simulate(Scenario.from_values({"run.duration": 11.0, "v2v.loss": 0.1}))).largest
    0.0
    """
    samples, receivers = len(run.position), run.scenario.receivers
    difference = np.full((samples, len(receivers)), np.nan)
    for column, (receiver, sender) in enumerate(
        zip(receivers, run.scenario.topology.senders, strict=True)
    ):
        if receiver.v2v.channel:
            continue
        motion = np.stack([part[:, sender] for part in run.motion])
        with np.errstate(invalid="ignore", over="ignore"):
            due, due_at = _by_source(arrivals_of(receiver, motion), samples)
            found, found_at = run.received[:, column], due_at
            if run.arrivals:
                found, found_at = _by_source(run.arrivals[column], samples)
            apart = np.abs(found - due)
        if run.scenario.clocked:  # when it comes is up to the clocks
            apart[(due_at < 0) & (found_at >= 0)] = math.inf
        elif receiver.counted:  # elsewhere what is not there is missing in the bag, not lost
            apart[due_at != found_at] = math.inf
        difference[:, column] = apart
    custom = [receiver.v2v.channel for receiver in receivers]
    indices = [receiver.index for receiver in receivers]
    return _compared(difference, run.time, indices, _of_custom_code(custom, "channel"))


def _by_source(arrivals: Arrivals, samples: int) -> tuple[Array, Array]:
    """Return what arrived of each sample, and at which one; NaN and -1 where nothing did."""
    value, at = np.full(samples, np.nan), np.full(samples, -1.0)
    value[arrivals.source], at[arrivals.source] = arrivals.value, arrivals.sample
    return value, at


def check_leader(run: Trajectory) -> Consistency:
    """Compare the leader's motion with its profile.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> from cacc_platoon.simulation import simulate
    >>> check_leader(simulate(Scenario.from_values({"run.duration": 11.0}))).largest
    0.0
    """
    scenario = run.scenario
    if scenario.leader.profile == "bag":
        return Consistency(0, 0.0, (), "the leader's motion, which is that of another bag")
    due = sample_profile(scenario.leader_profile(), scenario.run.step, len(run.position))
    recorded = (part[:, :1] for part in (run.position, run.velocity, run.acceleration))
    difference = _farthest(due[:, :, np.newaxis], recorded)
    return _compared(difference, run.time, [scenario.leader_index])


def _farthest(due: Iterable[Array], recorded: Iterable[Array]) -> Array:
    """Return how far apart position, velocity or acceleration are, whichever is most."""
    return np.stack([np.abs(a - b) for a, b in zip(due, recorded, strict=True)]).max(axis=0)


def _of_custom_code(names: Sequence[str], what: str) -> str:
    """Name custom code that nothing which reads a run may run, and so nothing is compared with."""
    named = sorted(set(filter(None, names)))
    return f"what the custom {what} {' and '.join(named)} did" if named else ""


def _compared(
    difference: Array, time: Array, indices: Sequence[int], unknown: str = ""
) -> Consistency:
    """Sum differences up, one row a sample and one column a vehicle or link; NaN for unknown."""
    known = ~np.isnan(difference)
    difference = np.where(known, difference, 0.0)
    departures: dict[int, tuple[int, float, float]] = {}
    for column, index in enumerate(indices):
        beyond = np.flatnonzero(difference[:, column] > TOLERANCE)
        if beyond.size:
            first = int(beyond[0])
            found = (index, float(time[first]), float(difference[first, column]))
            departures[index] = min(departures.get(index, found), found, key=lambda one: one[1])
    largest = float(np.max(difference, initial=0.0))
    return Consistency(int(known.sum()), largest, tuple(departures.values()), unknown)
