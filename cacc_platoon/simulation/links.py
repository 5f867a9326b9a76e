"""What every follower receives, in arrays: the V2V links of a whole platoon, sample by sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cacc_platoon.model import Channel, Delivery
from cacc_platoon.model.channel import ChannelError, checked_delivery, promise_of
from cacc_platoon.model.packets import EVERY_VALUE, Integers, Lattice, said
from cacc_platoon.model.reception import picked
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.simulation.trajectory import Array, Arrivals

ChannelFactory = Callable[[Follower], Channel]


class Links(Protocol):
    """The L V2V links of runs that are integrated together, in the order of the topology."""

    def received(self, sample: int, acceleration: Array) -> Array:
        """Return what is used of every link at a sample [m/s^2], shape (runs, L).

        Parameters
        ----------
        sample : int
            The sample, asked for in order.
        acceleration : ndarray, shape (samples, runs, N + 1)
            Accelerations [m/s^2], known up to the sample.
        """
        ...


class PromptLinks(NamedTuple):
    """Links that deliver every packet at the sample it was sent at.

    Attributes
    ----------
    senders : ndarray of int64, shape (L,)
        Column of each link's sender.
    factor : ndarray, shape (samples, runs, L)
        Noise factors w.
    """

    senders: Integers
    factor: Array

    def received(self, sample: int, acceleration: Array) -> Array:
        """Return w a_j of the sample, j being the sender."""
        used: Array = self.factor[sample] * acceleration[sample].take(self.senders, axis=-1)
        return used


class ImpairedLinks(NamedTuple):
    """Links that may lose, delay or change packets.

    Attributes
    ----------
    senders : ndarray of int64, shape (L,)
        Column of each link's sender.
    carried : ndarray of int64, shape (samples, runs, L)
        Sample whose acceleration is used, -1 where the receiver uses 0.
    factor : ndarray, shape (samples, runs, L)
        What multiplies it.
    offset : ndarray or None, shape (samples, runs, L)
        What is added to it before [m/s^2].
    lattices : tuple of Lattice
        What the packets of each link can say.
    """

    senders: Integers
    carried: Integers
    factor: Array
    offset: Array | None
    lattices: tuple[Lattice, ...]

    def received(self, sample: int, acceleration: Array) -> Array:
        """Return the accelerations that the receivers use."""
        carried = self.carried[sample]
        runs = np.arange(len(carried))[:, np.newaxis]
        sent = acceleration[carried, runs, self.senders]
        if self.offset is not None:
            sent = said(sent, self.offset[sample], EVERY_VALUE)
        for column, lattice in enumerate(self.lattices):
            if lattice != EVERY_VALUE:
                sent[:, column] = lattice.nearest(sent[:, column])
        return np.where(carried >= 0, self.factor[sample] * sent, 0.0)


class MeanLinks:
    """The mean of all links' random runs, which is a linear system.

    The mean of w a is E[w] a. Where a packet that is due arrives with probability p, a receiver
    that uses zero has p E[w] a in the mean until the next one is due, and one that holds has
    r = p E[w] a + (1 - p) times what it had before, a as it was when the packet was sent: loss and
    noise of a packet are independent of what was received before, see
    docs/theory.md, section 11 (Extensions). Where losses come in bursts, that is so given whether
    the time is good or bad: r is the sum of its parts in good and in bad times.

    Parameters
    ----------
    scenario : Scenario
        The run; v2v.channel is left out, noise and loss count as v2v says.
    """

    def __init__(self, scenario: Scenario) -> None:
        followers = scenario.receivers
        self._senders = np.array(scenario.topology.senders)
        self._mean = np.array([mean_factor(follower) for follower in followers])
        self._share, self._lost, self._next = _good_and_bad(followers)
        holds = np.array([follower.v2v.reception == "hold" for follower in followers])
        self._kept = np.where(holds, 1.0, 0.0)
        times = 2 if any(follower.v2v.burst_begin for follower in followers) else 1
        self._parts = [np.zeros(len(followers)) for _ in range(times)]
        self._bias = np.array([follower.v2v.bias for follower in followers])
        self._due = _due(scenario)

    def received(self, sample: int, acceleration: Array) -> Array:
        """Return the mean accelerations that the receivers use."""
        due, lost = self._due, self._lost
        if due is None:
            sent = acceleration[sample].take(self._senders, axis=-1)
        else:
            sent = np.moveaxis(acceleration[due.carried[sample], ..., self._senders], 0, -1)
            lost = np.where(due.dark[sample], 1.0, lost)
        if self._bias.any():
            sent = sent + self._bias
        if due is not None:
            sent = sent * due.factor[sample]
        parts = []
        for state, now in enumerate(self._parts):
            before = sum(self._next[last, state] * part for last, part in enumerate(self._parts))
            fresh = (1.0 - lost[state]) * self._mean * self._share[state] * sent
            used = fresh + lost[state] * self._kept * before
            parts.append(used if due is None else np.where(due.carried[sample] >= 0, used, now))
        self._parts = parts
        return np.asarray(sum(parts), np.float64)


def _good_and_bad(followers: Sequence[Follower]) -> tuple[Array, Array, Array]:
    """Return shares and losses of good and of bad times, shape (2, L), and what follows what.

    The last is of shape (2, 2, L): the probability of the second after the first.
    """
    share, lost, follows = [], [], []
    for follower in followers:
        v2v = follower.v2v
        begin, end = v2v.burst_begin, v2v.burst_end if v2v.burst_begin else 1.0
        bad = begin / (begin + end)
        share.append((1.0 - bad, bad))
        lost.append((v2v.loss, v2v.burst_loss))
        follows.append(((1.0 - begin, begin), (end, 1.0 - end)))
    return np.array(share).T, np.array(lost).T, np.moveaxis(np.array(follows), 0, -1)


class _Due(NamedTuple):
    """Packets that are due in the mean, each of shape (samples, L).

    Which sample's acceleration is in the packet, -1 where none is due, by what false data multiply
    it, and whether it is sent in a blackout.
    """

    carried: Integers
    factor: Array
    dark: NDArray[np.bool_]


def _due(scenario: Scenario) -> _Due | None:
    """Return the packets that are due; None where each sample's own is, and arrives or is lost."""
    receivers, samples = scenario.receivers, scenario.samples
    if all(
        follower.timing().prompt and not (follower.v2v.blackouts or follower.v2v.false_data)
        for follower in receivers
    ):
        return None
    shape = samples, len(receivers)
    due = _Due(np.full(shape, -1), np.ones(shape), np.zeros(shape, np.bool_))
    for column, follower in enumerate(receivers):
        packets = follower.timing().delivery(0, samples)
        due.carried[packets.sample, column] = packets.carried
        due.factor[packets.sample, column] = packets.factor
        for begin, end in follower.blackouts:
            inside = (packets.source >= begin) & (packets.source < end)
            due.dark[packets.sample[inside], column] = True
    return due


