"""Many designs at once: sampled from the exact region, judged by quick estimates.

The estimates are for the search only. Whatever is handed out is certified exactly afterwards.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.model.control import Gains
from cacc_platoon.theory.joint_loop import joint_headroom
from cacc_platoon.theory.latency import latency_headroom
from cacc_platoon.theory.multirate import GROWS, estimated_growth
from cacc_platoon.theory.noise_interval import effective_interval
from cacc_platoon.theory.region import exact_region, minimum_headway
from cacc_platoon.theory.sampled import sampled_stability_map

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    Float = NDArray[np.float64]

__all__ = ["Candidates", "Estimates", "sample_region"]

_LAGS = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
_LATE_LAGS = np.array([0.3, 1.0])
_DIP = np.array([0.8, 0.92, 0.98, 1.02, 1.08])
_PERIOD_STEPS, _CHUNK = 4, 256


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
    reception: float = 1.0,
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
    reception : float, optional
        Smallest packet reception probability, losses counted as zero.

    Returns
    -------
    Candidates
        Robustly string stable designs.
    """
    columns: list[list[Float]] = [[], [], [], []]
    for gain in k_a:
        for headway in headways[
            headways >= minimum_headway(gain, rho, tau_max, reception=reception)
        ]:
            region = exact_region(gain, float(headway), rho, tau_max, reception=reception)
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


