"""What becomes of packets on a V2V link: impairments, composed into a channel.

A sender's packets are numbered p = 0, 1, 2, ... An impairment is a pure function from packets to
packets, keyed by seed, link and p, so that any slice of packets equals that slice of the whole.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from cacc_platoon.errors import UserError
from cacc_platoon.model.keyed_random import BLOCK
from cacc_platoon.model.noise import Noise

Integers: TypeAlias = npt.NDArray[np.int64]
Floats: TypeAlias = npt.NDArray[np.float64]


class Packets(NamedTuple):
    """Consecutive packets of one link; arrays of one length.

    Attributes
    ----------
    number : ndarray of int64
        p.
    source : ndarray of int64
        Sample whose acceleration the packet carries.
    factor : ndarray
        What multiplies it.
    arrives : ndarray of bool
        Whether the packet arrives at all.
    delay : ndarray of int64
        Samples from its source to its delivery, >= 0.
    """

    number: Integers
    source: Integers
    factor: Floats
    arrives: npt.NDArray[np.bool_]
    delay: Integers


class Impairment(Protocol):
    """One thing that happens to packets."""

    @property
    def prompt(self) -> bool:
        """Whether it neither loses nor delays any packet."""
        ...

    @property
    def longest_delay(self) -> int:
        """The most samples by which it delays a packet."""
        ...

    def apply(self, packets: Packets) -> Packets:
        """Return the packets as they are afterwards."""
        ...


class Delivery(NamedTuple):
    """Packets in the order in which a receiver gets them; arrays of one length.

    Attributes
    ----------
    source : ndarray of int64
        Sample whose acceleration each packet carries.
    sample : ndarray of int64
        Receiver's sample at which it is delivered.
    factor : ndarray
        What multiplies the acceleration.
    """

    source: Integers
    sample: Integers
    factor: Floats


class Channel(Protocol):
    """One V2V link; replace it to study another one.

    It is asked for the samples of the run alone, block after block, and may be asked again.
    """

    @property
    def prompt(self) -> bool:
        """Whether every sample's packet is delivered at that sample, and no other."""
        ...

    @property
    def longest_delay(self) -> int:
        """The most samples from a packet's source to its delivery."""
        ...

    def delivery(self, start: int, stop: int) -> Delivery:
        """Return the packets delivered at the receiver's samples start..stop-1."""
        ...


class ChannelError(UserError):
    """A channel that does not keep what it says of itself."""


class Promise(NamedTuple):
    """What a channel says of itself; see `Channel`."""

    prompt: bool
    longest_delay: int


def promise_of(channel: Channel) -> Promise:
    """Return what a channel, which may be anybody's, says of itself.

    Raises
    ------
    ChannelError
        When `prompt` is no truth value or `longest_delay` no whole number >= 0.
    """
    try:
        prompt, longest = channel.prompt, channel.longest_delay
    except (Exception, SystemExit) as error:  # a custom channel may fail in any way
        raise _raised(error) from error
    if not isinstance(prompt, bool | np.bool_):
        raise ChannelError(f"its prompt is {prompt!r}, neither True nor False")
    whole = isinstance(longest, int | np.integer) and not isinstance(longest, bool)
    if not whole or longest < 0:
        raise ChannelError(f"its longest_delay is {longest!r}, no whole number >= 0")
    return Promise(bool(prompt), int(longest))


def checked_delivery(channel: Channel, start: int, stop: int) -> Delivery:
    """Return the packets delivered at the samples start..stop-1 of a channel that may be anybody's.

    Raises
    ------
    ChannelError
        When a packet is delivered outside of them, before it was sent, later than
        `longest_delay` or out of order, when a factor is not finite, or when a prompt channel
        loses a packet.
    """
    prompt, longest_delay = promise_of(channel)
    try:
        parts = [np.asarray(part) for part in channel.delivery(start, stop)]
    except (Exception, SystemExit) as error:  # a custom channel may fail in any way
        raise _raised(error) from error
    source, sample, factor = _arrays(parts)
    asked = f"samples {start} to {stop - 1}"
    late = sample - source
    wrong = (sample < start) | (sample >= stop) | (source < 0)
    wrong |= (late < 0) | (late > longest_delay)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise ChannelError(
            f"it delivers the packet of sample {source[row]} at sample {sample[row]} where "
            f"{asked} were asked for and longest_delay is {longest_delay}"
        )
    if (np.diff(sample) < 0).any():
        raise ChannelError(f"its deliveries of {asked} are out of order")
    if prompt and not np.array_equal(source, np.arange(start, stop)):
        raise ChannelError(
            f"it says that it is prompt and delivers {len(source)} packets at {asked}"
        )
    if not np.isfinite(factor).all():
        row = int(np.flatnonzero(~np.isfinite(factor))[0])
        raise ChannelError(f"its factor of the packet of sample {source[row]} is {factor[row]}")
    return Delivery(source, sample, factor)


