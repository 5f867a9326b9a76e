"""Many designs at once: sampled from the exact region, judged by quick estimates.

The estimates are for the search only. Whatever is handed out is certified exactly afterwards.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.model.control import Gains
from cacc_platoon.theory.latency import latency_headroom
from cacc_platoon.theory.noise_interval import effective_interval
from cacc_platoon.theory.region import exact_region, minimum_headway
from cacc_platoon.theory.sampled import sampled_stability_map

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    Float = NDArray[np.float64]

__all__ = ["Candidates", "Estimates", "sample_region"]

_LAGS = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
_PERIOD_STEPS = 10


class Candidates(NamedTuple):
    """Designs as arrays of one length: headway [s], ``k_a``, ``k_v`` [1/s], ``k_p`` [1/s^2]."""

    time_headway: Float
    k_a: Float
    k_v: Float
    k_p: Float

    def pick(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> Candidates:
        """Keep the selected designs."""
        return Candidates(*(column[index] for column in self))

    def gains(self, index: int) -> Gains:
        """One design."""
        return Gains(*(float(column[index]) for column in self))

    def __len__(self) -> int:
        """Count designs, not columns."""
        return int(self[0].size)


def sample_region(
    k_a: Iterable[float],
    headways: Float,
    k_p: Float,
    fractions: Float,
    *,
    rho: float,
    tau_max: float,
) -> Candidates:
    """Lay a grid into the exact robust regions of all pairs of ``k_a`` and headway.

    Parameters
    ----------
    k_a : iterable of float
        Feed-forward gains.
    headways : ndarray, shape (n,)
        Headways [s]; those below the exact minimum are left out.
    k_p : ndarray, shape (p,)
        Spacing gains [1/s^2]; those outside the region are left out.
    fractions : ndarray, shape (f,)
        Where between its bounds ``k_v`` lies, 0 to 1.
    rho, tau_max : float
        SNR and largest lag [s].

    Returns
    -------
    Candidates
        Robustly string stable designs.
    """
    columns: list[list[Float]] = [[], [], [], []]
    for gain in k_a:
        for headway in headways[headways >= minimum_headway(gain, rho, tau_max)]:
            region = exact_region(gain, float(headway), rho, tau_max)
            inside = k_p[k_p >= region.k_p_min]
            low, high = region.bounds(inside)
            k_v = low + np.multiply.outer(fractions, high - low)
            shape = k_v.shape
            grid = (np.full(shape, headway), np.full(shape, gain), k_v)
            for column, values in zip(
                columns, (*grid, np.broadcast_to(inside, shape)), strict=True
            ):
                column.append(values.ravel())
    stacked = [np.concatenate([*column, np.zeros(0)]) for column in columns]
    candidates = Candidates(*stacked)
    return candidates.pick((candidates.k_v > 0) & (candidates.k_p > 0))


class Estimates(NamedTuple):
    """Vectorised estimates for one SNR and largest lag."""

    rho: float
    tau_max: float

    def latency_margin(self, c: Candidates) -> Float:
        """Latency margins [s], minimum over a coarse frequency grid."""
        k = (
            np.stack(effective_interval(1.0, self.rho))[:, np.newaxis, np.newaxis]
            * c.k_a[:, np.newaxis]
        )
        h, v, p = (x[:, np.newaxis] for x in (c.time_headway, c.k_v, c.k_p))
        damping = v + h * p
        scale = np.minimum(p / damping, np.sqrt(p))
        high = 10.0 * (v + np.sqrt(p)) / (1.0 - k.max(axis=0) ** 2)
        omega = scale * 1e-2 * (high / (scale * 1e-2)) ** np.linspace(0.0, 1.0, 72)
        lag = np.minimum(self.tau_max, damping / omega**2)
        return np.asarray(
            latency_headroom(h, v, p, lag, k, omega=omega).min(axis=(0, 2)), dtype=np.float64
        )

    def tolerates_period(self, c: Candidates, period: float | Float) -> NDArray[np.bool_]:
        """Whether the sampled loop with a stale acceleration is string stable at `period`."""
        lag = (self.tau_max * _LAGS)[:, np.newaxis]
        result = np.ones(len(c), dtype=np.bool_)
        for end in effective_interval(1.0, self.rho):
            stable = sampled_stability_map(
                c.time_headway, c.k_v, c.k_p, lag, end * c.k_a, period=period, stale=True
            )
            result &= stable.all(axis=0)
        return result

    def critical_period(self, c: Candidates, known: float) -> Float:
        """Bisect for critical periods [s] between `known`, which all tolerate, and 2/gamma."""
        low = np.full(len(c), known)
        high = np.maximum(2.0 / (c.k_v + c.time_headway * c.k_p), low)
        for _ in range(_PERIOD_STEPS):
            middle = np.sqrt(low * high)
            good = self.tolerates_period(c, middle)
            low, high = np.where(good, middle, low), np.where(good, high, middle)
        return low

    def modes(self, c: Candidates) -> NDArray[np.complex128]:
        """Poles [1/s] at the largest lag, shape (n, 3)."""
        companion = np.zeros((len(c), 3, 3))
        companion[:, 1, 0] = companion[:, 2, 1] = 1.0
        companion[:, 0, 0] = -1.0 / self.tau_max
        companion[:, 0, 1] = -(c.k_v + c.time_headway * c.k_p) / self.tau_max
        companion[:, 0, 2] = -c.k_p / self.tau_max
        return np.asarray(np.linalg.eigvals(companion), dtype=np.complex128)

    def slowest_time_constant(self, c: Candidates) -> Float:
        """Slowest modes at the largest lag [s]."""
        rate = np.min(-self.modes(c).real, axis=1)
        return np.asarray(1.0 / np.maximum(rate, 1e-300), dtype=np.float64)

    def linf_gain(self, c: Candidates) -> Float:
        """Largest L1 norm at both ends of I, from the step response on a log grid of times.

        Partial fractions are good enough here: poles closer than 1e-6 are moved apart.
        """
        p = self.modes(c) * (1.0 + 1e-6 * np.arange(3))
        start, stop = 1e-2 / np.abs(p).max(axis=1), 40.0 / np.abs(p.real).min(axis=1)
        grid = np.concatenate(([0.0], np.linspace(0.0, 1.0, 180)))
        t = start[:, np.newaxis] * (stop / start)[:, np.newaxis] ** grid
        t[:, 0] = 0.0
        waves = np.exp(p[:, :, np.newaxis] * t[:, np.newaxis, :])
        slope = self.tau_max * np.stack(
            [(p[:, i] - p[:, i - 1]) * (p[:, i] - p[:, i - 2]) for i in range(3)], axis=1
        )
        worst = np.ones(len(c))
        offset = (c.time_headway * c.k_p)[:, np.newaxis]
        for end in effective_interval(1.0, self.rho):
            rest = (1.0 - end * c.k_a)[:, np.newaxis]
            weights = ((self.tau_max * p + rest) * p + offset) / slope
            remainder = np.einsum("ij,ijk->ik", weights, waves).real
            variation = np.abs(np.diff(remainder, axis=1)).sum(axis=1)
            worst = np.maximum(worst, variation)
        return worst
