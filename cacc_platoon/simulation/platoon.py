"""The whole platoon in arrays: the reference that the node graph must match to the last bit."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from cacc_platoon.errors import UserError
from cacc_platoon.model import (
    Channel,
    ConstantTimeHeadway,
    ControlLaw,
    Gains,
    PacketSource,
    Reception,
    State,
    ThirdOrderPlant,
    sample_profile,
)
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.scenario.receiver import packet_source
from cacc_platoon.simulation.bodies import Actuators, Sensors, measured_ahead
from cacc_platoon.simulation.links import (
    ChannelFactory,
    Links,
    delivery_of,
    links_of,
    plan_links,
    planned,
)
from cacc_platoon.simulation.mean_links import MeanLinks
from cacc_platoon.simulation.stepped_links import LinkOfRun, SteppedLinks, followed
from cacc_platoon.simulation.timing import Timing
from cacc_platoon.simulation.trajectory import (
    Array,
    Arrivals,
    Trajectory,
    first_collision,
    gaps,
    policy_of,
)

Progress = Callable[[int, int], None]
LawFactory = Callable[[Follower], ControlLaw]
ReceptionFactory = Callable[[Follower], Reception]


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
    reception: ReceptionFactory | None = None,
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
    channel, law, reception : callable, optional
        Make another channel, control law, or reception, from each follower's parameters.

    Raises
    ------
    ScenarioError
        For another noise than these, or a reception where packets are not counted.

    Examples
    --------
    >>> run = simulate(Scenario.from_values({"run.duration": 1.0}))
    >>> float(run.platoon_length[0])
    345.0
    """
    links = links_of_runs([scenario], noise, channel, reception)
    states = propagate(scenario, links, progress, law=law, sensors=Sensors.of([scenario]))
    last = first_collision(gaps(scenario, states[0, :, 0]))
    if last is not None and scenario.stops_on_collision:
        run = dataclasses.replace(scenario.run, duration=last * scenario.run.step)
        shorter = dataclasses.replace(scenario, run=run)
        links = links_of_runs([shorter], noise, channel, reception)
        states = states[:, : last + 1]
    return _of_one_run(scenario, links, states)


def links_of_runs(
    runs: Sequence[Scenario],
    noise: str | None = None,
    channel: ChannelFactory | None = None,
    reception: ReceptionFactory | None = None,
) -> Links:
    """Return the links of several runs of one platoon, which differ in their seeds."""
    topology, samples = runs[0].topology, runs[0].samples

    def given(follower: Follower) -> Channel | None:
        return channel(follower) if channel else None

    def receivers(run: Scenario) -> list[Follower]:
        return [one.receiving(reception) for one in run.receivers]

    if all(planned(one, given(one)) for one in receivers(runs[0])):
        return links_of(topology.senders, [plan_links(run, noise, channel) for run in runs])

    def packets(follower: Follower) -> Callable[[], PacketSource]:
        return lambda: packet_source(follower, samples, given(follower), noise)

    links = [[LinkOfRun(one, packets(one)) for one in receivers(run)] for run in runs]
    watched = any(one.monitored for one in runs[0].receivers)
    sensors = Sensors.of(runs) if watched else None
    return SteppedLinks(links, topology.senders, topology.columns, sensors)


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
    sensors = Sensors.of([scenario], noise=False)
    states = propagate(  # no code of the user's
        scenario, links, law=Follower.spacing_policy, sensors=sensors
    )
    return _of_one_run(scenario, links, states)


def _of_one_run(scenario: Scenario, links: Links, states: Array) -> Trajectory:
    used, share = used_of(links, states)
    position, velocity, acceleration = (np.ascontiguousarray(part[:, 0]) for part in states)
    return Trajectory(
        scenario,
        position,
        velocity,
        acceleration,
        used[:, 0],
        links.arrivals(0, states),
        None if share is None else share[:, 0],
        Timing.perfect(*position[:, 1:].shape) if scenario.clocked else None,
    )


@np.errstate(all="ignore")
def used_of(links: Links, motion: Array) -> tuple[Array, Array | None]:
    """Return what is used of every link at every sample, (samples, runs, L), and shares of laws.

    The latter, (samples, runs, N), are None where nobody falls back.
    """
    used, shares = [], []
    for k in range(motion.shape[1]):
        used.append(links.received(k, motion))
        shares.append(links.share)
    if all(share is None for share in shares):
        return np.stack(used), None
    whole = np.ones((1, motion.shape[3] - 1))
    filled = [whole if share is None else share for share in shares]
    return np.stack(used), np.stack(np.broadcast_arrays(*filled))


