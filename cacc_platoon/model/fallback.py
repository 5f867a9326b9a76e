"""Falling back to a longer headway while nothing is received, and coming back."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum


class ReceptionState(IntEnum):
    """What a follower does about what it receives."""

    NORMAL = 0
    DEGRADING = 1
    FALLBACK = 2
    RECOVERING = 3


class FallbackReception:
    """Holds the newest value; in a silence it fades it out and opens a longer headway, by a blend.

    After `patience` samples without a new packet the received acceleration is faded out and the
    headway goes to its fallback, each in equal steps within `blend` samples; both come back as
    slowly once there was no such silence for `trust` samples. So from one sample to the next the
    blend changes the command by at most ``(k_a |a| + k_p v |h_f - h_w|)/blend``, of the held
    acceleration ``a`` and the speed ``v``.

    Parameters
    ----------
    patience, blend, trust : int
        Samples, >= 1.
    time_headway, fallback_headway : float
        ``h_w`` and ``h_f`` [s].

    Attributes
    ----------
    state : ReceptionState
        Of the last sample.
    headway : float or None
        Time headway to keep at it [s]; None for that of the gains.

    Examples
    --------
    >>> reception = FallbackReception(2, 2, 1, time_headway=0.95, fallback_headway=1.05)
    >>> for delivered in ([(0, 1.0)], [], [], [], [(4, 2.0)], []):
    ...     print(reception.use(delivered), reception.headway, reception.state.name)
    1.0 None NORMAL
    1.0 None NORMAL
    0.5 1.0 DEGRADING
    0.0 1.05 FALLBACK
    1.0 1.0 RECOVERING
    2.0 None NORMAL
    """

    def __init__(
        self,
        patience: int,
        blend: int,
        trust: int,
        *,
        time_headway: float,
        fallback_headway: float,
    ) -> None:
        self._patience, self._blend, self._trust = patience, blend, trust
        self._headway, self._longer = time_headway, fallback_headway - time_headway
        self._source, self._value = -1, 0.0
        self._silent = self._heard = 0
        self._level = blend
        self.state = ReceptionState.NORMAL
        self.headway: float | None = None

    def use(self, delivered: Iterable[tuple[int, float]]) -> float:
        """Return the acceleration [m/s^2] to use at the next sample, faded as it may be."""
        self._silent += 1
        for source, value in delivered:
            if source > self._source:
                self._source, self._value, self._silent = source, value, 0
        silence = self._silent >= self._patience
        self._heard = 0 if silence else self._heard + 1
        self._turn(silence)
        if self._level == self._blend:
            self.headway = None
            return self._value
        share = self._level / self._blend
        self.headway = self._headway + (1.0 - share) * self._longer
        return share * self._value

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
