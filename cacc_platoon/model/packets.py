"""Packets on a V2V link: what each carries, and what becomes of it.

A sender's packets are numbered p = 0, 1, 2, ... An impairment is a pure function from packets to
packets, keyed by seed, link and p, so that any slice of packets equals that slice of the whole.
"""

from __future__ import annotations

from itertools import repeat
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

Integers: TypeAlias = npt.NDArray[np.int64]
Floats: TypeAlias = npt.NDArray[np.float64]


class Lattice(NamedTuple):
    """The accelerations that a packet can say: the whole multiples of a step, up to a limit.

    Attributes
    ----------
    step : float
        How far apart they are [m/s^2], > 0; 0 for no lattice.
    limit : float
        The largest, in either direction [m/s^2]; 0 for no limit.

    Examples
    --------
    >>> Lattice(0.1, 16.0).nearest(np.array([0.26, -0.04, -20.0])).tolist()
    [0.30000000000000004, 0.0, -16.0]
    """

    step: float = 0.0
    limit: float = 0.0

    def nearest(self, acceleration: Floats) -> Floats:
        """Return the nearest accelerations that can be said [m/s^2]."""
        said = np.asarray(acceleration, np.float64)
        if self.step:
            said = np.rint(said / self.step) * self.step + 0.0
        return np.clip(said, -self.limit, self.limit) if self.limit else said


EVERY_VALUE = Lattice()


class Packets(NamedTuple):
    """Consecutive packets of one link; arrays of one length.

    Attributes
    ----------
    number : ndarray of int64
        p.
    source : ndarray of int64
        Sample at which the packet is sent, its stamp.
    content : ndarray of int64
        Sample whose acceleration it carries: that at which it is sent, unless it is falsified.
    offset : ndarray
        What is added to that acceleration before it is sent [m/s^2].
    factor : ndarray
        What multiplies what is sent.
    arrives : ndarray of bool
        Whether the packet arrives at all.
    delay : ndarray of int64
        Samples from its source to its delivery, >= 0.
    """

    number: Integers
    source: Integers
    content: Integers
    offset: Floats
    factor: Floats
    arrives: npt.NDArray[np.bool_]
    delay: Integers

    @classmethod
    def sent(cls, number: Integers, source: Integers) -> Packets:
        """Return packets to which nothing has happened yet."""
        count = len(number)
        return cls(
            number,
            source,
            source,
            np.zeros(count),
            np.ones(count),
            np.ones(count, np.bool_),
            np.zeros(count, np.int64),
        )


class Impairment(Protocol):
    """One thing that happens to packets.

    One that puts older accelerations into packets says, by a whole number `oldest_content`, how
    many samples older at most.
    """

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


class Packet(NamedTuple):
    """A packet as it is delivered; see `Packets`."""

    source: int
    content: int
    offset: float
    factor: float
    lattice: Lattice | None = None

    def value(self, acceleration: float) -> float:
        """Return what is received [m/s^2], of the acceleration that the packet carries."""
        _, _, offset, factor, lattice = self
        if offset:
            acceleration = acceleration + offset
        if lattice:
            acceleration = float(lattice.nearest(np.asarray(acceleration)))
        return factor * acceleration


class Delivery(NamedTuple):
    """Packets in the order in which a receiver gets them; arrays of one length.

    Attributes
    ----------
    source : ndarray of int64
        Sample at which each packet is sent, its stamp.
    sample : ndarray of int64
        Receiver's sample at which it is delivered.
    factor : ndarray
        What multiplies what is sent.
    offset : ndarray or None
        What is added to the acceleration before it is sent [m/s^2]; None for nothing.
    content : ndarray of int64 or None
        Sample whose acceleration each packet carries; None for that at which it is sent.
    lattice : Lattice
        The values that can be sent.
    """

    source: Integers
    sample: Integers
    factor: Floats
    offset: Floats | None = None
    content: Integers | None = None
    lattice: Lattice = EVERY_VALUE

    @property
    def carried(self) -> Integers:
        """Sample whose acceleration each packet carries."""
        return self.source if self.content is None else self.content

    @property
    def exact(self) -> bool:
        """Whether each packet says the acceleration at which it is sent, times its factor."""
        return self.offset is None and self.content is None and self.lattice == EVERY_VALUE

    def pick(self, rows: npt.NDArray[np.bool_] | Integers | slice) -> Delivery:
        """Return some of the packets."""
        arrays = [None if part is None else part[rows] for part in self[:-1]]
        return Delivery(*arrays, self.lattice)  # type: ignore[arg-type, call-arg]

    def values(self, acceleration: Floats) -> Floats:
        """Return what is received [m/s^2], of the sender's acceleration at each sample."""
        return self.factor * said(acceleration[self.carried], self.offset, self.lattice)

    def packets(self) -> list[Packet]:
        """Return the packets one by one."""
        count = len(self.source)
        offset = [0.0] * count if self.offset is None else self.offset.tolist()
        columns = self.source.tolist(), self.carried.tolist(), offset, self.factor.tolist()
        lattice = None if self.lattice == EVERY_VALUE else self.lattice
        return list(map(Packet._make, zip(*columns, repeat(lattice), strict=False)))


def said(acceleration: Floats, offset: Floats | None, lattice: Lattice) -> Floats:
    """Return what a packet says of accelerations [m/s^2]; see `Packet.value`."""
    if offset is not None:
        acceleration = np.where(offset == 0.0, acceleration, acceleration + offset)
    return acceleration if lattice == EVERY_VALUE else lattice.nearest(acceleration)


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
