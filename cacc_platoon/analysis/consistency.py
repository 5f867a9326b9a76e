"""Whether a recorded run obeys the equations and parameters it claims to: one step at a time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cacc_platoon.model import ConstantTimeHeadway, Gains, State, ThirdOrderPlant
from cacc_platoon.simulation import Trajectory

TOLERANCE = 1e-9
"""Departure [m, m/s, m/s^2] that is no rounding; other machines' exp differs by 1e-15."""


class Consistency(NamedTuple):
    """How well recorded followers follow plant and control law.

    Attributes
    ----------
    steps : int
        Steps that could be checked, all followers together.
    largest : float
        Largest difference [m, m/s or m/s^2] between a recorded state and the one computed from the
        sample before; 0.0 when the run follows the equations to the last bit.
    departures : tuple of (follower, time, difference)
        First departure above `TOLERANCE` of each follower that has one.
    """

    steps: int
    largest: float
    departures: tuple[tuple[int, float, float], ...]


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
    gains = Gains(*np.array([follower.gains for follower in followers]).T)
    law = ConstantTimeHeadway(gains, scenario.platoon.standstill_distance)
    nearest = [own.start for own in scenario.topology.columns]
    own = State(*(part[:-1, 1:] for part in (run.position, run.velocity, run.acceleration)))
    with np.errstate(invalid="ignore", over="ignore"):
        command = law.command(
            own.position,
            own.velocity,
            run.position[:-1, :-1],
            run.velocity[:-1, :-1],
            run.received[:-1, nearest],
        )
        due = plant.advance(own, command)
        recorded = (part[1:, 1:] for part in (run.position, run.velocity, run.acceleration))
        difference = np.max([np.abs(a - b) for a, b in zip(due, recorded, strict=True)], axis=0)
    own_law = [not follower.law_name for follower in followers]
    known = np.isfinite(difference) & own_law
    difference = np.where(known, difference, 0.0)
    departures = []
    for column in range(difference.shape[1]):
        beyond = np.flatnonzero(difference[:, column] > TOLERANCE)
        if beyond.size:
            first = int(beyond[0])
            where = (float(run.time[first + 1]), float(difference[first, column]))
            departures.append((followers[column].index, *where))
    return Consistency(int(known.sum()), float(np.max(difference, initial=0.0)), tuple(departures))
