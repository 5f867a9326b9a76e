"""What every follower receives, in arrays: the V2V links of a whole platoon, sample by sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from cacc_platoon.model import Channel, ChoosingReception, Delivery
from cacc_platoon.model.channel import ChannelError, checked_delivery, promise_of
from cacc_platoon.model.packets import EVERY_VALUE, Integers, said
from cacc_platoon.model.reception import picked
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.simulation.trajectory import Array, Arrivals

ChannelFactory = Callable[[Follower], Channel]


class Links(Protocol):
    """The L V2V links of runs that are integrated together, in the order of the topology."""

    def received(self, sample: int, motion: Array) -> Array:
        """Return what is used of every link at a sample [m/s^2], shape (runs, L).

        Parameters
        ----------
        sample : int
            The sample, asked for in order; with 0 they begin anew.
        motion : ndarray, shape (3, samples, runs, N + 1)
            Positions [m], velocities [m/s] and accelerations [m/s^2], known up to the sample.
        """
        ...

    def arrivals(self, run: int, motion: Array) -> tuple[Arrivals, ...] | None:
        """Return what arrives in a run over each link, None where all is used when it is sent."""
        ...

    @property
    def share(self) -> Array | None:
        """Of the laws in the commands at the sample, (runs, N); None where all is theirs."""
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

    @property
    def share(self) -> None:
        """Nobody falls back where every packet arrives."""

    def arrivals(self, _run: int, _motion: Array) -> None:
        """Return that every packet is used at the sample it is sent at."""

    def received(self, sample: int, motion: Array) -> Array:
        """Return w a_j of the sample, j being the sender."""
        used: Array = self.factor[sample] * motion[2, sample].take(self.senders, axis=-1)
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
    plans : sequence of sequence of LinkPlan
        The links of each run.
    """

    senders: Integers
    carried: Integers
    factor: Array
    offset: Array | None
    plans: Sequence[Sequence[LinkPlan]]

    @property
    def share(self) -> None:
        """Nobody here falls back."""

    def arrivals(self, run: int, motion: Array) -> tuple[Arrivals, ...]:
        """Return what arrives in a run over each link."""
        return tuple(
            plan.arrivals(motion[2, :, run, sender])
            for plan, sender in zip(self.plans[run], self.senders, strict=True)
        )

    def received(self, sample: int, motion: Array) -> Array:
        """Return the accelerations that the receivers use."""
        carried = self.carried[sample]
        runs = np.arange(len(carried))[:, np.newaxis]
        sent = motion[2][carried, runs, self.senders]
        if self.offset is not None:
            sent = said(sent, self.offset[sample], EVERY_VALUE)
        for column, plan in enumerate(self.plans[0]):
            lattice = plan.delivery.lattice
            if lattice != EVERY_VALUE:
                sent[:, column] = lattice.nearest(sent[:, column])
        return np.where(carried >= 0, self.factor[sample] * sent, 0.0)


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


def planned(follower: Follower, channel: Channel | None = None) -> bool:
    """Return whether it is known beforehand which packet is used at each sample of a link.

    It is not where the sender sends as it moves, nor where the receiver does something else than to
    choose a packet of those that come, or watches them.
    """
    if follower.monitored or (channel is None and follower.triggered):
        return False
    if isinstance(follower.reception(), ChoosingReception):
        return True
    return not follower.asks_own_code and promise_of(channel or follower.channel()).prompt


def plan_link(follower: Follower, samples: int, channel: Channel) -> LinkPlan:
    """Return what the link to a follower does from sample 0 on, where that is `planned`."""
    delivery = delivery_of(follower, samples, channel)
    if promise_of(channel).prompt and not follower.asks_own_code:
        return LinkPlan(True, delivery, np.arange(samples))
    reception = follower.reception()
    assert isinstance(reception, ChoosingReception)
    return LinkPlan(False, delivery, reception.chosen(delivery, samples))


def delivery_of(follower: Follower, samples: int, channel: Channel) -> Delivery:
    """Return what the channel of a link, which may be anybody's, delivers in a run."""
    try:
        return checked_delivery(channel, 0, samples)
    except ChannelError as error:
        raise ChannelError(
            f"the channel of vehicle {follower.index}: {error}. Correct it."
        ) from error


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


def links_of(senders: Sequence[int], runs: Sequence[Sequence[LinkPlan]]) -> Links:
    """Return the links of several runs of one platoon, to integrate them together.

    Parameters
    ----------
    senders : sequence of int
        Column of each link's sender.
    runs : sequence of sequence of LinkPlan
        The plan of every link, of each run.
    """
    plans = [plan for run in runs for plan in run]

    def stacked(of: Callable[[LinkPlan], NDArray[Any]]) -> NDArray[Any]:
        return np.stack([np.stack([of(plan) for plan in run], axis=1) for run in runs], axis=1)

    factor = stacked(lambda plan: plan.factor)
    if all(plan.exact for plan in plans):
        return PromptLinks(np.array(senders), factor)
    added = any(plan.delivery.offset is not None for plan in plans)
    return ImpairedLinks(
        np.array(senders),
        stacked(lambda plan: plan.carried),
        factor,
        stacked(lambda plan: plan.offset) if added else None,
        runs,
    )
