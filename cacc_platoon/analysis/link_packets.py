"""What became of every packet: lost, late, overtaken, in bursts, over each link."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cacc_platoon.analysis.dropped import delivered_as_zero
from cacc_platoon.model.packets import Integers
from cacc_platoon.model.reception import not_overtaken
from cacc_platoon.scenario import Follower
from cacc_platoon.simulation import Arrivals, Trajectory
from cacc_platoon.simulation.trajectory import Array
from cacc_platoon.stepping.wall import CLOCK_MARGIN

Flags = npt.NDArray[np.bool_]

_BINS, _SHORTEST = 100, 1.0
"""Over time: so many bins, none shorter than this [s] but for those of a run of a few seconds."""


class Bursts(NamedTuple):
    """Losses of consecutive packets.

    Attributes
    ----------
    number : int
        How often some packet was lost after one that arrived.
    longest : int
        The most consecutive packets lost.
    mean : float
        How many were lost at a time in the mean, NaN where none was.
    """

    number: int
    longest: int
    mean: float


class LinkPackets(NamedTuple):
    """The packets of one link of which it is known what became, in the order of sending.

    They are those that are known to have been sent, early enough to arrive within the run; over a
    link that neither loses nor delays, as far as it is recorded.

    Attributes
    ----------
    sender, follower : int
        Index of the sender, and of the receiver.
    source : ndarray of int64
        Sample at which each was sent.
    sample : ndarray of int64
        Sample at which it was delivered, -1 where it was lost.
    overtaken : ndarray of bool
        Whether a packet that was sent later was delivered before it, so that it was of no use.
    dark : ndarray of bool
        Whether it was sent in a blackout.
    """

    sender: int
    follower: int
    source: Integers
    sample: Integers
    overtaken: Flags
    dark: Flags

    @property
    def lost(self) -> Flags:
        """Whether each was lost."""
        return self.sample < 0

    @property
    def late(self) -> Flags:
        """Whether each was delivered after the sample at which it was sent."""
        return self.sample > self.source

    @property
    def bursts(self) -> Bursts:
        """Losses of consecutive packets outside of blackouts, which end a burst."""
        lost = self.lost & ~self.dark
        turns = np.flatnonzero(np.diff(lost, prepend=False, append=False))
        lengths = turns[1::2] - turns[::2]
        if not lengths.size:
            return Bursts(0, 0, math.nan)
        return Bursts(len(lengths), int(np.max(lengths)), float(np.mean(lengths)))


class PacketsOverTime(NamedTuple):
    """The packets of all links, counted by when they were sent.

    Attributes
    ----------
    edges : ndarray, shape (bins + 1,)
        Where bins begin and end [s].
    sent, lost : ndarray of int64, shape (links, bins)
        Packets sent, and those of them that were lost, in blackouts too.
    delay : ndarray, shape (links, bins)
        From sending to delivery in the mean over those that arrived [s], NaN where none did.
    """

    edges: Array
    sent: Integers
    lost: Integers
    delay: Array


def arrived_over(run: Trajectory) -> list[Arrivals]:
    """Return what arrived over each link, in the order of the topology.

    Zeros that stand for lost packets are left out; over a link that neither loses nor delays,
    everything that is recorded arrived at once.
    """
    dropped = delivered_as_zero(run)
    found = []
    for column, receiver in enumerate(run.scenario.receivers):
        if run.arrivals is None or not receiver.counted:
            known = np.isfinite(run.sent[:, column]) & np.isfinite(run.received[:, column])
            sample = np.flatnonzero(known)
            found.append(Arrivals(sample, sample, run.received[sample, column]))
        else:
            source, at, value = run.arrivals[column]
            kept = ~dropped[source, column]
            found.append(Arrivals(source[kept], at[kept], value[kept]))
    return found


def link_packets(run: Trajectory) -> list[LinkPackets]:
    """Return what became of the packets of every link, in the order of the topology.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> from cacc_platoon.simulation import simulate
    >>> late = {"v2v.period": 0.1, "v2v.latency": 0.03, "run.duration": 0.3, "leader.start": 0.0}
    >>> packets = link_packets(simulate(Scenario.from_values(late)))[0]
    >>> packets.source.tolist(), packets.sample.tolist()
    ([0, 10, 20], [3, 13, 23])
    """
    return [
        _of_link(run, receiver, column, arrivals)
        for column, (receiver, arrivals) in enumerate(
            zip(run.scenario.receivers, arrived_over(run), strict=True)
        )
    ]


def packets_over_time(run: Trajectory) -> PacketsOverTime:
    """Return how many packets of each link were sent and lost, and how late they were, over time.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> from cacc_platoon.simulation import simulate
    >>> lossy = {"v2v.period": 0.1, "v2v.loss": 1.0, "run.duration": 20.0}
    >>> found = packets_over_time(simulate(Scenario.from_values(lossy)))
    >>> found.sent[0].tolist() == found.lost[0].tolist() == [10] * 19 + [11]
    True
    """
    step, duration = run.scenario.run.step, run.scenario.run.duration
    width = max(duration / _BINS, min(_SHORTEST, duration / 20.0))
    bins = max(1, math.ceil(duration / width - 1e-9))
    edges = np.linspace(0.0, duration, bins + 1)
    shape = len(run.scenario.receivers), bins
    sent, lost, delay = np.zeros(shape, np.int64), np.zeros(shape, np.int64), np.zeros(shape)
    for row, packets in enumerate(link_packets(run)):
        at = np.minimum(packets.source * bins // max(run.scenario.samples - 1, 1), bins - 1)
        sent[row] = np.bincount(at, minlength=bins)
        lost[row] = np.bincount(at[packets.lost], minlength=bins)
        took = np.where(packets.lost, 0, packets.sample - packets.source) * step
        delay[row] = np.bincount(at, took, minlength=bins)
    arrived = sent - lost
    mean = np.full(shape, np.nan)
    np.divide(delay, arrived, out=mean, where=arrived > 0)
    return PacketsOverTime(edges, sent, lost, mean)


def _of_link(run: Trajectory, receiver: Follower, column: int, arrivals: Arrivals) -> LinkPackets:
    samples = len(run.received)
    known = np.isfinite(run.sent[:, column])
    if not receiver.v2v.channel:
        due = np.zeros(samples, np.bool_)
        due[_sent_at(run, receiver, column, samples)] = True
        known &= due & (_arrives_by(receiver, samples) < samples)
    if run.arrivals is None or not receiver.counted:
        known &= np.isfinite(run.received[:, column])
    if run.scenario.clocked:  # what came after the last sample is neither lost nor here
        under_way = samples - round(CLOCK_MARGIN / run.scenario.run.step)
        known[max(0, under_way, np.max(arrivals.source, initial=-1) + 1) :] = False
    delivered = np.full(samples, samples)
    np.minimum.at(delivered, arrivals.source, arrivals.sample)
    overtaken = delivered < samples
    overtaken[arrivals.source[not_overtaken(arrivals.source)]] = False
    dark = np.zeros(samples, np.bool_)
    for begin, end in receiver.blackouts if not receiver.v2v.channel else ():
        dark[begin:end] = True
    source = np.flatnonzero(known)
    return LinkPackets(
        *receiver.link,
        source,
        np.where(delivered < samples, delivered, -1)[source],
        overtaken[source],
        dark[source],
    )


def _arrives_by(receiver: Follower, samples: int) -> Integers:
    """Return by when a packet that is sent at each sample arrives, unless it is lost."""
    starts, stages = zip(*receiver.stages, strict=True)
    late = np.array([stage.longest_stage_latency_steps for stage in stages])
    source = np.arange(samples)
    by = source + late[np.searchsorted(starts, source, "right") - 1]
    return np.maximum.accumulate(by) if receiver.v2v.in_order else by


def _sent_at(run: Trajectory, receiver: Follower, column: int, stop: int) -> Integers:
    """Return the samples before `stop` at which a packet is sent over a link."""
    if not receiver.triggered:
        return receiver.send_times.between(0, stop)
    rule, sender = receiver.send_rule(), run.scenario.topology.senders[column]
    motion = zip(run.position[:, sender].tolist(), run.velocity[:, sender].tolist(), strict=True)
    sends = [rule.sends(k, *state) for k, state in enumerate(motion)]
    return np.flatnonzero(sends[: max(stop, 0)])
