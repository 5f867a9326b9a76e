"""Packets that are sent as the sender moves: the rules of Cooperative Awareness Messages."""

from __future__ import annotations

import math
from collections import defaultdict
from typing import Protocol

import numpy as np

from cacc_platoon.model.channel import ComposedChannel
from cacc_platoon.model.packets import Delivery, Packet, Packets

LEAST_TIME, MOST_TIME = 0.1, 1.0
"""T_GenCamMin and T_GenCamMax [s]."""

MOVED, CHANGED = 4.0, 0.5
"""A packet is sent early when position [m] or speed [m/s] differ by more from the last one."""

KEPT = 3
"""N_GenCam: for so many packets the time between them stays as short as the motion made it."""

_ROUNDING = 1e-9


class SendRule(Protocol):
    """Says at which samples a sender sends, by how it moves."""

    def sends(self, sample: int, position: float, velocity: float) -> bool:
        """Return whether it sends a packet at a sample; asked for each at which it may."""
        ...

    def next_check(self, sample: int) -> int:
        """Return the first sample after one at which it may send, however the sender moves."""
        ...


class CamRule:
    """When a Cooperative Awareness Message is sent (ETSI EN 302 637-2 V1.4.1, section 6.1.3).

    At most every 0.1 s and at least every 1 s: as soon as the position differs by more than 4 m or
    the speed by more than 0.5 m/s from that in the last one, and otherwise after the time that
    passed before the last such packet, three times, then every 1 s. The road is straight, so that
    the heading does not count.

    Parameters
    ----------
    step : float
        Control period [s].
    check : int
        Samples from one check of the rule to the next.
    phase : int, optional
        Sample of the first check.

    Examples
    --------
    >>> rule = CamRule(step=0.01, check=10)
    >>> [k for k in range(100) if rule.sends(k, 25.0 * 0.01 * k, 25.0)]
    [0, 20, 40, 60, 80]
    >>> rule = CamRule(step=0.01, check=1)
    >>> [k for k in range(100) if rule.sends(k, 25.0 * 0.01 * k, 25.0)]
    [0, 17, 34, 51, 68, 85]
    """

    def __init__(self, step: float, check: int, phase: int = 0) -> None:
        self._least, self._most = (math.ceil(t / step - _ROUNDING) for t in (LEAST_TIME, MOST_TIME))
        self._check, self._phase = check, phase
        self._sample, self._position, self._velocity = -1, 0.0, 0.0
        self._interval, self._kept = self._most, 0

    def next_check(self, sample: int) -> int:
        """Return the first sample after one at which a message may be sent."""
        first = sample + 1
        if self._sample >= 0:
            first = max(first, self._sample + self._least)
        return self._phase + max(0, -(-(first - self._phase) // self._check)) * self._check

    def sends(self, sample: int, position: float, velocity: float) -> bool:
        """Return whether a message is sent at a sample."""
        if sample < self._phase or (sample - self._phase) % self._check:
            return False
        elapsed = sample - self._sample
        if self._sample >= 0 and elapsed < self._least:
            return False
        moved = abs(position - self._position) > MOVED + _ROUNDING
        if self._sample >= 0 and (moved or abs(velocity - self._velocity) > CHANGED + _ROUNDING):
            self._interval, self._kept = elapsed, 0
        elif self._sample >= 0 and elapsed < self._interval:
            return False
        else:
            self._kept += 1
            if self._kept >= KEPT:
                self._interval = self._most
        self._sample, self._position, self._velocity = sample, position, velocity
        return True


class TriggeredChannel:
    """Packets that a rule sends, and what happens to them; asked in turn, not of quiet samples.

    Parameters
    ----------
    rule : SendRule
        When they are sent.
    channel : ComposedChannel
        What happens to them; its send times do not count.
    in_order : bool, optional
        Whether each waits for those that were sent before it and arrive.

    Examples
    --------
    >>> from cacc_platoon.model import RandomLatency
    >>> late = ComposedChannel([RandomLatency([0.0] * 20 + [0.02] * 50, seed=1, link=1)])
    >>> channel = TriggeredChannel(CamRule(step=0.01, check=10), late, in_order=True)
    >>> arrived = [channel.deliver(k, 0.5 * k, 50.0) for k in range(100)]
    >>> [packet.source for packets in arrived for packet in packets]
    [0, 10, 20, 30, 40]
    """

    prompt = False

    def __init__(self, rule: SendRule, channel: ComposedChannel, *, in_order: bool = False) -> None:
        self._rule, self._channel, self._in_order = rule, channel, in_order
        self._latest = 0
        self.memory = channel.longest_delay + channel.oldest_content
        self._number = 0
        self._due: defaultdict[int, list[Packet]] = defaultdict(list)

    def change(self, channel: ComposedChannel) -> None:
        """Let something else happen to packets that are sent from now on."""
        self._channel = channel

    def deliver(self, sample: int, position: float, velocity: float) -> list[Packet]:
        """Return the packets delivered at a sample, at which the sender moves so."""
        if self._rule.sends(sample, position, velocity):
            self._send(sample)
        return self._due.pop(sample, [])

    def quiet_until(self, sample: int) -> int:
        """Return the last sample, from one on, up to which nothing is sent or delivered."""
        return min([self._rule.next_check(sample), *self._due]) - 1

    def _send(self, sample: int) -> None:
        sent = Packets.sent(np.array([self._number]), np.array([sample]))
        self._number += 1
        packets = self._channel.impaired(sent)
        if packets.arrives[0]:
            at = sample + int(packets.delay[0])
            if self._in_order:
                at = self._latest = max(at, self._latest)
            delivery = Delivery(
                packets.source,
                np.array([at]),
                packets.factor,
                packets.offset,
                packets.content,
                self._channel.lattice,
            )
            self._due[at] += delivery.packets()
