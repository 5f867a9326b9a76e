"""Packets that are lost: independently of each other, in bursts, or in given times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from cacc_platoon.model.keyed_random import BLOCK, BURST, LOSS, keyed_uniform
from cacc_platoon.model.packets import Packets


class IndependentLoss:
    """Loses each packet with one probability, whatever happens to the others.

    Parameters
    ----------
    probability : float
        That a packet is lost, 0 to 1.
    seed : int
        Seed of the run.
    link : int
        Index i of the receiving vehicle; links are independent of each other.

    Examples
    --------
    >>> from cacc_platoon.model import ComposedChannel
    >>> channel = ComposedChannel([IndependentLoss(0.5, seed=1, link=1)])
    >>> bool(0.4 < len(channel.delivery(0, 1000).sample) / 1000 < 0.6)
    True
    """

    prompt = False
    longest_delay = 0

    def __init__(self, probability: float, seed: int, link: int) -> None:
        self._probability = probability
        self._draws = keyed_uniform(seed, link, LOSS)

    def apply(self, packets: Packets) -> Packets:
        """Return the packets, those that are lost marked."""
        if not len(packets.number):
            return packets
        first, last = int(packets.number[0]), int(packets.number[-1])
        draws = self._draws(first, last + 1)
        kept = draws[packets.number - first] >= self._probability
        return packets._replace(arrives=packets.arrives & kept)


class BurstLoss:
    """Loses packets in bursts: the channel of Gilbert and Elliott, good or bad packet by packet.

    E. N. Gilbert, Bell System Technical Journal 39 (1960) 1253-1265; E. O. Elliott, ibid. 42 (1963)
    1977-1997. It begins in its stationary law.

    Parameters
    ----------
    begin, end : float
        Probabilities, from one packet to the next, that a bad time begins and that it ends, the
        latter above 0.
    good, bad : float
        Probabilities that a packet is lost in a good and in a bad time.
    seed : int
        Seed of the run.
    link : int
        Index i of the receiving vehicle; links are independent of each other.

    Examples
    --------
    >>> burst = BurstLoss(0.3, 0.3, 0.0, 0.95, seed=1, link=1)
    >>> round(burst.mean_loss, 3)
    0.475
    """

    prompt = False
    longest_delay = 0

    def __init__(
        self, begin: float, end: float, good: float, bad: float, *, seed: int, link: int
    ) -> None:
        self._begin, self._end, self._good, self._bad = begin, end, good, bad
        self._turns = keyed_uniform(seed, link, BURST)
        self._draws = keyed_uniform(seed, link, LOSS)

    @property
    def bad_share(self) -> float:
        """Share of packets in bad times."""
        return self._begin / (self._begin + self._end)

    @property
    def mean_loss(self) -> float:
        """Share of packets lost."""
        return self._good + self.bad_share * (self._bad - self._good)

    @property
    def loss_variance(self) -> float:
        """Variance of the number of losses among many packets, per packet."""
        p, memory = self.mean_loss, 1.0 - self._begin - self._end
        together = self.bad_share * (1.0 - self.bad_share) * (self._bad - self._good) ** 2
        return p * (1.0 - p) + 2.0 * together * memory / (1.0 - memory)

    def is_bad(self, start: int, stop: int) -> npt.NDArray[np.bool_]:
        """Return whether packets start..stop-1 are in a bad time.

        One number u is drawn a packet: it is bad if u is below the probability that a bad one
        follows the one before. Where u is below both probabilities or above both, that does not
        matter; from the last such packet on everything follows.
        """
        stays = 1.0 - self._end
        low, high = min(self._begin, stays), max(self._begin, stays)
        first = start
        while True:
            draws = self._turns(first, stop)
            known = (draws < low) | (draws >= high)
            if first == 0:
                known[:1] = True
            if known[: start - first + 1].any() or first == 0:
                break
            first = max(0, first - BLOCK)
        bad = draws < low
        if first == 0 and len(bad):
            bad[0] = draws[0] < self.bad_share
        number = np.arange(len(draws))
        since = np.maximum.accumulate(np.where(known, number, 0))
        turned = (
            (number - since) % 2 == 1 if self._begin > stays else np.zeros(len(draws), np.bool_)
        )
        return np.asarray((bad[since] ^ turned)[start - first :], np.bool_)

    def apply(self, packets: Packets) -> Packets:
        """Return the packets, those that are lost marked."""
        if not len(packets.number):
            return packets
        first, stop = int(packets.number[0]), int(packets.number[-1]) + 1
        rows = packets.number - first
        probability = np.where(self.is_bad(first, stop), self._bad, self._good)
        kept = self._draws(first, stop) >= probability
        return packets._replace(arrives=packets.arrives & kept[rows])


class Blackouts:
    """Loses every packet that is sent within given times.

    Parameters
    ----------
    intervals : sequence of (int, int)
        First sample of each blackout, and the first one after it.

    Examples
    --------
    >>> from cacc_platoon.model import ComposedChannel
    >>> ComposedChannel([Blackouts([(1, 3)])]).delivery(0, 5).source.tolist()
    [0, 3, 4]
    """

    prompt = False
    longest_delay = 0

    def __init__(self, intervals: Sequence[tuple[int, int]]) -> None:
        self._intervals = tuple(intervals)

    def apply(self, packets: Packets) -> Packets:
        """Return the packets, those that are lost marked."""
        dark = np.zeros(len(packets.source), np.bool_)
        for begin, end in self._intervals:
            dark |= (packets.source >= begin) & (packets.source < end)
        return packets._replace(arrives=packets.arrives & ~dark)
