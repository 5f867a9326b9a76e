"""How long packets take: a time for all, or one drawn for each."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from cacc_platoon.model.keyed_random import DELAY, keyed_uniform
from cacc_platoon.model.packets import Packets

_REST = 1e-9
"""Probability beyond which a delay that has no largest value is cut off."""


class ConstantLatency:
    """Delays every packet by the same number of samples.

    Parameters
    ----------
    samples : int
        How many, >= 0.

    Examples
    --------
    >>> from cacc_platoon.model import ComposedChannel
    >>> channel = ComposedChannel([ConstantLatency(2)])
    >>> delivery = channel.delivery(0, 5)
    >>> delivery.source.tolist(), delivery.sample.tolist()
    ([0, 1, 2], [2, 3, 4])
    """

    def __init__(self, samples: int) -> None:
        self.longest_delay = samples
        self.prompt = samples == 0

    def apply(self, packets: Packets) -> Packets:
        """Return the packets, later."""
        return packets._replace(delay=packets.delay + self.longest_delay)


class RandomLatency:
    """Delays each packet by a number of samples of its own, so that one may overtake another.

    Parameters
    ----------
    chances : sequence of float
        Probability of each number of samples 0, 1, ..., which sum to 1.
    seed : int
        Seed of the run.
    link : int
        Index i of the receiving vehicle; links are independent of each other.

    Examples
    --------
    >>> from cacc_platoon.model import ComposedChannel
    >>> late = RandomLatency([0.5, 0.25, 0.25], seed=1, link=1)
    >>> late.mean_delay, late.longest_delay
    (0.75, 2)
    >>> sorted(ComposedChannel([late]).delivery(0, 5).source.tolist())
    [0, 1, 2, 4]
    """

    prompt = False

    def __init__(self, chances: Sequence[float], seed: int, link: int) -> None:
        self._until = np.cumsum(np.asarray(chances, np.float64))[:-1]
        self._draws = keyed_uniform(seed, link, DELAY)
        self.longest_delay = len(chances) - 1
        self.mean_delay = float(np.dot(np.arange(len(chances)), chances))

    def apply(self, packets: Packets) -> Packets:
        """Return the packets, later."""
        if not len(packets.number):
            return packets
        first, last = int(packets.number[0]), int(packets.number[-1])
        draws = self._draws(first, last + 1)
        late = np.searchsorted(self._until, draws[packets.number - first], side="right")
        return packets._replace(delay=packets.delay + late)


class InOrder:
    """Lets no packet overtake another: each waits for those that were sent before it and arrive.

    Parameters
    ----------
    longest_delay : int
        The most samples by which packets are delayed before; packets are looked at from so much
        earlier on.

    Examples
    --------
    >>> from cacc_platoon.model import ComposedChannel
    >>> late = RandomLatency([0.5, 0.25, 0.25], seed=1, link=1)
    >>> source = ComposedChannel([late, InOrder(2)]).delivery(0, 1000).source
    >>> bool((np.diff(source) > 0).all())
    True
    """

    prompt = True

    def __init__(self, longest_delay: int) -> None:
        self.longest_delay = longest_delay

    def apply(self, packets: Packets) -> Packets:
        """Return the packets, those later that would overtake others."""
        at = np.where(packets.arrives, packets.source + packets.delay, -1)
        delay = np.maximum.accumulate(at) - packets.source
        return packets._replace(delay=np.where(packets.arrives, delay, packets.delay))


def uniform_delay(least: float, spread: float, step: float) -> list[float]:
    """Return the probability of each number of control periods of a delay, rounded up.

    Parameters
    ----------
    least : float
        Least delay [s].
    spread : float
        How much more it is at most [s], > 0; all in between are equally probable.
    step : float
        Control period [s].

    Examples
    --------
    >>> uniform_delay(0.01, 0.02, step=0.01)
    [0.0, 0.0, 0.5, 0.5]
    """
    return _rounded_up(lambda time: min(max((time - least) / spread, 0.0), 1.0), step)


def gamma_delay(least: float, mean: float, shape: int, step: float) -> list[float]:
    """Return the probability of each number of control periods of a delay, rounded up.

    Parameters
    ----------
    least : float
        Least delay [s].
    mean : float
        Mean of what is added to it [s], > 0, gamma distributed.
    shape : int
        Shape of the gamma distribution, >= 1: 1 is the exponential one.
    step : float
        Control period [s].

    Examples
    --------
    >>> sum(gamma_delay(0.0, 0.02, 2, step=0.01)[1:3])
    0.5939941502901619
    """

    def below(time: float) -> float:
        x = shape * (time - least) / mean
        if x <= 0.0:
            return 0.0
        rest = sum(math.exp(i * math.log(x) - x - math.lgamma(i + 1)) for i in range(shape))
        return 1.0 - rest

    return _rounded_up(below, step)


def _rounded_up(below: Callable[[float], float], step: float) -> list[float]:
    """Return the probability of each number of steps, of a time of given distribution."""
    reached = [below(0.0)]
    while 1.0 - reached[-1] > _REST:
        reached.append(below(len(reached) * step))
    reached[-1] = 1.0
    return np.diff(reached, prepend=0.0).tolist()
