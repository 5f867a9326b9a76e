"""What a receiver makes of the packets that arrive: the acceleration that its law uses.

Of several packets the one of the newest source sample counts; one that was overtaken is discarded.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np
import numpy.typing as npt

from cacc_platoon.model.packets import Delivery, Integers

Number = TypeVar("Number", np.float64, np.int64)


class Reception(Protocol):
    """The receiver of one link, sample by sample.

    One that trusts what it holds only in part says so by its attribute `share`: so much of the
    command is the control law's, the rest that of a law without V2V (`FallbackReception`).
    """

    def use(self, delivered: Iterable[tuple[int, float]]) -> float:
        """Return the acceleration [m/s^2] to use at the next sample.

        Parameters
        ----------
        delivered : iterable of (int, float)
            Source sample and received acceleration of each packet delivered at it, in order.
        """
        ...


@runtime_checkable
class ChoosingReception(Reception, Protocol):
    """A receiver that uses one packet or none, so that it can be told of a whole run at once."""

    def chosen(self, delivery: Delivery, samples: int) -> Integers:
        """Return which packet is used at each sample from 0 on, -1 for none, shape (samples,)."""
        ...


class HoldReception:
    """Uses the newest value that has arrived, 0 before the first.

    Examples
    --------
    >>> reception = HoldReception()
    >>> reception.use([(0, 1.5)]), reception.use([]), reception.use([(2, 2.5)])
    (1.5, 1.5, 2.5)
    """

    def __init__(self) -> None:
        self._source, self._value = -1, 0.0

    def use(self, delivered: Iterable[tuple[int, float]]) -> float:
        """Return the newest value that has arrived."""
        for source, value in delivered:
            if source > self._source:
                self._source, self._value = source, value
        return self._value

    def chosen(self, delivery: Delivery, samples: int) -> Integers:
        """Return which packet is used at each sample."""
        kept = not_overtaken(delivery.source)
        last = np.searchsorted(delivery.sample[kept], np.arange(samples), side="right") - 1
        return np.where(last >= 0, kept[last], -1) if len(kept) else np.full(samples, -1)


class ZeroReception:
    """Uses the newest value until the next one is due, and 0 from then on while none arrives.

    Parameters
    ----------
    interval : int, optional
        Samples from packet to packet.

    Examples
    --------
    >>> reception = ZeroReception()
    >>> reception.use([(0, 1.5)]), reception.use([]), reception.use([(2, 2.5)])
    (1.5, 0.0, 2.5)
    >>> reception = ZeroReception(interval=2)
    >>> [reception.use(delivered) for delivered in ([(0, 1.5)], [], [])]
    [1.5, 1.5, 0.0]
    """

    def __init__(self, interval: int = 1) -> None:
        self._interval = interval
        self._source, self._value, self._left = -1, 0.0, 0

    def use(self, delivered: Iterable[tuple[int, float]]) -> float:
        """Return the newest value until the next one is due, or 0."""
        for source, value in delivered:
            if source > self._source:
                self._source, self._value, self._left = source, value, self._interval
        self._left -= 1
        return self._value if self._left >= 0 else 0.0

    def chosen(self, delivery: Delivery, samples: int) -> Integers:
        """Return which packet is used at each sample."""
        kept = not_overtaken(delivery.source)
        every = np.arange(samples)
        last = np.searchsorted(delivery.sample[kept], every, side="right") - 1
        if not len(kept):
            return np.full(samples, -1)
        since = every - delivery.sample[kept[last]]
        return np.where((last >= 0) & (since < self._interval), kept[last], -1)


def picked(values: npt.NDArray[Number], chosen: Integers, none: float) -> npt.NDArray[Number]:
    """Return a value of the chosen packet of each sample, `none` where there is none."""
    found = np.full(len(chosen), none, values.dtype)
    used = chosen >= 0
    found[used] = values[chosen[used]]
    return found


def not_overtaken(source: Integers) -> Integers:
    """Return the rows whose source is newer than that of every row before."""
    if not len(source):
        return np.empty(0, np.int64)
    newest_before = np.concatenate(([-1], np.maximum.accumulate(source)[:-1]))
    return np.flatnonzero(source > newest_before)
