"""What packets say: the paper's noise, errors of the sender, and false data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cacc_platoon.model.keyed_random import ERROR, keyed_normal
from cacc_platoon.model.noise import Noise
from cacc_platoon.model.packets import Packets


class ContentNoise:
    """Multiplies every packet by the noise factor of its source sample."""

    prompt = True
    longest_delay = 0

    def __init__(self, noise: Noise) -> None:
        self._noise = noise

    def apply(self, packets: Packets) -> Packets:
        """Return the packets with their factors multiplied."""
        if not len(packets.source):
            return packets
        first = int(packets.source[0])
        factors = self._noise.factors(first, int(packets.source[-1]) + 1)
        return packets._replace(factor=packets.factor * factors[packets.source - first])


class AdditiveNoise:
    """Adds to every acceleration, before it is sent, a bias and noise of its own.

    Parameters
    ----------
    std : float
        Standard deviation of the noise [m/s^2], >= 0; see `keyed_normal`.
    bias : float
        What is added to all [m/s^2].
    seed : int
        Seed of the run.
    link : int
        Index i of the receiving vehicle; links are independent of each other.

    Examples
    --------
    >>> from cacc_platoon.model import ComposedChannel
    >>> channel = ComposedChannel([AdditiveNoise(0.0, 0.2, seed=1, link=1)])
    >>> channel.delivery(0, 2).values(np.array([1.0, 1.5])).tolist()
    [1.2, 1.7]
    """

    prompt = True
    longest_delay = 0

    def __init__(self, std: float, bias: float, seed: int, link: int) -> None:
        self._std, self._bias = std, bias
        self._draws = keyed_normal(seed, link, ERROR)

    def apply(self, packets: Packets) -> Packets:
        """Return the packets with their errors."""
        if not len(packets.number):
            return packets
        error = np.full(len(packets.number), self._bias)
        if self._std:
            first, last = int(packets.number[0]), int(packets.number[-1])
            drawn = self._draws(first, last + 1)
            error += self._std * drawn[packets.number - first]
        return packets._replace(offset=packets.offset + error)


class Forgery(NamedTuple):
    """Packets whose content is false, from one time to another.

    Attributes
    ----------
    begin, end : int
        First sample whose packet is false, and the first after it whose packet is true again.
    factor : float
        What multiplies what they say.
    older : int
        By how many samples what they carry is older than they are.
    frozen : bool
        Whether all carry what the first of them does.
    """

    begin: int
    end: int
    factor: float = 1.0
    older: int = 0
    frozen: bool = False

    @property
    def oldest_content(self) -> int:
        """The most samples by which what a packet carries is older than the packet."""
        return self.end - self.begin - 1 if self.frozen else min(self.older, self.end - 1)


class FalseData:
    """Puts false data into packets: multiplied, replayed or frozen.

    Parameters
    ----------
    forgeries : sequence of Forgery
        When, and what is false; they do not overlap.

    Examples
    --------
    >>> from cacc_platoon.model import ComposedChannel
    >>> channel = ComposedChannel([FalseData([Forgery(2, 4, frozen=True)])])
    >>> channel.delivery(0, 5).carried.tolist()
    [0, 1, 2, 2, 4]
    """

    prompt = True
    longest_delay = 0

    def __init__(self, forgeries: Sequence[Forgery]) -> None:
        self._forgeries = tuple(forgeries)
        self.oldest_content = max((one.oldest_content for one in forgeries), default=0)

    def apply(self, packets: Packets) -> Packets:
        """Return the packets, some of them false."""
        content, factor = packets.content.copy(), packets.factor.copy()
        for one in self._forgeries:
            false = (packets.source >= one.begin) & (packets.source < one.end)
            factor[false] *= one.factor
            content[false] = one.begin if one.frozen else content[false] - one.older
        return packets._replace(content=np.maximum(content, 0), factor=factor)
