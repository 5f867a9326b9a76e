"""The whole platoon in arrays: the reference that the node graph must match to the last bit."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cacc_platoon.errors import UserError
from cacc_platoon.model import (
    ConstantTimeHeadway,
    ControlLaw,
    Gains,
    State,
    ThirdOrderPlant,
    sample_profile,
)
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.simulation.links import (
    ChannelFactory,
    Links,
    MeanLinks,
    PromptLinks,
    links_of,
    plan_links,
)
from cacc_platoon.simulation.trajectory import Array, Trajectory

Progress = Callable[[int, int], None]
LawFactory = Callable[[Follower], ControlLaw]


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
    scenario: Scenario,
    noise: str | None = None,
    progress: Progress | None = None,
    *,
    channel: ChannelFactory | None = None,
    law: LawFactory | None = None,
) -> Trajectory:
    """Run the platoon of a scenario without ROS.

    Parameters
    ----------
    scenario : Scenario
        What to run.
    noise : {'bits', 'expected', 'none'}, optional
        Replaces every follower's v2v.noise.
    progress : callable, optional
        Called periodically with the sample reached and the number of samples.
    channel, law : callable, optional
        Make another channel, or control law, from each follower's parameters.

    Raises
    ------
    ScenarioError
        For another noise than these.

    Examples
    --------
    >>> run = simulate(Scenario.from_values({"run.duration": 1.0}))
    >>> float(run.platoon_length[0])
    345.0
    """
    plans = plan_links(scenario, noise, channel)
    links = links_of(scenario, [plans])
    states = propagate(scenario, links, progress, law=law)
    position, velocity, acceleration = (np.ascontiguousarray(part[:, 0]) for part in states)
    arrivals = None
    if not isinstance(links, PromptLinks):
        sent = zip(plans, scenario.topology.senders, strict=True)
        arrivals = tuple(plan.arrivals(acceleration[:, sender]) for plan, sender in sent)
    return Trajectory(
        scenario, position, velocity, acceleration, used_of(links, states[2])[:, 0], arrivals
    )


def simulate_mean(scenario: Scenario) -> Trajectory:
    """Run the mean system of a scenario: the expectation of all its noisy, lossy runs.

    Custom laws and channels are left out: it is the mean of what gains and v2v say.

    Examples
    --------
    >>> scenario = Scenario.from_values({"run.duration": 11.0, "v2v.noise": "expected"})
    >>> run, mean = simulate(scenario), simulate_mean(scenario)
    >>> bool((run.position == mean.position).all())
    True
    """
    links = MeanLinks(scenario)
    states = propagate(scenario, links, law=Follower.spacing_policy)  # no code of the user's
    position, velocity, acceleration = (np.ascontiguousarray(part[:, 0]) for part in states)
    received = used_of(MeanLinks(scenario), states[2])[:, 0]
    return Trajectory(scenario, position, velocity, acceleration, received)


@np.errstate(all="ignore")
def used_of(links: Links, acceleration: Array) -> Array:
    """Return what was used of every link at every sample, shape (samples, runs, L)."""
    return np.stack([links.received(k, acceleration) for k in range(len(acceleration))])


@np.errstate(all="ignore")  # an unstable platoon overflows, and that is its result
def propagate(
    scenario: Scenario,
    links: Links,
    progress: Progress | None = None,
    *,
    runs: int = 1,
    law: LawFactory | None = None,
) -> tuple[Array, Array, Array]:
    """Integrate many runs of one platoon that differ in their links.

    Parameters
    ----------
    scenario : Scenario
        What to run.
    links : Links
        What the followers receive.
    runs : int, optional
        How many runs.

    Returns
    -------
    tuple of three ndarray, shape (samples, runs, N + 1)
        Position [m], velocity [m/s] and acceleration [m/s^2].
    """
    samples, followers = scenario.samples, scenario.followers
    plant = ThirdOrderPlant(np.array([follower.tau for follower in followers]), scenario.run.step)
    command = _command(scenario, law)
    history = np.empty((3, samples, runs, len(followers) + 1))
    history[:, :, :, 0] = sample_profile(scenario.leader_profile(), scenario.run.step, samples)[
        :, :, np.newaxis
    ]
    history[0, 0] = initial_positions(scenario)
    history[1, 0] = scenario.platoon.initial_speed
    history[2, 0, :, 1:] = 0.0
    for k in range(samples - 1):
        position, velocity, acceleration = history[:, k]
        u = command(
            position[:, 1:],
            velocity[:, 1:],
            position[:, :-1],
            velocity[:, :-1],
            links.received(k, history[2]),
        )
        state = State(position[:, 1:], velocity[:, 1:], acceleration[:, 1:])
        history[0, k + 1, :, 1:], history[1, k + 1, :, 1:], history[2, k + 1, :, 1:] = (
            plant.advance(state, u)
        )
        if progress and k % 500 == 0:
            progress(k, samples)
    return history[0], history[1], history[2]


def _command(scenario: Scenario, law: LawFactory | None) -> Callable[..., Array]:
    """Return the control laws of all followers as one function of arrays.

    It takes motion, shape (runs, N), and what is used of every link, shape (runs, L).
    """
    followers, links = scenario.followers, scenario.topology.columns
    laws = [law(follower) if law else follower.law() for follower in followers]
    if all(type(one) is ConstantTimeHeadway for one in laws):
        gains = Gains(*np.array([follower.gains for follower in followers]).T)
        common = ConstantTimeHeadway(gains, followers[0].standstill_distance)
        nearest = [own.start for own in links]

        def common_command(x: Array, v: Array, x_ahead: Array, v_ahead: Array, a: Array) -> Array:
            return common.command(x, v, x_ahead, v_ahead, a.take(nearest, axis=-1))

        return common_command

    def command(*inputs: Array) -> Array:
        *motion, received = inputs
        columns = [
            _column(one, follower.index, [*(part[:, i] for part in motion), *received[:, own].T])
            for i, (one, follower, own) in enumerate(zip(laws, followers, links, strict=True))
        ]
        return np.stack(columns, axis=1)

    return command


def _column(law: ControlLaw, index: int, inputs: Sequence[Array]) -> Array:
    """Return the commands of one follower in all runs; its law may be anybody's."""
    try:
        command = np.asarray(law.command(*inputs))  # type: ignore[arg-type]
        if command.dtype.kind not in "iuf":
            raise TypeError(f"returned {command.dtype}, not numbers")
        wrong = ~np.isfinite(command)
        if wrong.any() and all(np.isfinite(part).all() for part in inputs):
            raise ValueError(f"returned {command[wrong].flat[0]}")
        return np.broadcast_to(command.astype(np.float64), inputs[0].shape)
    except (Exception, SystemExit) as error:
        raise UserError(
            f"the control law of vehicle {index} raised {type(error).__name__}: "
            f"{' '.join(str(error).split())}. Correct it; it must take arrays too."
        ) from error
