"""A V2V link: packets and what happens to them, delivered to a receiver sample by sample."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from cacc_platoon.errors import UserError
from cacc_platoon.model.keyed_random import BLOCK
from cacc_platoon.model.packets import (
    EVERY_SAMPLE,
    EVERY_VALUE,
    Delivery,
    Impairment,
    Lattice,
    Packet,
    Packets,
    SendTimes,
)

_NUMBERS = {"source": "iu", "sample": "iu", "factor": "iuf", "offset": "iuf", "content": "iu"}
_NEEDED = 3


class Channel(Protocol):
    """One V2V link; replace it to study another one.

    It is asked for the samples of the run alone, block after block, and may be asked again. One
    whose packets carry something older than `longest_delay` says how much so by a whole number
    `oldest_content`.
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
    oldest_content: int

    @property
    def memory(self) -> int:
        """The most samples from what a packet carries to its delivery."""
        return self.longest_delay + self.oldest_content


def promise_of(channel: Channel) -> Promise:
    """Return what a channel, which may be anybody's, says of itself.

    Raises
    ------
    ChannelError
        When `prompt` is no truth value or `longest_delay` no whole number >= 0.
    """
    try:
        prompt, longest = channel.prompt, channel.longest_delay
        oldest = getattr(channel, "oldest_content", 0)
    except (Exception, SystemExit) as error:  # a custom channel may fail in any way
        raise _raised(error) from error
    if not isinstance(prompt, bool | np.bool_):
        raise ChannelError(f"its prompt is {prompt!r}, neither True nor False")
    for name, value in (("longest_delay", longest), ("oldest_content", oldest)):
        whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
        if not whole or value < 0:
            raise ChannelError(f"its {name} is {value!r}, no whole number >= 0")
    return Promise(bool(prompt), int(longest), int(oldest))


def checked_delivery(channel: Channel, start: int, stop: int) -> Delivery:
    """Return the packets delivered at the samples start..stop-1 of a channel that may be anybody's.

    Raises
    ------
    ChannelError
        When a packet is delivered outside of them, before it was sent, later than
        `longest_delay` or out of order, when it carries what it cannot, or when a prompt channel
        loses a packet.
    """
    prompt, longest_delay, oldest = promise_of(channel)
    try:
        parts = tuple(channel.delivery(start, stop))
    except (Exception, SystemExit) as error:  # a custom channel may fail in any way
        raise _raised(error) from error
    delivery = _arrays(parts)
    source, sample = delivery.source, delivery.sample
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
    _check_content(delivery, oldest)
    return delivery


def _check_content(delivery: Delivery, oldest: int) -> None:
    """Refuse packets that carry what nobody has sent, or no number."""
    source, carried = delivery.source, delivery.carried
    wrong = (carried < 0) | (carried > source) | (source - carried > oldest)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise ChannelError(
            f"its packet of sample {source[row]} carries sample {carried[row]} where "
            f"oldest_content is {oldest}"
        )
    for name in ("factor", "offset"):
        values = getattr(delivery, name)
        if values is not None and not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values))[0])
            raise ChannelError(f"its {name} of the packet of sample {source[row]} is {values[row]}")


def _arrays(parts: Sequence[Any]) -> Delivery:
    """Return a delivery as arrays of their types."""
    if not _NEEDED <= len(parts) <= len(Delivery._fields):
        raise ChannelError("its delivery is not source, sample and factor")
    delivery = Delivery(*parts)
    if not isinstance(delivery.lattice, Lattice):
        raise ChannelError(f"lattice of its delivery is {delivery.lattice!r}, no Lattice")
    arrays: list[npt.NDArray[Any] | None] = []
    for part, (name, kinds) in zip(delivery, _NUMBERS.items(), strict=False):
        if part is None and len(arrays) >= _NEEDED:
            arrays.append(None)
            continue
        array = np.asarray(part)
        if array.ndim != 1 or (array.size and array.dtype.kind not in kinds):
            numbers = "whole numbers" if kinds == "iu" else "numbers"
            raise ChannelError(
                f"{name} of its delivery is {array.dtype} of shape {array.shape}, not a list of "
                f"{numbers}"
            )
        arrays.append(array.astype(np.int64 if kinds == "iu" else np.float64))
    if len({len(array) for array in arrays if array is not None}) > 1:
        raise ChannelError("source, sample and factor of its delivery differ in length")
    return Delivery(*arrays, delivery.lattice)  # type: ignore[arg-type, call-arg]


def _raised(error: BaseException) -> ChannelError:
    return ChannelError(f"it raised {type(error).__name__}: {' '.join(str(error).split())}")


