"""Links that are followed sample after sample, as their nodes do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from cacc_platoon.model import MonitoredReception, PacketSource
from cacc_platoon.model.channel import ChannelError
from cacc_platoon.scenario import Follower
from cacc_platoon.simulation.bodies import Sensors
from cacc_platoon.simulation.trajectory import Array, Arrivals


class LinkOfRun(NamedTuple):
    """One link of one run: its receiver, and what gives its packets from the first on."""

    follower: Follower
    packets: Callable[[], PacketSource]


class _Process:
    """One link from its first sample on."""

    def __init__(self, link: LinkOfRun) -> None:
        try:
            self._packets = link.packets()
        except ChannelError as error:
            raise _named(error, link.follower) from error
        self._follower = link.follower
        self._reception = link.follower.reception()
        watched = isinstance(self._reception, MonitoredReception)
        self.watched = self._reception if watched else None
        self._at_once = self._packets.prompt and not (watched or link.follower.asks_own_code)
        self.share = 1.0
        self.arrived: list[tuple[int, int, float]] = []

    def step(self, sample: int, motion: Array) -> float:
        """Return what is used at a sample; the sender's motion is of shape (3, samples)."""
        delivered = self.deliver(sample, motion)
        if self._at_once:
            return delivered[0][1]
        used = self._reception.use(delivered)
        self.share = getattr(self._reception, "share", 1.0)
        return used

    def deliver(self, sample: int, motion: Array) -> list[tuple[int, float]]:
        """Return source and value [m/s^2] of what arrives at a sample."""
        try:
            packets = self._packets.deliver(sample, *motion[:2, sample].tolist())
        except ChannelError as error:
            raise _named(error, self._follower) from error
        delivered = [
            (packet.source, packet.value(float(motion[2, packet.content]))) for packet in packets
        ]
        self.arrived += [(source, sample, value) for source, value in delivered]
        return delivered


def _named(error: ChannelError, follower: Follower) -> ChannelError:
    return ChannelError(f"the channel of vehicle {follower.index}: {error}. Correct it.")


class SteppedLinks:
    """Links of which nothing is known beforehand; see `Links`.

    Parameters
    ----------
    runs : sequence of sequence of LinkOfRun
        The links of each run, in the order of the topology.
    senders : sequence of int
        Column of each link's sender.
    columns : sequence of slice
        The links to each follower.
    sensors : Sensors, optional
        What the followers measure, where that is watched; all that is, by default.
    """

    def __init__(
        self,
        runs: Sequence[Sequence[LinkOfRun]],
        senders: Sequence[int],
        columns: Sequence[slice],
        sensors: Sensors | None = None,
    ) -> None:
        self._runs, self._senders, self._columns = runs, senders, columns
        self._sensors = sensors
        self._begin()

    def _begin(self) -> None:
        self._links = [[_Process(link) for link in run] for run in self._runs]
        self._falls_back = any(link.follower.fallback_law() for run in self._runs for link in run)
        self.share: Array | None = None

    def received(self, sample: int, motion: Array) -> Array:
        """Return what is used of every link at a sample."""
        if sample == 0:
            self._begin()
        self._measure(sample, motion)
        used = [
            [
                link.step(sample, motion[:, :, number, sender])
                for link, sender in zip(run, self._senders, strict=True)
            ]
            for number, run in enumerate(self._links)
        ]
        if self._falls_back:
            shares = [
                [min(link.share for link in run[own]) for own in self._columns]
                for run in self._links
            ]
            self.share = np.array(shares)
        return np.array(used)

    def _measure(self, sample: int, motion: Array) -> None:
        """Have the links that are watched know what their receivers measure."""
        if not any(link.watched for link in self._links[0]):
            return
        own, ahead = motion[1, sample, :, 1:], motion[1, sample, :, :-1]
        if self._sensors:
            _, ahead = self._sensors.ahead(sample, motion)
        for number, run in enumerate(self._links):
            for follower, links in enumerate(self._columns):
                if watched := run[links.start].watched:
                    watched.measure(float(own[number, follower]), float(ahead[number, follower]))

    def arrivals(self, run: int, _motion: Array) -> tuple[Arrivals, ...]:
        """Return what has arrived in a run over each link."""
        return tuple(_arrivals(link.arrived) for link in self._links[run])


def followed(link: LinkOfRun, motion: Array) -> Arrivals:
    """Return what arrives over a link whose sender moves so, shape (3, samples)."""
    process = _Process(link)
    for sample in range(motion.shape[1]):
        process.deliver(sample, motion)
    return _arrivals(process.arrived)


def _arrivals(arrived: list[tuple[int, int, float]]) -> Arrivals:
    source, sample, value = zip(*arrived, strict=True) if arrived else ((), (), ())
    return Arrivals(np.array(source, np.int64), np.array(sample, np.int64), np.array(value, float))
