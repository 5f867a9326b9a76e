r"""The smallest gap over all brakings of the leader, not only over a straight stop.

In the mean system ``x_{i-1} - x_i`` answers the leader's acceleration by the impulse response
``kappa_i`` of ``H^{i-1} (1 - H)/s^2``. With a deceleration of at most ``A`` and a speed loss of at
most ``v_0`` the gap of vehicle i is at least

.. math:: d + h_w v_0 - A \int_S [\kappa_i]_+\,dt ,

``S`` the set of measure ``v_0/A`` where ``[kappa_i]_+`` is largest: that is attained by braking at
those times (docs/theory.md, section 9 (A bound for every vehicle and all time)).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.theory.errors import require, require_positive
from cacc_platoon.theory.transfer import is_internally_stable, poles

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from cacc_platoon.model.control import Gains

    Float = NDArray[np.float64]

__all__ = ["SHARES", "spacing_response", "worst_spacing"]

SHARES = (1.0, 0.5, 0.1, 0.01, 0.001)
"""Of the largest lag, at which a worst gap over all lags is looked for."""
_STEPS, _MOST_STEPS = 50, 30_000
_BLOCK = 256


def spacing_response(
    gains: Gains, tau: ArrayLike, k_effective: ArrayLike, vehicles: int, *, steps: float = _STEPS
) -> tuple[float, Float]:
    """Impulse responses of ``x_{i-1} - x_i`` to the leader's acceleration, vehicle by vehicle.

    Parameters
    ----------
    gains : Gains
        Controller; ``k_a`` is not used.
    tau, k_effective : array_like, shape (n,)
        Lags [s] and effective gains, together one platoon each.
    vehicles : int
        Followers.
    steps : float, optional
        Samples in the shortest time of the loop; they are exact at any step.

    Returns
    -------
    step : float
        Time between the samples [s].
    kappa : ndarray, shape (steps, vehicles, n)
        Responses [s], of platoons sampled at that step, until all modes but the slowest are dead.
        They tend to ``h_w``.
    """
    h, _, k_v, k_p = gains
    lags, k = np.atleast_1d(np.asarray(tau, dtype=float)), np.atleast_1d(k_effective)
    fastest = min(float(lags.max()), 1.0 / (k_v + h * k_p), 1.0 / math.sqrt(k_p))
    horizon = 16.0 / float(np.min(-poles(gains, lags)[:, 1].real)) + 4.0 * vehicles * h
    step = max(fastest / steps, horizon / _MOST_STEPS)
    count = math.ceil(horizon / step)

    size = 3 * vehicles + 2
    loop = np.zeros((lags.size, size, size))  # x and v of the leader, then x, v, a of each follower
    state = np.zeros((lags.size, size, 1))
    loop[:, 0, 1] = state[:, 1] = 1.0
    state[:, 4, 0] = k / lags
    for own in range(2, size, 3):
        ahead = max(own - 3, 0)
        loop[:, own, own + 1] = loop[:, own + 1, own + 2] = 1.0
        loop[:, own + 2, ahead] = k_p / lags
        loop[:, own + 2, ahead + 1] = k_v / lags
        if own > 2:
            loop[:, own + 2, ahead + 2] = k / lags
        loop[:, own + 2, own] = -k_p / lags
        loop[:, own + 2, own + 1] = -(k_v + h * k_p) / lags
        loop[:, own + 2, own + 2] = -1.0 / lags
    power, block = _exponential(loop * step), state
    while block.shape[-1] < min(_BLOCK, count):
        block = np.concatenate((block, power @ block), axis=-1)
        power = power @ power
    kappa = []
    for _ in range(0, count, block.shape[-1]):
        position = block[:, [0, *range(2, size, 3)]]
        kappa.append(np.moveaxis(position[:, :-1] - position[:, 1:], (1, 2, 0), (1, 0, 2)))
        block = power @ block
    return step, np.concatenate(kappa)[:count]


def _exponential(matrices: Float) -> Float:
    """Exponentials of square matrices, shape (n, m, m): a Taylor polynomial, scaled and squared."""
    norm = float(np.abs(matrices).sum(axis=-1).max())
    halvings = max(0, math.ceil(math.log2(norm)) + 3)
    scaled = matrices * 0.5**halvings
    term = found = np.eye(matrices.shape[-1]) + 0.0 * matrices
    for order in range(1, 13):
        term = term @ scaled / order
        found = found + term
    for _ in range(halvings):
        found = found @ found
    return np.asarray(found, dtype=np.float64)


def worst_spacing(
    gains: Gains,
    tau: ArrayLike,
    k_effective: ArrayLike,
    *,
    standstill_distance: float,
    speed: float,
    deceleration: float,
    vehicles: int = 1,
    steps: float = _STEPS,
) -> Float:
    """Least ``x_{i-1} - x_i`` [m] over all brakings of the leader, in the mean system.

    Parameters
    ----------
    gains : Gains
        Controller; ``k_a`` is not used.
    tau, k_effective : array_like, shape (n,) or ()
        Lags [s] and effective gains.
    standstill_distance : float
        ``d`` [m].
    speed : float
        Of all vehicles at first, and the most that the leader loses [m/s].
    deceleration : float
        The most that the leader brakes with [m/s^2].
    vehicles : int, optional
        Followers.
    steps : float, optional
        As in `spacing_response`.

    Returns
    -------
    ndarray, shape (vehicles,)
        One per follower, the least of all lags and gains given. No braking leads below it, and
        one leads to less than a few millimetres above with the default `steps`; minus infinity
        when not internally stable.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> how = {"standstill_distance": 5.0, "speed": 25.0, "deceleration": 8.0, "vehicles": 2}
    >>> worst_spacing(Gains(0.95, 0.5, 0.63, 0.009), 0.5, 0.4, **how).round(2).tolist()
    [4.84, 4.85]
    """
    require_positive("tau", float(np.min(np.asarray(tau))), "s")
    require_positive("speed", speed, "m/s")
    require_positive("deceleration", deceleration, "m/s^2")
    require(vehicles >= 1, f"vehicles = {vehicles} is below 1: nobody follows. Give 1 or more.")
    if not is_internally_stable(gains, float(np.max(np.asarray(tau)))):
        return np.full(vehicles, -math.inf)
    duration, rest = speed / deceleration, gains.time_headway
    step, kappa = spacing_response(gains, tau, k_effective, vehicles, steps=steps)
    lost = sum(_largest_integral(step, np.maximum(kappa, rest), duration, rest))
    lost = np.maximum(lost, duration * rest).max(axis=-1)
    return np.asarray(standstill_distance + rest * speed - deceleration * lost, dtype=np.float64)


def _largest_integral(
    step: float, kappa: Float, duration: float, rest: float
) -> tuple[Float, Float]:
    """Integrate responses over the set of that measure [s] where they are largest.

    Long ago every response has come to `rest`, so that no less need be taken anywhere.

    Returns
    -------
    integral, error : ndarray
        The integral is the least over c of the one of ``(kappa - c)_+`` and c times the measure.
        By the trapezoidal rule each is wrong by at most ``step^2/8`` times the variation of its
        slope, which is at most that of kappa's, taken from the samples.
    """
    bends = np.abs(np.diff(kappa, n=2, axis=0, prepend=rest, append=rest)).sum(axis=0)
    error = 0.125 * step * bends
    whole, part = divmod(duration, step)
    if whole >= len(kappa):
        more = duration - step * len(kappa)
        return np.asarray(step * kappa.sum(axis=0) + more * rest, dtype=np.float64), error
    at = len(kappa) - 1 - int(whole)
    kappa = np.sort(kappa, axis=0, kind="stable")  # a few runs: faster than a partition
    largest = step * kappa[at + 1 :].sum(axis=0) + part * kappa[at]
    return np.asarray(largest, dtype=np.float64), error