class ComposedChannel:
    """Packets, one every sample unless send times say otherwise, and impairments in their order.

    Parameters
    ----------
    impairments : sequence of Impairment
        What happens to packets.
    send_times : SendTimes, optional
        When they are sent.
    lattice : Lattice, optional
        What they can say.

    Examples
    --------
    >>> channel = ComposedChannel([])
    >>> channel.prompt, channel.delivery(5, 8).source.tolist()
    (True, [5, 6, 7])
    >>> ComposedChannel([], SendTimes(interval=10)).delivery(5, 25).source.tolist()
    [10, 20]
    """

    def __init__(
        self,
        impairments: Sequence[Impairment],
        send_times: SendTimes = EVERY_SAMPLE,
        lattice: Lattice = EVERY_VALUE,
    ) -> None:
        self._impairments, self._send_times = tuple(impairments), send_times
        self.lattice = lattice
        prompt = all(impairment.prompt for impairment in self._impairments)
        self.prompt = prompt and send_times == EVERY_SAMPLE
        self.longest_delay = sum(impairment.longest_delay for impairment in self._impairments)
        self.oldest_content = sum(getattr(one, "oldest_content", 0) for one in self._impairments)

    def delivery(self, start: int, stop: int) -> Delivery:
        """Return the packets delivered at the receiver's samples start..stop-1."""
        source = self._send_times.between(max(0, start - self.longest_delay), stop)
        packets = self.impaired(Packets.sent(self._send_times.number(source), source))
        sample = packets.source + packets.delay
        delivery = Delivery(
            packets.source,
            sample,
            packets.factor,
            packets.offset if packets.offset.any() else None,
            packets.content if self.oldest_content else None,
            self.lattice,
        )
        rows = np.flatnonzero(packets.arrives & (sample >= start) & (sample < stop))
        return delivery.pick(rows[np.argsort(sample[rows], kind="stable")])

    def impaired(self, packets: Packets) -> Packets:
        """Return packets after everything that happens to them."""
        for impairment in self._impairments:
            packets = impairment.apply(packets)
        return packets


class PacketSource(Protocol):
    """The packets of one link in one run, from its first sample on."""

    @property
    def prompt(self) -> bool:
        """Whether every sample's packet is delivered at that sample, and no other."""
        ...

    @property
    def memory(self) -> int:
        """The most samples from what a packet carries to its delivery."""
        ...

    def deliver(self, sample: int, position: float, velocity: float) -> list[Packet]:
        """Return the packets delivered at a sample, at which the sender moves so.

        Asked in turn, but not of the samples that `quiet_until` leaves out.
        """
        ...

    def quiet_until(self, sample: int) -> int:
        """Return the last sample, from one on, up to which nothing happens, however it moves."""
        ...


class ChannelSource:
    """The packets of a channel, whose sender may move as it likes.

    Parameters
    ----------
    channel : Channel
        Asked for a block at a time, and held to what it promises.
    samples : int
        Of the run.
    start : int, optional
        The first sample that is asked for.
    """

    def __init__(self, channel: Channel, samples: int, start: int = 0) -> None:
        self.prompt, *_ = promise = promise_of(channel)
        self.memory = promise.memory
        self._channel, self._samples, self._stop = channel, samples, start
        self._due: deque[tuple[int, list[Packet]]] = deque()

    def deliver(self, sample: int, _position: float, _velocity: float) -> list[Packet]:
        """Return the packets delivered at a sample."""
        if sample >= self._stop:
            self._ask()
        if self._due and self._due[0][0] == sample:
            return self._due.popleft()[1]
        return []

    def quiet_until(self, sample: int) -> int:
        """Return the last sample, from one on, up to which nothing is delivered."""
        return max(sample, (self._due[0][0] if self._due else self._stop) - 1)

    def _ask(self) -> None:
        """Ask for the next block of samples."""
        first, self._stop = self._stop, min(self._stop + BLOCK, self._samples)
        if first < self._stop:
            delivery = checked_delivery(self._channel, first, self._stop)
            packets = delivery.packets()
            samples, begins = np.unique(delivery.sample, return_index=True)
            ends = [*begins.tolist(), len(packets)]
            for sample, (begin, end) in zip(samples.tolist(), pairwise(ends), strict=True):
                self._due.append((sample, packets[begin:end]))


def packets_by_sample(channel: Channel, samples: int) -> Iterator[list[Packet]]:
    """Yield the packets delivered at each sample of a run.

    The channel is asked for a block at a time, and held to what it promises.

    Examples
    --------
    >>> [[tuple(packet)[:2] for packet in now]
    ...     for now in packets_by_sample(ComposedChannel([]), samples=2)]
    [[(0, 0)], [(1, 1)]]
    """
    source = ChannelSource(channel, samples)
    for sample in range(samples):
        yield source.deliver(sample, 0.0, 0.0)
