"""What every follower receives, in arrays: the V2V links of a whole platoon, sample by sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from cacc_platoon.model import Channel, Delivery
from cacc_platoon.model.impairment import ChannelError, Integers, checked_delivery, promise_of
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
    """Links that may lose or delay packets.

    Attributes
    ----------
    senders : ndarray of int64, shape (L,)
        Column of each link's sender.
    source : ndarray of int64, shape (samples, runs, L)
        Sample whose acceleration is used, -1 where the receiver uses 0.
    factor : ndarray, shape (samples, runs, L)
        What multiplies it.
    """

    senders: Integers
    source: Integers
    factor: Array

    def received(self, sample: int, acceleration: Array) -> Array:
        """Return the accelerations that the receivers use."""
        source = self.source[sample]
        runs = np.arange(len(source))[:, np.newaxis]
        value = self.factor[sample] * acceleration[source, runs, self.senders]
        return np.where(source >= 0, value, 0.0)


class MeanLinks:
    """The mean of all links' random runs, which is a linear system.

    The mean of w a is E[w] a. Where a packet that is due arrives with probability p, a receiver
    that uses zero has p E[w] a in the mean until the next one is due, and one that holds has
    r = p E[w] a + (1 - p) times what it had before, a as it was when the packet was sent: loss and
    noise of a packet are independent of what was received before, see
    docs/theory.md, section 11 (Extensions).

    Parameters
    ----------
    scenario : Scenario
        The run; v2v.channel is left out, noise and loss count as v2v says.
    """

    def __init__(self, scenario: Scenario) -> None:
        followers = scenario.receivers
        self._senders = np.array(scenario.topology.senders)
        arrives = np.array([1.0 - follower.v2v.loss for follower in followers])
        holds = np.array([follower.v2v.reception == "hold" for follower in followers])
        means = [mean_factor(follower) for follower in followers]
        self._factor = arrives * np.array(means)
        self._kept = np.where(holds, 1.0 - arrives, 0.0)
        self._received = np.zeros(len(followers))
        self._due = _due(scenario)

    def received(self, sample: int, acceleration: Array) -> Array:
        """Return the mean accelerations that the receivers use."""
        if self._due is None:
            sent = acceleration[sample].take(self._senders, axis=-1)
        else:
            sent = np.moveaxis(acceleration[self._due[sample], ..., self._senders], 0, -1)
        fresh = self._factor * sent
        used = fresh + self._kept * self._received if self._kept.any() else fresh
        if self._due is not None:
            used = np.where(self._due[sample] >= 0, used, self._received)
        self._received = np.asarray(used, np.float64)
        return self._received


def _due(scenario: Scenario) -> Integers | None:
    """Return which sample's packet is due at each sample, -1 for none; None for its own always."""
    if all(follower.timing().prompt for follower in scenario.receivers):
        return None
    due = np.full((scenario.samples, len(scenario.receivers)), -1)
    for column, follower in enumerate(scenario.receivers):
        packets = follower.timing().delivery(0, scenario.samples)
        due[packets.sample, column] = packets.source
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
    def source(self) -> Integers:
        """Sample whose acceleration is used at each sample, -1 for none, shape (samples,)."""
        return picked(self.delivery.source, self.chosen, -1)

    @property
    def factor(self) -> Array:
        """What multiplies it, shape (samples,)."""
        return picked(self.delivery.factor, self.chosen, 0)

    def arrivals(self, sent: Array) -> Arrivals:
        """Return what arrives when these accelerations [m/s^2] are sent, shape (samples,)."""
        source, sample, factor = self.delivery
        with np.errstate(all="ignore"):  # an unstable platoon overflows
            return Arrivals(source, sample, factor * sent[source])


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
    factor = np.stack([np.stack([plan.factor for plan in run], axis=1) for run in runs], axis=1)
    if all(plan.prompt for run in runs for plan in run):
        return PromptLinks(senders, factor)
    source = np.stack([np.stack([plan.source for plan in run], axis=1) for run in runs], axis=1)
    return ImpairedLinks(senders, source, factor)
