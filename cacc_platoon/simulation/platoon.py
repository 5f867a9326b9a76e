"""The whole platoon in arrays: the reference that the node graph must match to the last bit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cacc_platoon.model import ConstantTimeHeadway, Gains, State, ThirdOrderPlant, sample_profile
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation.trajectory import Array, Trajectory

Progress = Callable[[int, int], None]


def initial_positions(scenario: Scenario) -> list[float]:
    """Return x_i(0) [m] of the leader and its followers, in equilibrium behind the leader."""
    positions = [scenario.leader_profile().at(0.0).position]
    for follower in scenario.followers:
        spacing = follower.standstill_distance + (
            follower.gains.time_headway * scenario.platoon.initial_speed
        )
        positions.append(positions[-1] - spacing)
    return positions


def simulate(
    scenario: Scenario, noise: str | None = None, progress: Progress | None = None
) -> Trajectory:
    """Run the platoon of a scenario without ROS.

    Parameters
    ----------
    scenario : Scenario
        What to run.
    noise : {'bits', 'expected', 'none'}, optional
        Replaces every follower's v2v.noise.
    progress : callable, optional
        Called now and then with the sample reached and the number of samples.

    Examples
    --------
    >>> run = simulate(Scenario.from_values({"run.duration": 1.0}))
    >>> float(run.platoon_length[0])
    345.0
    """
    factors = channel_factors(scenario, noise)
    states = propagate(scenario, factors[:, np.newaxis, :], progress)
    position, velocity, acceleration = (np.ascontiguousarray(part[:, 0]) for part in states)
    with np.errstate(all="ignore"):
        received = factors * acceleration[:, :-1]
    return Trajectory(scenario, position, velocity, acceleration, received)


def channel_factors(scenario: Scenario, noise: str | None = None) -> Array:
    """Return the noise factors w of every link, shape (samples, N)."""
    samples = scenario.samples
    links = [follower.channel(noise).factors(0, samples) for follower in scenario.followers]
    return np.stack(links, axis=1)


@np.errstate(all="ignore")  # an unstable platoon overflows, and that is its result
def propagate(
    scenario: Scenario, factors: Array, progress: Progress | None = None
) -> tuple[Array, Array, Array]:
    """Integrate many runs of one platoon that differ in their noise.

    Parameters
    ----------
    scenario : Scenario
        What to run.
    factors : ndarray, shape (samples, runs, N)
        Noise factors w of every run and link.

    Returns
    -------
    tuple of three ndarray, shape (samples, runs, N + 1)
        Position [m], velocity [m/s] and acceleration [m/s^2].
    """
    samples, runs, _ = factors.shape
    followers = scenario.followers
    plant = ThirdOrderPlant(np.array([follower.tau for follower in followers]), scenario.run.step)
    gains = np.array([follower.gains for follower in followers]).T
    law = ConstantTimeHeadway(Gains(*gains), scenario.platoon.standstill_distance)
    history = np.empty((3, samples, runs, len(followers) + 1))
    history[:, :, :, 0] = sample_profile(scenario.leader_profile(), scenario.run.step, samples)[
        :, :, np.newaxis
    ]
    history[0, 0] = initial_positions(scenario)
    history[1, 0] = scenario.platoon.initial_speed
    history[2, 0, :, 1:] = 0.0
    for k in range(samples - 1):
        position, velocity, acceleration = history[:, k]
        command = law.command(
            position[:, 1:],
            velocity[:, 1:],
            position[:, :-1],
            velocity[:, :-1],
            factors[k] * acceleration[:, :-1],
        )
        state = State(position[:, 1:], velocity[:, 1:], acceleration[:, 1:])
        history[0, k + 1, :, 1:], history[1, k + 1, :, 1:], history[2, k + 1, :, 1:] = (
            plant.advance(state, command)
        )
        if progress and k % 500 == 0:
            progress(k, samples)
    return history[0], history[1], history[2]
