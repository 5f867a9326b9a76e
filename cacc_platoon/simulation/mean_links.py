"""The mean of all links' random runs, sample by sample."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cacc_platoon.model import TriggeredChannel
from cacc_platoon.model.packets import Integers, Packet
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.simulation.trajectory import Array


class MeanLinks:
    """The mean of all links' random runs, which is a linear system.

    The mean of w a is E[w] a. Where a packet that is due arrives with probability p, a receiver
    that uses zero has p E[w] a in the mean until the next one is due, and one that holds has
    r = p E[w] a + (1 - p) times what it had before, a as it was when the packet was sent: loss and
    noise of a packet are independent of what was received before, see
    docs/theory.md, section 11 (Extensions). Where losses come in bursts, that is so given whether
    the time is good or bad: r is the sum of its parts in good and in bad times.

    Where nothing of that is known, packets are nominal, as `nominal` says: they take the mean
    latency, are neither rounded nor cut, are sent as the sender moves in the mean, are of no use
    where one that may be lost overtakes them, and who falls back does so as if blackouts alone lost
    packets and no monitor distrusted them.

    Parameters
    ----------
    scenario : Scenario
        The run; v2v.channel is left out, noise and loss count as v2v says.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._receivers = scenario.receivers
        self._senders = np.array(scenario.topology.senders)
        self._mean = np.array([mean_factor(one) for one in self._receivers])
        stages = _padded([one.stages for one in self._receivers])
        self._losses, self._next = _good_and_bad(self._receivers)
        self._lost = np.stack([_lost(own) for own in stages], axis=-1)
        self._bias = np.stack([_bias(own) for own in stages], axis=-1)
        self._links = np.arange(len(self._receivers))
        self._kept = np.array([float(one.holds) for one in self._receivers])
        self._interval = np.array(
            [np.inf if one.holds else one.longest_interval for one in self._receivers]
        )
        self._due = _due(scenario)
        self._nearest = [own.start for own in scenario.topology.columns]
        self._begin()

    def _begin(self) -> None:
        bursts = any(one.v2v.burst_begin for one in self._receivers)
        self._parts = [np.zeros(len(self._receivers)) for _ in range(2 if bursts else 1)]
        self._triggered = {
            column: TriggeredChannel(one.send_rule(), one.timing(), in_order=one.v2v.in_order)
            for column, one in enumerate(self._receivers)
            if one.triggered
        }
        self._fallbacks = {
            number: self._receivers[column].plain_reception()
            for number, column in enumerate(self._nearest)
            if self._receivers[column].fallback_law()
        }
        self._left = np.zeros(len(self._receivers))
        self._newest = dict.fromkeys(self._triggered, -1)
        self.share: Array | None = None

    def arrivals(self, _run: int, _motion: Array) -> None:
        """Return nothing: in the mean there is no packet."""

    def received(self, sample: int, motion: Array) -> Array:
        """Return the mean accelerations that the receivers use."""
        if sample == 0:
            self._begin()
        due, lost, bias = self._due, self._lost[0], self._bias[0]
        if due is None:
            sent = motion[2, sample].take(self._senders, axis=-1)
        else:
            self._trigger(sample, motion, due)
            sent = np.moveaxis(motion[2][due.carried[sample], ..., self._senders], 0, -1)
            stage = due.stage[sample]
            lost, bias = self._lost[stage, :, self._links].T, self._bias[stage, self._links]
            lost = np.where(due.dark[sample], 1.0, lost)
            self._fall_back(sample, due)
        if bias.any():
            sent = sent + bias
        if due is not None:
            sent = sent * due.factor[sample]
        came = None if due is None else due.carried[sample] >= 0
        if came is not None:
            self._left = np.where(came, self._interval, self._left) - 1.0
        parts = []
        for state, now in enumerate(self._parts):
            before = sum(self._next[last, state] * part for last, part in enumerate(self._parts))
            fresh = (1.0 - lost[state]) * self._mean * self._losses[state] * sent
            used = fresh + lost[state] * self._kept * before
            if came is not None:
                used = np.where(came, used, np.where(self._left >= 0.0, now, 0.0))
            parts.append(used)
        self._parts = parts
        return np.asarray(sum(parts), np.float64)

    def _trigger(self, sample: int, motion: Array, due: _Due) -> None:
        """Put in which packets are due, where the sender sends as it moves in the mean."""
        for column, channel in self._triggered.items():
            position, velocity = motion[:2, sample, 0, self._senders[column]].tolist()
            receiver = self._receivers[column]
            for packet in channel.deliver(sample, position, velocity):
                may_arrive = _may_arrive(receiver, np.array([packet.source]))[0]
                if packet.source > self._newest[column] and (may_arrive or receiver.holds):
                    due.put(sample, column, packet, receiver)
                if may_arrive:
                    self._newest[column] = max(packet.source, self._newest[column])

    def _fall_back(self, sample: int, due: _Due) -> None:
        """Go on with the law's share, as in a run that loses packets in blackouts alone."""
        if not self._fallbacks:
            return
        self.share = np.ones((1, len(self._nearest)))
        for number, reception in self._fallbacks.items():
            column = self._nearest[number]
            comes = due.carried[sample, column] >= 0 and not due.dark[sample, column]
            reception.use([(sample, 0.0)] if comes else [])
            self.share[0, number] = getattr(reception, "share", 1.0)


