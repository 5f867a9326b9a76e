"""Whether what is received agrees with what is measured: the assumption on the noise, watched.

A follower measures how fast the one ahead changes its speed, and its packets say how fast that
should be: w a, with w within 1 -+ 1/rho. Where no motion of the one ahead explains both, the
assumption is violated; see docs/theory.md, section 11 (Extensions).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from cacc_platoon.model.fallback import FallbackReception
from cacc_platoon.model.noise import factor_interval
from cacc_platoon.model.reception import Reception

ROUNDING = 1e-6
"""Difference of velocities [m/s] that is never taken for a violation."""

CUT = 1.0 - 1e-9
"""A received value of at least this share of the least that a cut one has may be a cut one."""


class Allowances(NamedTuple):
    """What may be the case without the assumption being violated.

    Attributes
    ----------
    rho : float
        Signal-to-noise ratio: w is within ``1 -+ 1/rho``.
    velocity : float
        Difference of two measured velocities of the vehicle ahead that is noise [m/s].
    acceleration : float
        Error of the acceleration that a packet says, before w multiplies it [m/s^2].
    jerk : float
        How fast the acceleration may leave, between two packets, the range of those that they say
        [m/s^3].
    saturation : float
        Largest acceleration that a packet can say [m/s^2], 0 for no limit.
    """

    rho: float
    velocity: float = 0.0
    acceleration: float = 0.0
    jerk: float = 0.0
    saturation: float = 0.0


class _Excess:
    """By how much a velocity has risen more than it may, since whenever that is most.

    Parameters
    ----------
    window : int
        Samples that it looks back.
    """

    def __init__(self, window: int) -> None:
        self._window = window
        self._allowed = 0.0
        self._lowest: deque[tuple[int, float]] = deque()

    def step(self, sample: int, velocity: float, allowed: float) -> float:
        """Return the excess [m/s], >= 0, after a sample up to which it may have risen so far.

        What is not finite allows for anything: what was before is compared no more.
        """
        lowest = self._lowest
        if math.isfinite(allowed):
            self._allowed += allowed
        else:
            lowest.clear()
        level = velocity - self._allowed
        while lowest and lowest[-1][1] >= level:
            lowest.pop()
        lowest.append((sample, level))
        while lowest[0][0] < sample - self._window:
            lowest.popleft()
        return level - lowest[0][1]


class AssumptionMonitor:
    """Says, sample by sample, when packets contradict the measured motion of the one ahead.

    Parameters
    ----------
    allowed : Allowances
        What is no contradiction.
    step : float
        Control period [s].
    window : int
        Samples that it looks back, >= 1.
    delay : int, optional
        Samples by which what is measured is old.

    Attributes
    ----------
    alarm : bool
        Whether the newest packet that could be compared, with those before, contradicts.
    excess : float
        By how much the measured change of velocity is outside of what packets allow for [m/s].

    Examples
    --------
    >>> monitor = AssumptionMonitor(Allowances(rho=5.0), step=0.1, window=10)
    >>> ahead = [(20.0 + 0.1 * k, [(k, 1.1 if k < 3 else 3.0)]) for k in range(6)]
    >>> [monitor.step(20.0, velocity, packets) for velocity, packets in ahead]
    [False, False, False, False, True, True]
    """

    def __init__(self, allowed: Allowances, step: float, window: int, delay: int = 0) -> None:
        self._low, self._high = factor_interval(allowed.rho)
        self._error, self._jerk = allowed.acceleration, allowed.jerk
        self._cut = CUT * self._low * allowed.saturation or math.inf
        self._least = allowed.velocity + ROUNDING
        self._step, self._window, self._delay = step, window, delay
        self._sample = 0
        self._own: deque[float] = deque(maxlen=delay + 1)
        self._ahead: deque[float] = deque(maxlen=window + 1)
        self._waiting: deque[tuple[int, float]] = deque()
        self._newest = -1
        self._compared = -1
        self._range = 0.0, 0.0
        self._above, self._below = _Excess(window), _Excess(window)
        self.alarm, self.excess = False, 0.0

    def step(self, own: float, ahead: float, delivered: Iterable[tuple[int, float]]) -> bool:
        """Go on to the next sample and return whether there is a contradiction.

        Parameters
        ----------
        own, ahead : float
            Velocity of the vehicle, and that of the one ahead as it is measured [m/s].
        delivered : iterable of (int, float)
            Source sample and received acceleration of each packet delivered at it, in order.
        """
        measured = self._sample - self._delay  # the sample at which it was so
        self._sample += 1
        self._own.append(own)
        if measured >= 0:
            self._ahead.append(self._own[0] + (ahead - own))
        for source, value in delivered:
            if source > self._newest:
                self._newest = source
                self._waiting.append((source, value))
        while self._waiting and self._waiting[0][0] <= measured:
            source, value = self._waiting.popleft()
            if (age := measured - source) < len(self._ahead):
                self._compare(source, value, self._ahead[-1 - age])
        if measured - self._compared > self._window:
            self.alarm, self.excess = False, 0.0
        return self.alarm

    def _compare(self, source: int, value: float, velocity: float) -> None:
        """Compare the velocity at the source of a packet with what packets allow for."""
        before, (least, most) = self._compared, self._range
        self._compared, self._range = source, self._possible(value)
        rise = fall = math.inf
        if before >= 0:
            span = (source - before) * self._step
            aside = self._jerk * span / 4.0
            rise = span * (max(most, self._range[1]) + aside)
            fall = span * (aside - min(least, self._range[0]))
        self.excess = max(
            self._above.step(source, velocity, rise), self._below.step(source, -velocity, fall)
        )
        self.alarm = self.excess > self._least

    def _possible(self, value: float) -> tuple[float, float]:
        """Return the range of accelerations ahead [m/s^2] of which this can be received."""
        ends = value / self._low, value / self._high
        least, most = min(ends) - self._error, max(ends) + self._error
        if abs(value) >= self._cut:
            return (least, math.inf) if value > 0.0 else (-math.inf, most)
        return least, most


class MonitoredReception:
    """A reception with a monitor beside it.

    Parameters
    ----------
    reception : Reception
        What the vehicle makes of its packets.
    monitor : AssumptionMonitor
        Compares them with what is measured.
    acts : bool
        Whether an alarm has a `FallbackReception` fall back.
    """

    def __init__(self, reception: Reception, monitor: AssumptionMonitor, acts: bool) -> None:
        self._reception, self.monitor = reception, monitor
        self._fallback = reception if acts and isinstance(reception, FallbackReception) else None
        self._measured = math.nan, math.nan

    @property
    def share(self) -> float:
        """Of the control law, as the reception says."""
        return float(getattr(self._reception, "share", 1.0))

    @property
    def state(self) -> int:
        """`ReceptionState` of the reception."""
        return int(getattr(self._reception, "state", 0))

    def measure(self, own: float, ahead: float) -> None:
        """Take what is measured at the next sample, before `use`; see `AssumptionMonitor.step`."""
        self._measured = own, ahead

    def use(self, delivered: Iterable[tuple[int, float]]) -> float:
        """Return the acceleration [m/s^2] to use at the next sample."""
        packets = list(delivered)
        alarm = self.monitor.step(*self._measured, packets)
        if self._fallback:
            return self._fallback.use(packets, distrusted=alarm)
        return self._reception.use(packets)
