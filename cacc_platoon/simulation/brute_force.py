"""The sampled platoon without theory: on frequencies and in time, from the model's own plant.

What the theory says of period, latency and loss together is held against this.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.model import State, ThirdOrderPlant

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from cacc_platoon.model import Gains

    Float = NDArray[np.float64]

__all__ = ["largest_growth", "norm_ratios", "response"]


def response(
    gains: Gains,
    tau: float,
    k_effective: float,
    period: float,
    omega: ArrayLike,
    *,
    age: ArrayLike = 0,
    held: float = 1.0,
) -> NDArray[np.complex128]:
    """``H_T(exp(j omega T))`` of one hop, in the mean of held packets.

    Parameters
    ----------
    gains : Gains
        Controller; ``k_a`` is not used.
    tau, k_effective, period : float
        Lag [s], effective gain, control period [s].
    omega : array_like
        Frequencies [rad/s].
    age : array_like, optional
        Periods by which the acceleration is late, broadcast against `omega`; fractions turn the
        wave likewise.
    held : float, optional
        Packet reception probability of a receiver that holds the last packet.
    """
    h, _, k_v, k_p = gains
    plant = ThirdOrderPlant(tau, period)
    pushed = plant.advance(State(0.0, 0.0, 0.0), 1.0)
    coasting = plant.advance(State(0.0, 0.0, 1.0), 0.0)
    z = np.exp(1j * np.asarray(omega) * period)
    a = pushed.acceleration / (z - coasting.acceleration)
    v = (coasting.velocity * a + pushed.velocity) / (z - 1.0)
    x = (period * v + coasting.position * a + pushed.position) / (z - 1.0)
    heard = k_effective * a * z ** -np.asarray(age) * held / (1.0 - (1.0 - held) / z)
    hop = (heard + k_v * v + k_p * x) / (1.0 + (k_v + k_p * h) * v + k_p * x)
    return np.asarray(hop, dtype=np.complex128)


def largest_growth(
    gains: Gains,
    rho: float,
    lags: ArrayLike,
    period: float,
    *,
    age: float = 0,
    held: float = 1.0,
    reception: float = 1.0,
) -> tuple[float, float]:
    """Largest ``|H_T|`` over lags [s], both ends of I and 3000 frequencies, and where it is.

    Returns
    -------
    tuple of float
        At least 1, and the frequency [rad/s].
    """
    h, k_a, k_v, k_p = gains
    lowest = 0.03 * min(k_p / (k_v + h * k_p), np.sqrt(k_p))
    omega = np.geomspace(lowest, np.pi / period, 3000)
    growth, at = 1.0, 0.0
    for tau in np.asarray(lags).tolist():
        for end in (reception * (1.0 - 1.0 / rho), 1.0 + 1.0 / rho):
            size = np.abs(response(gains, tau, end * k_a, period, omega, age=age, held=held))
            if size.max() > growth:
                growth, at = float(size.max()), float(omega[np.argmax(size)])
    return growth, at


def norm_ratios(
    gains: Gains,
    tau: float,
    k_effective: float,
    period: float,
    commands: ArrayLike,
    *,
    vehicles: int,
    age: int = 0,
    held: float = 1.0,
    interval: int = 1,
    since: int = 0,
) -> Float:
    """Run a platoon whose leader has the given commands [m/s^2], all at rest at first.

    A packet comes every `interval` periods, and the norms count from sample `since` on.

    Returns
    -------
    ndarray, shape (vehicles,)
        ``|a_i|_2/|a_{i-1}|_2`` of the followers. Where ``|H_T| <= 1`` none is above 1 at any
        horizon when all counts, because the hop is causal.
    """
    h, _, k_v, k_p = gains
    plant = ThirdOrderPlant(tau, period)
    still = np.zeros(vehicles + 1)
    state, push = State(still, still, still), still.copy()
    past = [np.zeros(vehicles)] * (age + 1)
    heard, energy = np.zeros(vehicles), np.zeros(vehicles + 1)
    for step, command in enumerate(np.asarray(commands).tolist()):
        x, v, a = state
        past = [a[:-1], *past[:age]]
        if step >= age and (step - age) % interval == 0:
            heard = held * past[age] + (1.0 - held) * heard
        error = x[1:] - x[:-1] + h * v[1:]
        push[0] = command
        push[1:] = k_effective * heard - k_v * (v[1:] - v[:-1]) - k_p * error
        energy += a * a * (step >= since)
        state = plant.advance(state, push)
    return np.asarray(np.sqrt(energy[1:] / energy[:-1]), dtype=np.float64)


def lifted_growth(
    gains: Gains,
    tau: float,
    k_effective: float,
    period: float,
    interval: int,
    *,
    age: int = 0,
    held: float = 1.0,
    count: int = 300,
) -> float:
    """Largest eigenvalue of the hop over angles when a packet comes every `interval` periods.

    All `interval` frequencies that mix are kept, and the plant's own response is used.
    """
    lowest = 1e-2 * min(gains.k_p / gains.k_v, np.sqrt(gains.k_p)) * period * interval
    angle = np.geomspace(min(lowest, 1e-2), np.pi, count)
    turn = (angle[:, np.newaxis] + 2.0 * np.pi * np.arange(interval)) / interval
    silent = response(gains, tau, 0.0, period, turn / period)
    heard = response(gains, tau, k_effective, period, turn / period) - silent
    stay = np.exp(-1j * turn[..., np.newaxis] * np.arange(interval)).mean(axis=-1)
    lost = held / (1.0 - (1.0 - held) * np.exp(-1j * angle))
    heard = heard * stay * np.exp(-1j * turn * age) * lost[:, np.newaxis]
    hop = np.repeat(heard[..., np.newaxis], interval, axis=-1)
    every = np.arange(interval)
    hop[..., every, every] += silent
    return float(np.abs(np.linalg.eigvals(hop)).max())