def _least(values: Float) -> Float:
    """Minimum along the last axis, by a parabola through the least value and its neighbours."""
    count = values.shape[-1]
    at = np.clip(np.argmin(values, axis=-1), 1, count - 2)[..., np.newaxis]
    left, least, right = (np.take_along_axis(values, at + i, -1)[..., 0] for i in (-1, 0, 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        below = (right - left) ** 2 / (8.0 * (left - 2.0 * least + right))
    below = np.where(np.isfinite(below) & (below > 0), below, 0.0)
    return np.asarray(np.maximum(values.min(axis=-1) - below, 0.0), dtype=np.float64)


class Estimates(NamedTuple):
    """Vectorised estimates for one SNR, largest lag and loss; see `Requirements`."""

    rho: float
    tau_max: float
    reception: float = 1.0
    held: float = 1.0

    def _ends(self, c: Candidates) -> Float:
        """Effective gains at both ends of I, shape (2, n)."""
        interval = effective_interval(1.0, self.rho, reception=self.reception)
        return np.asarray(np.multiply.outer(np.array(interval), c.k_a), dtype=np.float64)

    def _frequencies(self, c: Candidates, count: int, highest: float | Float) -> Float:
        """Lay frequencies up to where latency may matter, and to `highest`, shape (n, count)."""
        h, v, p = (x[:, np.newaxis] for x in (c.time_headway, c.k_v, c.k_p))
        low = 1e-2 * np.minimum(p / (v + h * p), np.sqrt(p))
        spread = 1.0 - self._ends(c).max(axis=0) ** 2
        high = 10.0 * (v + np.sqrt(p)) / spread[:, np.newaxis]
        high = np.minimum(high, np.reshape(highest, (-1, 1)))
        grid = low * (high / low) ** np.linspace(0.0, 1.0, count)
        load = 2.0 * self.tau_max * (v + h * p) - 1.0
        dips = np.sqrt(np.maximum(load + self._ends(c).T ** 2, 0.0) / 2.0) / self.tau_max
        around = np.clip((dips[:, :, np.newaxis] * _DIP).reshape(len(c), 2 * _DIP.size), low, high)
        return np.sort(np.concatenate((grid, around), axis=1), axis=1)

    def latency_margin(self, c: Candidates) -> Float:
        """Latency margins [s] in continuous time, minimum over a coarse frequency grid."""
        h, v, p = (x[:, np.newaxis] for x in (c.time_headway, c.k_v, c.k_p))
        omega = self._frequencies(c, 48, np.inf)
        lag = np.minimum(self.tau_max, (v + h * p) / omega**2)
        k = self._ends(c)[:, :, np.newaxis]
        return np.asarray(
            latency_headroom(h, v, p, lag, k, omega=omega).min(axis=(0, 2)), dtype=np.float64
        )

    def joint_latency_margin(self, c: Candidates, period: float | Float) -> Float:
        """Latency margins [s] of the sampled loop; 0 where it is not stable without latency."""
        periods = np.broadcast_to(np.asarray(period, dtype=float), len(c))
        found = np.zeros(len(c))
        for part in np.split(np.arange(len(c)), np.arange(_CHUNK, len(c), _CHUNK)):
            kept = part[self._sampled_stable(c.pick(part), periods[part])]
            found[kept] = self._delay_borne(c.pick(kept), periods[kept])
        return found

    def _sampled_stable(self, c: Candidates, periods: Float) -> NDArray[np.bool_]:
        lag = (self.tau_max * _LAGS)[:, np.newaxis, np.newaxis]
        stable = sampled_stability_map(
            c.time_headway, c.k_v, c.k_p, lag, self._ends(c), period=periods, held=self.held
        )
        return np.asarray(stable.all(axis=(0, 1)), dtype=np.bool_)

    def _delay_borne(self, c: Candidates, periods: Float) -> Float:
        h, v, p = (x[:, np.newaxis] for x in (c.time_headway, c.k_v, c.k_p))
        delay = joint_headroom(
            h,
            v,
            p,
            (self.tau_max * _LATE_LAGS)[:, np.newaxis, np.newaxis, np.newaxis],
            self._ends(c)[:, :, np.newaxis],
            period=periods[:, np.newaxis],
            omega=self._frequencies(c, 32, np.pi / periods),
            held=self.held,
        )
        return np.asarray(_least(delay).min(axis=(0, 1)), dtype=np.float64)

    def critical_period(self, c: Candidates, margin: Float, latency: float, known: float) -> Float:
        """Estimate critical periods [s] above `known`, at which the joint `margin` is given.

        Tried first is the period at which the margin is used up if it falls as fast as the
        period grows, then halves, on a scale of ratios, of what is left between.
        """
        low, high = np.full(len(c), known), 2.0 / (c.k_v + c.time_headway * c.k_p)
        high = np.maximum(high, low)
        trial = np.clip(0.5 * (margin - latency + known), low, 0.9 * high)
        for _ in range(_PERIOD_STEPS):
            good = self.joint_latency_margin(c, trial) >= latency + trial
            low, high = np.where(good, trial, low), np.where(good, high, trial)
            trial = np.sqrt(low * high)
        return trial

    def bears_packets(
        self, c: Candidates, period: float, interval: int, latency: float
    ) -> NDArray[np.bool_]:
        """Say which designs do not grow with a packet every `interval` control periods.

        The largest lag comes first, since most that grow do so there.
        """
        found = np.zeros(len(c), np.bool_)
        for left in np.split(np.arange(len(c)), np.arange(_CHUNK, len(c), _CHUNK)):
            part = c.pick(left)
            angle = self._frequencies(part, 32, np.pi / (period * interval)) * period * interval
            good = np.arange(len(part))
            for lag in self.tau_max * _LATE_LAGS[::-1]:
                growth = estimated_growth(
                    tuple(column[:, np.newaxis] for column in part.pick(good)),
                    lag,
                    self._ends(part)[:, good, np.newaxis],
                    angle[good],
                    period=period,
                    interval=interval,
                    latency=latency,
                    held=self.held,
                )
                good = good[growth.max(axis=(0, 2)) <= GROWS]
            found[left[good]] = True
        return found

    def modes(self, c: Candidates, lag: float) -> NDArray[np.complex128]:
        """Poles [1/s] at a lag [s], shape (n, 3)."""
        companion = np.zeros((len(c), 3, 3))
        companion[:, 1, 0] = companion[:, 2, 1] = 1.0
        companion[:, 0, 0] = -1.0 / lag
        companion[:, 0, 1] = -(c.k_v + c.time_headway * c.k_p) / lag
        companion[:, 0, 2] = -c.k_p / lag
        return np.asarray(np.linalg.eigvals(companion), dtype=np.complex128)

    def slowest_time_constant(self, c: Candidates) -> Float:
        """Slowest modes at the largest lag [s]."""
        rate = np.min(-self.modes(c, self.tau_max).real, axis=1)
        return np.asarray(1.0 / np.maximum(rate, 1e-300), dtype=np.float64)

    def linf_gain(self, c: Candidates) -> Float:
        """Largest L1 norm at both ends of I and two lags, from step responses on a log grid.

        Partial fractions are good enough here: poles closer than 1e-6 are moved apart.
        """
        found = [np.zeros(0)]
        for start in range(0, len(c), _CHUNK):
            part = c.pick(np.arange(start, min(start + _CHUNK, len(c))))
            gains = (self._linf_gain(part, share * self.tau_max) for share in (1.0, 0.02))
            found.append(np.maximum(*gains))
        return np.concatenate(found)

    def _linf_gain(self, c: Candidates, lag: float) -> Float:
        p = self.modes(c, lag) * (1.0 + 1e-6 * np.arange(3))
        start, stop = 1e-2 / np.abs(p).max(axis=1), 40.0 / np.abs(p.real).min(axis=1)
        grid = np.concatenate(([0.0], np.linspace(0.0, 1.0, 120)))
        t = start[:, np.newaxis] * (stop / start)[:, np.newaxis] ** grid
        t[:, 0] = 0.0
        size = np.exp(p.real[:, :, np.newaxis] * t[:, np.newaxis])
        turn = p.imag[:, :, np.newaxis] * t[:, np.newaxis]
        waves = size * np.cos(turn), size * np.sin(turn)
        slope = lag * np.stack(
            [(p[:, i] - p[:, i - 1]) * (p[:, i] - p[:, i - 2]) for i in range(3)], axis=1
        )
        worst = np.ones(len(c))
        offset = (c.time_headway * c.k_p)[:, np.newaxis]
        for k in self._ends(c):
            rest = (1.0 - k)[:, np.newaxis]
            weights = ((lag * p + rest) * p + offset) / slope
            remainder = np.einsum("ij,ijk->ik", weights.real, waves[0])
            remainder -= np.einsum("ij,ijk->ik", weights.imag, waves[1])
            variation = np.abs(np.diff(remainder, axis=1)).sum(axis=1)
            worst = np.maximum(worst, variation)
        return worst
