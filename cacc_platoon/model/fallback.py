"""Falling back to a law that needs no V2V while nothing is received, and coming back."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum

from cacc_platoon.model.control import Gains

MARGIN = 0.3
"""By how much, in proportion, the fallback headway is above ``2 tau_0`` where none is given.

With less, gaps at 25 m/s shrink below nothing where all V2V ends as the leader brakes with 6 m/s^2.
"""


class ReceptionState(IntEnum):
    """What a follower does about what it receives."""

    NORMAL = 0
    DEGRADING = 1
    FALLBACK = 2
    RECOVERING = 3

    @classmethod
    def of_share(cls, before: float, share: float) -> ReceptionState:
        """Return the state that a share of the control law, and the one before it, belong to.

        Examples
        --------
        >>> ReceptionState.of_share(0.5, 0.25).name, ReceptionState.of_share(0.0, 0.25).name
        ('DEGRADING', 'RECOVERING')
        """
        if share in (0.0, 1.0):
            return cls.NORMAL if share else cls.FALLBACK
        return cls.RECOVERING if share > before else cls.DEGRADING


def gains_without_v2v(tau_max: float, time_headway: float) -> Gains:
    """Return gains that need no V2V and are string stable for every lag up to `tau_max`.

    With ``k_a = 0`` and ``k_v + k_p h = 1/(2 tau_0)`` the conditions of the exact test are
    ``k_p h^2 <= 2 m`` for a headway ``h = 2 (1 + m) tau_0``; the gain is half of that.

    Parameters
    ----------
    tau_max : float
        Largest actuation lag ``tau_0`` [s].
    time_headway : float
        Time headway [s], above ``2 tau_0``.

    Examples
    --------
    >>> [round(gain, 6) for gain in gains_without_v2v(0.5, 1.1)]
    [1.1, 0.0, 0.909091, 0.082645]
    """
    margin = time_headway / (2.0 * tau_max) - 1.0
    k_p = margin / time_headway**2
    return Gains(time_headway, 0.0, 0.5 / tau_max - k_p * time_headway, k_p)


class FallbackReception:
    """Holds the newest value, and says how much of the command it is trusted with.

    The command is ``share u + (1 - share) u_f`` of the control law and of one without V2V. After
    `patience` samples without a new packet the share falls from 1 to 0 in `blend` equal steps;
    it rises as slowly once there was no such silence for `trust` samples. So from one sample to the
    next the blend changes the command by at most ``|u - u_f|/blend``. A sample at which packets are
    distrusted counts as one after such a silence.

    Parameters
    ----------
    patience, blend, trust : int
        Samples, >= 1.

    Attributes
    ----------
    state : ReceptionState
        Of the last sample.
    share : float
        Of the control law at it, 0 to 1.

    Examples
    --------
    >>> reception = FallbackReception(patience=2, blend=2, trust=1)
    >>> for delivered in ([(0, 1.0)], [], [], [], [(4, 2.0)], []):
    ...     print(reception.use(delivered), reception.share, reception.state.name)
    1.0 1.0 NORMAL
    1.0 1.0 NORMAL
    1.0 0.5 DEGRADING
    1.0 0.0 FALLBACK
    2.0 0.5 RECOVERING
    2.0 1.0 NORMAL
    """

    def __init__(self, patience: int, blend: int, trust: int) -> None:
        self._patience, self._blend, self._trust = patience, blend, trust
        self._source, self._value = -1, 0.0
        self._silent = self._heard = 0
        self._level = blend
        self.state = ReceptionState.NORMAL
        self.share = 1.0

    def use(self, delivered: Iterable[tuple[int, float]], *, distrusted: bool = False) -> float:
        """Return the newest value that has arrived [m/s^2], 0 before the first."""
        self._silent += 1
        for source, value in delivered:
            if source > self._source:
                self._source, self._value, self._silent = source, value, 0
        silence = distrusted or self._silent >= self._patience
        self._heard = 0 if silence else self._heard + 1
        self._turn(silence)
        self.share = self._level / self._blend
        return self._value

    def _turn(self, silence: bool) -> None:
        """Go on from one state to the next, and a step along the blend."""
        if self.state in (ReceptionState.NORMAL, ReceptionState.RECOVERING):
            if silence:
                self.state = ReceptionState.DEGRADING
        elif self._heard >= self._trust:
            self.state = ReceptionState.RECOVERING
        if self.state is ReceptionState.DEGRADING:
            self._level -= 1
            if self._level <= 0:
                self._level, self.state = 0, ReceptionState.FALLBACK
        elif self.state is ReceptionState.RECOVERING:
            self._level += 1
            if self._level >= self._blend:
                self.state = ReceptionState.NORMAL
