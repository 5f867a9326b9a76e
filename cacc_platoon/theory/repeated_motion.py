r"""Motions that every vehicle repeats, scaled and turned: those that a platoon may amplify.

Where each vehicle moves as its predecessor does times ``lambda``, the predecessor's state is the
vehicle's own times ``c = 1/lambda``, and over one V2V period the state, the packet in use and those
on their way are multiplied by a matrix ``Phi(c)`` of a few rows. Errors grow along the platoon iff
for some ``|c| <= 1`` an eigenvalue of ``Phi`` leaves the unit disc. A spectral radius is
subharmonic in ``c``, so that ``|c| = 1`` decides: a ring of such vehicles
(docs/theory.md, section 7 (V2V latency)).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.theory.sampled import hold_integrals

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from cacc_platoon.model.control import Gains
    from cacc_platoon.theory.lifted_hop import PacketTimes

    Float = NDArray[np.float64]
    Complex = NDArray[np.complex128]

__all__ = ["repeated_motion", "repeated_motion_radius"]

_X, _V, _A, _HEARD, _SENT = range(5)


def repeated_motion_radius(
    packets: PacketTimes, gains: Gains, tau: ArrayLike, k_effective: ArrayLike, turn: ArrayLike
) -> Float:
    """Size of `repeated_motion`: above one, the platoon amplifies."""
    return np.asarray(np.abs(repeated_motion(packets, gains, tau, k_effective, turn)))


def repeated_motion(
    packets: PacketTimes, gains: Gains, tau: ArrayLike, k_effective: ArrayLike, turn: ArrayLike
) -> Complex:
    """Largest eigenvalue of ``Phi(exp(-j turn))``; the arrays broadcast.

    At ``turn = 0`` it is one: a platoon may drive elsewhere. Its angle is that over a V2V period.

    Parameters
    ----------
    packets : PacketTimes
        When packets come.
    gains : Gains
        Controller.
    tau, k_effective : array_like
        Lag [s] and ``k_a E[w]``.
    turn : array_like
        How far a motion is turned from one vehicle to the next [rad].
    """
    c = np.exp(-1j * np.asarray(turn, dtype=float))
    lag, k = np.asarray(tau, float), np.asarray(k_effective, float)
    c = np.broadcast_to(c, np.broadcast_shapes(c.shape, lag.shape, k.shape))
    whole, part = divmod(packets.latency, packets.interval)
    size = _SENT + 1 + whole
    step = _control_step(packets.period, gains, (lag, k, c), size)
    send, arrive = (np.zeros((*c.shape, size, size), dtype=np.complex128) for _ in range(2))
    kept = np.arange(_SENT)
    send[..., kept, kept] = arrive[..., kept, kept] = 1.0
    send[..., _SENT, _A] = c
    queue = np.arange(_SENT + 1, size)
    send[..., queue, queue - 1] = 1.0
    waiting = np.arange(_SENT, size)
    arrive[..., waiting, waiting] = 1.0
    arrive[..., _HEARD, _HEARD] = 1.0 - packets.held
    arrive[..., _HEARD, size - 1] = packets.held
    matrix = np.linalg.matrix_power(step, packets.interval - part) @ arrive
    if part:
        matrix = matrix @ np.linalg.matrix_power(step, part)
    values = np.linalg.eigvals(matrix @ send)
    largest = np.argmax(np.abs(values), axis=-1)[..., np.newaxis]
    return np.asarray(np.take_along_axis(values, largest, -1)[..., 0])


def _control_step(
    period: float, gains: Gains, motion: tuple[Float, Float, Complex], size: int
) -> Complex:
    """One control period of position, velocity and acceleration with the packet in use."""
    (lag, k, c), (h, _, k_v, k_p) = motion, gains
    T = np.asarray(period)
    a1, a2, a3 = (x * period**n for n, x in enumerate(hold_integrals(lag, T), start=1))
    apart: Complex = np.subtract(1.0, c)
    command = {_X: -k_p * apart, _V: -k_v * apart - k_p * h, _A: -np.ones_like(lag), _HEARD: k}
    step = np.zeros((*c.shape, size, size), dtype=np.complex128)
    for row, share in ((_X, a3), (_V, a2), (_A, a1)):
        for column, gain in command.items():
            step[..., row, column] = share * gain
    every = np.arange(size)
    step[..., every, every] += 1.0
    step[..., _X, _V] += period
    step[..., _X, _A] += 0.5 * period**2
    step[..., _V, _A] += period
    return step