def _padded(stages: Sequence[Sequence[tuple[int, Follower]]]) -> list[list[Follower]]:
    """Return the stages of every link, as many of each: the last one goes on."""
    most = max(map(len, stages))
    return [[own[min(k, len(own) - 1)][1] for k in range(most)] for own in stages]


def _lost(stages: Sequence[Follower]) -> Array:
    """Return the probabilities of a loss in good and bad times at each stage, shape (S, 2)."""
    return np.array([(one.v2v.loss, one.v2v.burst_loss) for one in stages])


def _bias(stages: Sequence[Follower]) -> Array:
    return np.array([one.v2v.bias for one in stages])


def _good_and_bad(followers: Sequence[Follower]) -> tuple[Array, Array]:
    """Return the shares of good and of bad times, shape (2, L), and what follows what.

    The latter is of shape (2, 2, L): the probability of the second after the first.
    """
    share, follows = [], []
    for follower in followers:
        v2v = follower.v2v
        begin, end = v2v.burst_begin, v2v.burst_end if v2v.burst_begin else 1.0
        bad = begin / (begin + end)
        share.append((1.0 - bad, bad))
        follows.append(((1.0 - begin, begin), (end, 1.0 - end)))
    return np.array(share).T, np.moveaxis(np.array(follows), 0, -1)


class _Due(NamedTuple):
    """Packets that are due in the mean, each of shape (samples, L).

    Which sample's acceleration is in the packet, -1 where none is due, by what false data multiply
    it, whether it is sent in a blackout, and at which stage of the link.
    """

    carried: Integers
    factor: Array
    dark: NDArray[np.bool_]
    stage: Integers

    def put(self, sample: int, column: int, packet: Packet, receiver: Follower) -> None:
        """Put in a packet that is due at a sample."""
        self.carried[sample, column], self.factor[sample, column] = packet.content, packet.factor
        self.dark[sample, column] = any(
            begin <= packet.source < end for begin, end in receiver.blackouts
        )
        self.stage[sample, column] = _stage(receiver, np.array(packet.source))


