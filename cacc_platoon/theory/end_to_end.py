"""How much of the leader's motion comes through a whole platoon whose packets have their own rate.

Each vehicle may send at a phase of its own; the product of the lifted hops decides
(docs/theory.md, section 7 (V2V latency)).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.theory.errors import require, require_positive
from cacc_platoon.theory.lifted_hop import PacketTimes, refined_peaks
from cacc_platoon.theory.sampled import in_unit_disc, sampled_hop

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from cacc_platoon.model.control import Gains

    Float = NDArray[np.float64]

__all__ = ["end_to_end_gain"]

_ANGLES = 64
_POWERS, _SETTLED = 200, 1e-9


def end_to_end_gain(
    gains: Gains,
    tau: float,
    k_effective: float,
    period: float,
    interval: int,
    *,
    vehicles: int,
    latency: float = 0.0,
    held: float = 1.0,
    phases: Sequence[int] | None = None,
) -> float:
    """Largest ``|a_N|_2`` per ``|a_0|_2`` at the control instants, over all motions of the leader.

    Even one hop may exceed 1, for signals so fast that they fall between packets.

    Parameters
    ----------
    gains, tau, k_effective, period, interval, latency, held
        As in `multirate_growth`.
    vehicles : int
        Number of hops ``N``.
    phases : sequence of int, optional
        Control instant, modulo `interval`, at which each vehicle's packets are sent; all at 0 by
        default.

    Returns
    -------
    float
        Supremum over frequency of the largest singular value of the product of the lifted hops, at
        least 1, since a leader may drive on (numerical: a search over angles); infinite as in
        `multirate_growth`.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> question = Gains(0.95, 0.5, 0.63, 0.009), 0.5, 0.6, 0.01
    >>> [round(end_to_end_gain(*question, interval=20, vehicles=n), 2) for n in (1, 40)]
    [2.78, 2.19]
    """
    require_positive("tau", tau, "s")
    channel = PacketTimes.of(period, interval, latency, held)
    sent = [0] * vehicles if phases is None else list(phases)
    require(
        vehicles >= 1 and len(sent) == vehicles,
        f"phases = {len(sent)} values for vehicles = {vehicles}: each vehicle sends at one. Give "
        "as many, of at least one vehicle.",
    )
    h, _, k_v, k_p = gains
    hop = sampled_hop(h, k_v, k_p, tau, k_effective, period=period)
    if not in_unit_disc(hop.loop, np.asarray(period)):
        return math.inf
    slow = channel.angles(gains, _ANGLES)
    angle = np.concatenate((slow, np.linspace(slow[-2], np.pi, _ANGLES)[1:-1]))
    angle.sort()

    def gain(angles: Float) -> Float:
        return _largest_singular_value(channel, gains, (tau, k_effective), sent, angles)

    at = int(np.argmax(gain(angle)))
    low, high = angle[[max(at - 1, 0)]], angle[[min(at + 1, angle.size - 1)]]
    return max(1.0, float(refined_peaks(gain, low, high)[0][0]))


def _largest_singular_value(
    channel: PacketTimes,
    gains: Gains,
    pair: tuple[float, float],
    phases: Sequence[int],
    angle: Float,
) -> Float:
    """Power iteration on the product of the hops, at angles of any shape."""
    diagonal, u = channel.hop(gains, *pair, angle)
    turn = (angle[..., np.newaxis] + 2.0 * np.pi * channel.aliases) / channel.interval
    shift = [np.exp(1j * turn * phase) for phase in phases]
    wave, gain = np.ones_like(u), np.zeros(angle.shape)
    for _ in range(_POWERS):
        wave /= np.linalg.norm(wave, axis=-1, keepdims=True)
        for e in shift:
            wave = diagonal * wave + u / e * (e * wave).sum(axis=-1, keepdims=True)
        before, gain = gain, np.linalg.norm(wave, axis=-1)
        for e in reversed(shift):
            heard = (np.conj(u / e) * wave).sum(axis=-1, keepdims=True)
            wave = np.conj(diagonal) * wave + np.conj(e) * heard
        if (np.abs(gain - before) <= _SETTLED * gain).all():
            break
    return np.asarray(gain)