def _arrays(parts: Sequence[npt.NDArray[Any]]) -> Delivery:
    """Return source, sample and factor of a delivery as arrays of their types."""
    if len(parts) != len(Delivery._fields):
        raise ChannelError("its delivery is not source, sample and factor")
    for part, name, kinds in zip(parts, Delivery._fields, ("iu", "iu", "iuf"), strict=True):
        if part.ndim != 1 or (part.size and part.dtype.kind not in kinds):
            numbers = "whole numbers" if kinds == "iu" else "numbers"
            raise ChannelError(
                f"{name} of its delivery is {part.dtype} of shape {part.shape}, not a list of "
                f"{numbers}"
            )
    source, sample, factor = parts
    if not len(source) == len(sample) == len(factor):
        raise ChannelError("source, sample and factor of its delivery differ in length")
    return Delivery(source.astype(np.int64), sample.astype(np.int64), factor.astype(np.float64))


def _raised(error: BaseException) -> ChannelError:
    return ChannelError(f"it raised {type(error).__name__}: {' '.join(str(error).split())}")


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


class ConstantLatency:
    """Delays every packet by the same number of samples.

    Parameters
    ----------
    samples : int
        How many, >= 0.

    Examples
    --------
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


class SendTimes(NamedTuple):
    """At which samples a packet is sent: `phase`, `phase + interval`, and so on.

    Examples
    --------
    >>> SendTimes(interval=10, phase=3).between(0, 30).tolist()
    [3, 13, 23]
    """

    interval: int = 1
    phase: int = 0

    def between(self, start: int, stop: int) -> Integers:
        """Return the samples start..stop-1 at which a packet is sent."""
        first = max(0, -(-(start - self.phase) // self.interval))
        return np.arange(self.phase + first * self.interval, stop, self.interval, dtype=np.int64)

    def number(self, source: Integers) -> Integers:
        """Return the numbers p of the packets that are sent at these samples."""
        return (source - self.phase) // self.interval


EVERY_SAMPLE = SendTimes()


class ComposedChannel:
    """Packets, one every sample unless send times say otherwise, and impairments in their order.

    Examples
    --------
    >>> channel = ComposedChannel([])
    >>> channel.prompt, channel.delivery(5, 8).source.tolist()
    (True, [5, 6, 7])
    >>> ComposedChannel([], SendTimes(interval=10)).delivery(5, 25).source.tolist()
    [10, 20]
    """

    def __init__(
        self, impairments: Sequence[Impairment], send_times: SendTimes = EVERY_SAMPLE
    ) -> None:
        self._impairments, self._send_times = tuple(impairments), send_times
        prompt = all(impairment.prompt for impairment in self._impairments)
        self.prompt = prompt and send_times == EVERY_SAMPLE
        self.longest_delay = sum(impairment.longest_delay for impairment in self._impairments)

    def delivery(self, start: int, stop: int) -> Delivery:
        """Return the packets delivered at the receiver's samples start..stop-1."""
        source = self._send_times.between(max(0, start - self.longest_delay), stop)
        number = self._send_times.number(source)
        packets = Packets(
            number,
            source,
            np.ones(len(number)),
            np.ones(len(number), np.bool_),
            np.zeros(len(number), np.int64),
        )
        for impairment in self._impairments:
            packets = impairment.apply(packets)
        sample = packets.source + packets.delay
        rows = np.flatnonzero(packets.arrives & (sample >= start) & (sample < stop))
        rows = rows[np.argsort(sample[rows], kind="stable")]
        return Delivery(packets.source[rows], sample[rows], packets.factor[rows])


def packets_by_sample(channel: Channel, samples: int) -> Iterator[list[tuple[int, float]]]:
    """Yield source sample and factor of the packets delivered at each sample of a run, from 0 on.

    The channel is asked for a block at a time, and held to what it promises.

    Examples
    --------
    >>> list(packets_by_sample(ComposedChannel([]), samples=2))
    [[(0, 1.0)], [(1, 1.0)]]
    """
    for start in range(0, samples, BLOCK):
        stop = min(start + BLOCK, samples)
        source, sample, factor = checked_delivery(channel, start, stop)
        packets = list(zip(source.tolist(), factor.tolist(), strict=True))
        ends = np.searchsorted(sample, np.arange(start, stop + 1)).tolist()
        for begin, end in pairwise(ends):
            yield packets[begin:end]