def _due(scenario: Scenario) -> _Due | None:
    """Return the packets that are due; None where each sample's own is, and arrives or is lost."""
    receivers, samples = scenario.receivers, scenario.samples
    if all(
        one.timing().prompt
        and not (one.v2v.blackouts or one.v2v.false_data or one.triggered or one.stages[1:])
        for one in receivers
    ):
        return None
    shape = samples, len(receivers)
    due = _Due(
        np.full(shape, -1), np.ones(shape), np.zeros(shape, np.bool_), np.zeros(shape, np.int64)
    )
    for column, follower in enumerate(receivers):
        if follower.triggered:
            continue
        packets = follower.timing().delivery(0, samples)
        rows = _used(packets.source, _may_arrive(follower, packets.source), follower.holds)
        packets = packets.pick(rows)
        due.carried[packets.sample, column] = packets.carried
        due.factor[packets.sample, column] = packets.factor
        due.stage[packets.sample, column] = _stage(follower, packets.source)
        for begin, end in follower.blackouts:
            inside = (packets.source >= begin) & (packets.source < end)
            due.dark[packets.sample[inside], column] = True
    return due


def _may_arrive(receiver: Follower, source: Integers) -> NDArray[np.bool_]:
    """Return whether packets that are sent at samples are not lost for certain."""
    certain = np.array([stage.mean_loss >= 1.0 for _, stage in receiver.stages])
    lost = certain[_stage(receiver, source)]
    for begin, end in receiver.blackouts:
        lost = lost | ((source >= begin) & (source < end))
    return ~lost


def _used(source: Integers, may_arrive: NDArray[np.bool_], holds: bool) -> Integers:
    """Return which packets, in the order of delivery, none that may arrive overtakes.

    Those that are lost for certain come first, so that others at the same sample replace them;
    they matter, in bad times of a link, to a receiver that holds alone.
    """
    newest = np.maximum.accumulate(np.where(may_arrive, source, -1))
    kept = source >= newest
    lost = np.flatnonzero(kept & ~may_arrive & holds)
    return np.concatenate((lost, np.flatnonzero(kept & may_arrive)))


def _stage(receiver: Follower, source: Integers) -> Integers:
    """Return at which stage of its link packets are sent."""
    starts = np.array([start for start, _ in receiver.stages])
    return np.searchsorted(starts, source, "right") - 1


def nominal(scenario: Scenario) -> list[str]:
    """Say in what the mean system is not the mean of all random runs.

    Examples
    --------
    >>> nominal(Scenario.from_values({"v2v.loss": 0.1}))
    []
    >>> nominal(Scenario.from_values({"v2v.jitter": 0.1, "v2v.quantum": 0.1}))
    ['packets take the mean latency', 'packets are neither rounded nor cut']
    """
    receivers, followers = scenario.receivers, scenario.followers
    lossy = [one for one in receivers if any(stage.mean_loss for _, stage in one.stages)]
    falls_back = [one for one in followers if one.fallback_law()]
    said = {
        "packets take the mean latency": any(one.v2v.jitter for one in receivers),
        "packets are neither rounded nor cut": any(
            one.v2v.quantum or one.v2v.saturation for one in receivers
        ),
        "packets are sent as the sender moves in the mean": any(one.triggered for one in receivers),
        "packets that others overtake are of no use, although those may be lost": any(
            _latency_falls(one) for one in lossy
        ),
        "lost packets count as zero before the next one is due": any(
            one.triggered and not one.holds for one in lossy
        ),
        "who falls back does so as if blackouts alone lost packets": any(
            one.triggered or one.v2v.jitter or one.index in {other.index for other in lossy}
            for one in falls_back
        ),
        "no monitor distrusts packets": any(one.v2v.monitor == "fallback" for one in falls_back),
        "limits act on the mean motion": any(
            one.limits() is not None or one.stops for one in followers
        ),
    }
    return [what for what, applies in said.items() if applies]


def _latency_falls(receiver: Follower) -> bool:
    latencies = [stage.latency_steps for _, stage in receiver.stages]
    return not receiver.v2v.in_order and bool((np.diff(latencies) < 0).any())


def mean_factor(follower: Follower) -> float:
    """Return E[w] of the link to a follower."""
    kind = "expected" if follower.v2v.noise == "bits" else follower.v2v.noise
    return float(follower.noise(kind).factors(0, 1)[0])