@np.errstate(all="ignore")  # an unstable platoon overflows, and that is its result
def propagate(
    scenario: Scenario,
    links: Links,
    progress: Progress | None = None,
    *,
    runs: int = 1,
    law: LawFactory | None = None,
    sensors: Sensors | None = None,
) -> Array:
    """Integrate many runs of one platoon that differ in their links.

    Parameters
    ----------
    scenario : Scenario
        What to run.
    links : Links
        What the followers receive.
    runs : int, optional
        How many runs.
    law : callable, optional
        Makes another control law from each follower's parameters.
    sensors : Sensors, optional
        What the followers measure; all that is, by default.

    Returns
    -------
    ndarray, shape (3, samples, runs, N + 1)
        Position [m], velocity [m/s] and acceleration [m/s^2].
    """
    samples, followers = scenario.samples, scenario.followers
    plant = ThirdOrderPlant(np.array([follower.tau for follower in followers]), scenario.run.step)
    command, alone = _command(scenario, law), law_without_v2v(followers).command
    actuators = Actuators(followers, scenario.run.step)
    history = np.empty((3, samples, runs, len(followers) + 1))
    history[:, :, :, 0] = sample_profile(scenario.leader_profile(), scenario.run.step, samples)[
        :, :, np.newaxis
    ]
    history[0, 0] = initial_positions(scenario)
    history[1, 0] = scenario.platoon.initial_speed
    history[2, 0, :, 1:] = 0.0
    for k in range(samples - 1):
        position, velocity, acceleration = history[:, k]
        position_ahead, velocity_ahead = position[:, :-1], velocity[:, :-1]
        if sensors:
            position_ahead, velocity_ahead = sensors.ahead(k, history)
        measured = position[:, 1:], velocity[:, 1:], position_ahead, velocity_ahead
        u = command(k, *measured, links.received(k, history))
        if links.share is not None:
            u = blended(u, alone(*measured, np.zeros(())), links.share)
        u = actuators.command(u, velocity[:, 1:])
        state = State(position[:, 1:], velocity[:, 1:], acceleration[:, 1:])
        history[0, k + 1, :, 1:], history[1, k + 1, :, 1:], history[2, k + 1, :, 1:] = (
            actuators.standing(state, plant.advance(state, u))
        )
        if progress and k % 500 == 0:
            progress(k, samples)
    return history


def arrivals_of(receiver: Follower, motion: Array) -> Arrivals:
    """Return what arrives over a link whose sender moves so, shape (3, samples)."""
    samples = motion.shape[1]
    if receiver.triggered:
        return followed(LinkOfRun(receiver, partial(packet_source, receiver, samples)), motion)
    delivery = delivery_of(receiver, samples, receiver.channel())
    with np.errstate(all="ignore"):
        values = delivery.values(motion[2])
    return Arrivals(delivery.source, delivery.sample, values)


class Commands(NamedTuple):
    """What followers want to do and what they carry out, shape (samples, N) [m/s^2]."""

    wanted: Array
    carried_out: Array


@np.errstate(all="ignore")
def commands_of(run: Trajectory) -> Commands:
    """Return the commands of a run, by gains and limits of its scenario, of its recorded states."""
    scenario, followers = run.scenario, run.scenario.followers
    position, velocity = (part[:, 1:] for part in run.motion[:2])
    ahead = measured_ahead(scenario, np.stack(run.motion), run.timing)
    measured = position, velocity, *ahead
    law = policy_of(followers, len(position))
    nearest = [own.start for own in scenario.topology.columns]
    wanted = law.command(*measured, run.received[:, nearest])
    if run.share is not None:
        alone = law_without_v2v(followers).command(*measured, np.zeros(()))
        wanted = blended(wanted, alone, run.share)
    if run.timing:
        wanted = run.timing.carried(wanted)
    actuators = Actuators(followers, scenario.run.step)
    if not actuators.limited:
        return Commands(wanted, wanted)
    carried_out = np.stack([actuators.command(*now) for now in zip(wanted, velocity, strict=True)])
    return Commands(wanted, carried_out)


def law_without_v2v(followers: Sequence[Follower]) -> ConstantTimeHeadway:
    """Return what followers fall back to as one law of arrays, their own where they do not."""
    laws = [one.fallback_law() or one.spacing_policy() for one in followers]
    gains = Gains(*np.array([law.gains for law in laws]).T)
    return ConstantTimeHeadway(gains, followers[0].standstill_distance)


def blended(command: Array, alone: Array, share: Array) -> Array:
    """Return ``share u + (1 - share) u_f`` where it is not all of the law, as nodes do."""
    return np.where(share < 1.0, share * command + (1.0 - share) * alone, command)


def _command(scenario: Scenario, law: LawFactory | None) -> Callable[..., Array]:
    """Return the control laws of all followers as one function of a sample and arrays.

    It takes motion, shape (runs, N), and what is used of every link, shape (runs, L).
    """
    followers, links = scenario.followers, scenario.topology.columns
    laws = [law(follower) if law else follower.law() for follower in followers]
    known = [one for one in laws if type(one) is ConstantTimeHeadway]
    if len(known) == len(laws):
        policy = policy_of(followers, scenario.samples, known)
        headways = np.asarray(policy.gains.time_headway)
        nearest = [own.start for own in links]

        def common_command(sample: int, *inputs: Array) -> Array:
            x, v, x_ahead, v_ahead, received = inputs
            now = policy.with_headway(headways[sample]) if headways.ndim > 1 else policy
            return now.command(x, v, x_ahead, v_ahead, received.take(nearest, axis=-1))

        return common_command

    moving = [follower.headways(scenario.samples) for follower in followers]

    def command(sample: int, *inputs: Array) -> Array:
        *motion, received = inputs
        columns = []
        for i, (follower, own, headway) in enumerate(zip(followers, links, moving, strict=True)):
            now = laws[i]
            if headway is not None:
                now = follower.spacing_policy().with_headway(headway[sample])
            given = [*(part[:, i] for part in motion), *received[:, own].T]
            columns.append(_column(now, follower.index, given))
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
