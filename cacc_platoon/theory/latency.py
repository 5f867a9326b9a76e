r"""How late the communicated acceleration may come.

A latency ``Delta`` on ``a_{i-1}`` turns the exact test into

.. math::
    f = \tau^2\omega^4 + B\omega^2 + C - 2 k k_p (1 - \cos\omega\Delta)
        - 2 k k_v \omega\sin\omega\Delta \ge 0 .

At one frequency the first ``Delta`` with ``f < 0`` is closed form (``t = tan(omega Delta/2)``
solves a quadratic), so the margin is a minimum over frequency alone. ``f`` is convex in tau with
its minimum at ``gamma/omega^2`` and concave in ``k``: the worst lag and gain are closed form too
(docs/theory.md, section 7 (V2V latency)).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.theory.errors import require, require_positive
from cacc_platoon.theory.exact import is_string_stable, propagation_margins
from cacc_platoon.theory.noise_interval import checked_interval, effective_gains

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from cacc_platoon.model.control import Gains

    Float = NDArray[np.float64]

__all__ = ["headway_for_latency", "latency_headroom", "latency_margin"]


def latency_headroom(
    time_headway: ArrayLike,
    k_v: ArrayLike,
    k_p: ArrayLike,
    tau: ArrayLike,
    k_effective: ArrayLike,
    *,
    omega: ArrayLike,
) -> Float:
    """First latency [s] at which ``|H(j omega)|`` exceeds one; infinite where none does.

    All arguments broadcast; `omega` in rad/s must be positive.

    Examples
    --------
    >>> latency_headroom(0.95, 0.63, 0.009, 0.5, 0.6, omega=[0.1, 100.0]).round(4).tolist()
    [0.486, inf]
    """
    h, v, p, lag, k, w = (
        np.asarray(x, dtype=np.float64) for x in (time_headway, k_v, k_p, tau, k_effective, omega)
    )
    B = 1.0 - k * k - 2.0 * lag * (v + h * p)
    C = p * (h * (2.0 * v + h * p) - 2.0 * (1.0 - k))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        slack = np.maximum((lag * lag * w * w + B) * w * w + C, 0.0) / (2.0 * k)
        discriminant = (v * w) ** 2 + slack * (2.0 * p - slack)
        t = slack / (v * w + np.sqrt(np.maximum(discriminant, 0.0)))
        delay = 2.0 * np.arctan(t) / w
    never = (discriminant < 0) | ~(k > 0) | ~np.isfinite(t)
    return np.asarray(np.where(never, np.inf, delay), dtype=np.float64)


def latency_margin(
    gains: Gains,
    rho: float,
    tau_max: float,
    *,
    reception: float = 1.0,
    k_effective: float | None = None,
) -> float:
    """Largest V2V latency [s] with string stability for all of I and every lag up to `tau_max`.

    Parameters
    ----------
    gains : Gains
        Controller.
    rho : float
        Linear signal-to-noise ratio, > 1.
    tau_max : float
        Largest actuation lag [s].
    reception : float, optional
        Smallest packet reception probability, losses counted as zero.
    k_effective : float, optional
        Ask for this effective gain at `tau_max` only.

    Returns
    -------
    float
        Latency margin [s]: 0 when not string stable, infinite when nothing is communicated.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> round(latency_margin(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5), 4)
    0.0818
    """
    require_positive("tau_max", tau_max, "s")
    ends = effective_gains(gains.k_a, rho, reception=reception, k_effective=k_effective)
    if not all(is_string_stable(gains, tau_max, k) for k in ends):
        return 0.0
    every_lag = k_effective is None
    return min(_least_headroom(gains, k, tau_max, every_lag=every_lag) for k in ends)


def _least_headroom(gains: Gains, k: float, tau_max: float, *, every_lag: bool) -> float:
    """Minimise `latency_headroom` over frequency (and lag) for one effective gain."""
    h, _, k_v, k_p = gains
    damping = k_v + h * k_p

    def headroom(omega: Float) -> Float:
        worst = np.minimum(tau_max, damping / omega**2)
        lag = worst if every_lag else np.full_like(omega, tau_max)
        return latency_headroom(h, k_v, k_p, lag, k, omega=omega)

    omega = _frequencies(gains, k, tau_max)
    delay = headroom(omega)
    best = float(np.min(delay))
    if not math.isfinite(best):
        return best
    padded = np.concatenate(([np.inf], delay, [np.inf]))
    valleys = np.flatnonzero((delay <= padded[:-2]) & (delay <= padded[2:]))
    for i in valleys[np.argsort(delay[valleys], kind="stable")[:4]]:
        low, high = omega[max(i - 1, 0)], omega[min(i + 1, omega.size - 1)]
        for _ in range(4):  # each pass narrows the bracket twentyfold
            local = np.linspace(low, high, 41)
            delay = headroom(local)
            j = int(np.argmin(delay))
            best = min(best, float(delay[j]))
            low, high = local[max(j - 1, 0)], local[min(j + 1, 40)]
    return best


def _frequencies(gains: Gains, k: float, tau_max: float) -> Float:
    """Lay a log grid over the relevant frequencies, dense where ``|H|`` comes closest to one.

    A design near the boundary has a dip of width ``sqrt(margin)`` at ``omega^2 = -B/(2 tau^2)``.
    """
    low, high = _frequency_range(gains, k, tau_max)
    omega = np.geomspace(low, high, 400)
    square = -propagation_margins(gains, tau_max, k).B / (2.0 * tau_max**2)
    if square <= 0:
        return omega
    offset = np.geomspace(1e-7, 0.3, 50)
    dip = math.sqrt(square) * np.concatenate((1.0 - offset, [1.0], 1.0 + offset))
    return np.union1d(omega, dip)


def _frequency_range(gains: Gains, k: float, tau_max: float) -> tuple[float, float]:
    """Find the frequencies outside which latency cannot matter more than inside."""
    h, _, k_v, k_p = gains
    low = 1e-3 * min(k_p / (k_v + h * k_p), math.sqrt(k_p))
    # (1 - k^2) w^2 > 2 k_p + k_v^2 + 2 k (k_p + k_v w) leaves f > 0 for every latency and lag
    spread = 1.0 - k * k
    b, c = k * k_v, 2.0 * k_p * (1.0 + k) + k_v**2
    if spread > 1e-12:
        return low, (b + math.sqrt(b * b + spread * c)) / spread + 2.0 * low
    return low, 1e3 * (1.0 / tau_max + k_v + math.sqrt(k_p))


def headway_for_latency(k_a: float, rho: float, tau_max: float, latency: float) -> float:
    """Headway [s] above which some gains tolerate this V2V latency for all of I (sufficient).

    ``2 (tau_0 + M k_a Delta)(1 - m k_a)/(1 - M^2 k_a^2)``: the paper's bound with the lag enlarged
    by the latency; for one known ``k`` it is ``2 (tau_0 + k Delta)/(1 + k)``. Strict, as the
    paper's: gains exist for every headway above it, with ``k_p`` small.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> round(headway_for_latency(0.5, 5.0, 0.5, latency=0.1), 4)
    1.05
    """
    require_positive("tau_max", tau_max, "s")
    require(
        0 <= latency < math.inf,
        f"latency = {latency:g} s is not a finite, nonnegative time: no headway follows from it. "
        "Give the largest V2V latency in seconds, 0 for none.",
    )
    low, high = checked_interval(k_a, rho)
    return 2.0 * (tau_max + high * latency) * (1.0 - low) / ((1.0 - high) * (1.0 + high))