def mean_factor(follower: Follower) -> float:
    """Return E[w] of the link to a follower."""
    kind = "expected" if follower.v2v.noise == "bits" else follower.v2v.noise
    return float(follower.noise(kind).factors(0, 1)[0])


class LinkPlan(NamedTuple):
    """What one link does in one run: its deliveries, and which of them is used at each sample."""

    prompt: bool
    delivery: Delivery
    chosen: Integers

    @property
    def exact(self) -> bool:
        """Whether every sample's acceleration is used at that sample, times a factor."""
        return self.prompt and self.delivery.exact

    @property
    def carried(self) -> Integers:
        """Sample whose acceleration is used at each sample, -1 for none, shape (samples,)."""
        return picked(self.delivery.carried, self.chosen, -1)

    @property
    def factor(self) -> Array:
        """What multiplies it, shape (samples,)."""
        return picked(self.delivery.factor, self.chosen, 0)

    @property
    def offset(self) -> Array:
        """What is added to it before [m/s^2], shape (samples,)."""
        given = self.delivery.offset
        return np.zeros(len(self.chosen)) if given is None else picked(given, self.chosen, 0)

    def arrivals(self, sent: Array) -> Arrivals:
        """Return what arrives when these accelerations [m/s^2] are sent, shape (samples,)."""
        with np.errstate(all="ignore"):  # an unstable platoon overflows
            values = self.delivery.values(sent)
        return Arrivals(self.delivery.source, self.delivery.sample, values)


def plan_link(follower: Follower, samples: int, channel: Channel) -> LinkPlan:
    """Return what the link to a follower does from sample 0 on."""
    try:
        delivery = checked_delivery(channel, 0, samples)
    except ChannelError as error:
        raise ChannelError(
            f"the channel of vehicle {follower.index}: {error}. Correct it."
        ) from error
    if promise_of(channel).prompt:
        return LinkPlan(True, delivery, np.arange(samples))
    return LinkPlan(False, delivery, follower.reception().chosen(delivery, samples))


def plan_links(
    scenario: Scenario, noise: str | None = None, channel: ChannelFactory | None = None
) -> list[LinkPlan]:
    """Return the plan of every link of a scenario, in the order of its topology."""
    return [
        plan_link(
            follower, scenario.samples, channel(follower) if channel else follower.channel(noise)
        )
        for follower in scenario.receivers
    ]


def links_of(scenario: Scenario, runs: Sequence[Sequence[LinkPlan]]) -> Links:
    """Return the links of several runs of one platoon, to integrate them together."""
    senders = np.array(scenario.topology.senders)
    plans = [plan for run in runs for plan in run]

    def stacked(of: Callable[[LinkPlan], NDArray[Any]]) -> NDArray[Any]:
        return np.stack([np.stack([of(plan) for plan in run], axis=1) for run in runs], axis=1)

    factor = stacked(lambda plan: plan.factor)
    if all(plan.exact for plan in plans):
        return PromptLinks(senders, factor)
    added = any(plan.delivery.offset is not None for plan in plans)
    return ImpairedLinks(
        senders,
        stacked(lambda plan: plan.carried),
        factor,
        stacked(lambda plan: plan.offset) if added else None,
        tuple(plan.delivery.lattice for plan in runs[0]),
    )
