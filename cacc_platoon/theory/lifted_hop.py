r"""The hop lifted over one V2V period: packets every M control periods, held between them.

The hop is periodic then. At an angle ``theta`` over one V2V period the M frequencies
``omega_p = (theta + 2 pi p)/(M T)`` mix, and the hop is a diagonal plus a matrix of rank one:

.. math:: G(\theta) = \mathrm{diag}(V/D_T) + u\,1^\top, \quad
          u_p = \frac{k}{M}\,\frac{N_a}{D_T}\,\frac{1 - z_p^{-M}}{1 - z_p^{-1}}\,z_p^{-n} F(\theta)

with ``V/D_T`` the sampled hop without V2V, ``k N_a/D_T`` what a communicated acceleration adds,
``n`` the latency in control periods, and ``F = p/(1 - (1 - p) e^{-j theta})`` of a receiver that
holds the last packet that arrived. Its eigenvalues are the roots of
``1 = sum_p u_p/(lambda - d_p)`` (docs/theory.md, section 7 (V2V latency)).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.theory.between_lags import between
from cacc_platoon.theory.errors import require, require_positive
from cacc_platoon.theory.sampled import hold_integrals, require_held, sampled_hop

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from cacc_platoon.model.control import Gains

    Float = NDArray[np.float64]
    Complex = NDArray[np.complex128]
    Parts = tuple[Complex, Complex]

__all__ = [
    "MOST_INTERVAL",
    "MOST_LATE",
    "PacketTimes",
    "first_order_radius",
    "mean_phase_size",
    "packet_interval",
    "refined_peaks",
    "spectral_radius",
]

MOST_INTERVAL = 256
"""Control periods per packet up to which is computed: so many frequencies mix."""

MOST_LATE = 100_000
"""Control periods that a packet may be late."""

_SHARES, _PASSES = np.linspace(0.0, 1.0, 13), 4
_NEAR, _ELIMINATIONS, _UNLIKELY, _SETTLED = (3, 12, 32), 8, 2.0, 1e-10


def packet_interval(v2v_period: float, period: float) -> int:
    """Count the control periods in a V2V period.

    Raises
    ------
    DesignError
        If `v2v_period` is no whole multiple of `period`, or longer than 256 of them.

    Examples
    --------
    >>> packet_interval(0.1, 0.01)
    10
    """
    require_positive("v2v_period", v2v_period, "s")
    require_positive("period", period, "s")
    ratio = v2v_period / period
    require(
        ratio <= MOST_INTERVAL,
        f"v2v_period = {v2v_period:g} s is more than {MOST_INTERVAL} control periods of "
        f"{period:g} s: its mixing frequencies are too many. Shorten it or lengthen the period.",
    )
    count = round(ratio)
    require(
        count >= 1 and abs(ratio - count) <= 1e-6 * count,
        f"v2v_period = {v2v_period:g} s is no whole multiple of the control period {period:g} s: "
        f"packets are sent at control instants. Give {max(count, 1) * period:g} s.",
    )
    return count


class PacketTimes(NamedTuple):
    """When packets come: interval and latency in control periods of `period` [s], and losses."""

    period: float
    interval: int
    latency: int
    held: float

    @classmethod
    def of(cls, period: float, interval: int, latency: float, held: float) -> PacketTimes:
        """Take the latency in seconds, rounded up to control periods, and refuse what is none."""
        require_positive("period", period, "s")
        require(
            1 <= interval <= MOST_INTERVAL,
            f"interval = {interval} is not from 1 to {MOST_INTERVAL} control periods: no packet "
            "comes then. Give a whole number in between.",
        )
        require(
            0 <= latency < math.inf,
            f"latency = {latency:g} s is not a finite, nonnegative time: no margin can cover it. "
            "Give the largest V2V latency in seconds.",
        )
        require(
            latency <= MOST_LATE * period,
            f"latency = {latency:g} s is more than {MOST_LATE} control periods of {period:g} s: no "
            "design bears that. Shorten it or lengthen the period.",
        )
        require_held(held)
        require(held > 0, "held = 0 leaves nothing to hold. Give a reception above 0.")
        return cls(period, interval, math.ceil(latency / period - 1e-9), held)

    @property
    def aliases(self) -> NDArray[np.int64]:
        """Number the frequencies that mix, the nearest to zero first: 0, -1, 1, -2, 2, ..."""
        order = np.arange(self.interval)
        return np.where(order % 2, -(order + 1) // 2, order // 2)

    def hop(
        self,
        gains: Gains | tuple[Float, ...],
        tau: ArrayLike,
        k: ArrayLike,
        angle: ArrayLike,
        *,
        nearest: int | None = None,
    ) -> Parts:
        """Return the diagonal and ``u`` of G, the aliases along a new last axis, nearest first.

        All but `nearest` broadcast.
        """
        T, count = self.period, self.interval
        h, _, k_v, k_p, lag, k, angle = (
            np.asarray(x, dtype=float)[..., np.newaxis] for x in (*gains, tau, k, angle)
        )
        alias = self.aliases[:nearest]
        turn = (angle + 2.0 * np.pi * alias) / count
        sine, cosine = np.sin(0.5 * turn), np.cos(0.5 * turn)
        d = 2.0 * sine / T * (1j * cosine - sine)
        hop = sampled_hop(h, k_v, k_p, lag, 0.0, period=T)
        a1, _, _ = hold_integrals(lag, np.asarray(T))
        own = ((hop.numerator[2] * d) + hop.numerator[1]) * d + hop.numerator[0]
        loop = ((d + hop.loop[2]) * d + hop.loop[1]) * d + hop.loop[0]
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.sin(0.5 * angle) * np.exp(-0.5j * angle) / count * (cosine / sine + 1j)
        mean = np.where(sine == 0.0, 1.0, mean)
        if self.latency:
            mean = mean * np.exp(-1j * turn * self.latency)
        if self.held != 1.0:
            mean = mean * self.held / (1.0 - (1.0 - self.held) * np.exp(-1j * angle))
        per_loop = 1.0 / loop
        return own * per_loop, k * (a1 * d * d * mean * per_loop)

    def shifted(self, parts: Parts, angle: ArrayLike, step: int) -> Parts:
        """Return the hop when each vehicle sends `step` control periods after its predecessor."""
        turn = (np.asarray(angle, dtype=float)[..., np.newaxis] + 2.0 * np.pi * self.aliases) / (
            self.interval
        )
        later = np.exp(1j * turn * step)
        return parts[0] * later, parts[1] * later

    def angles(self, gains: Gains, count: int) -> Float:
        """Lay angles from where a slow signal varies up to half a turn per V2V period."""
        h, _, k_v, k_p = gains
        span = self.period * self.interval
        low = 1e-3 * min(k_p / (k_v + h * k_p), math.sqrt(k_p)) * span
        slow = np.geomspace(min(low, 1e-2), np.pi, count // 2)
        return np.sort(np.concatenate((slow, np.linspace(slow[-2], np.pi, count // 2)[:-1])))


def mean_phase_size(parts: Parts) -> Float:
    """Size of the hop in the mean over phases: frequencies do not mix then."""
    diagonal, u = parts
    return np.asarray(np.abs(diagonal + u).max(axis=-1))


def first_order_radius(parts: Parts) -> Float:
    """Estimate the spectral radius from what the other aliases add to the mean hop."""
    diagonal, u = parts
    mean = diagonal[..., :1] + u[..., :1]
    far = (u[..., 1:] / (mean - diagonal[..., 1:])).sum(axis=-1)
    return np.asarray(np.abs(diagonal[..., 0] + u[..., 0] / (1.0 - far)))


def spectral_radius(parts: Parts) -> Float:
    """Spectral radius of ``diag(d) + u 1^T``; where it is below 0.9 it may be another eigenvalue's.

    Most aliases are fast signals, which a vehicle with a lag hardly passes on: the few that it does
    are enough for a start, and more where that does not settle.
    """
    order = np.argsort(-np.abs(parts[0]) - np.abs(parts[1]), axis=-1, kind="stable")
    diagonal, u = (np.take_along_axis(part, order, -1) for part in parts)
    radius = np.full(u.shape[:-1], np.nan)
    for near in _NEAR:
        left = np.isnan(radius)
        radius[left] = _eliminated(diagonal[left], u[left], near)
        if near >= u.shape[-1] or not np.isnan(radius).any():
            break
    return radius


def _eliminated(diagonal: Complex, u: Complex, near: int) -> Float:
    """Spectral radius by the first `near` aliases, the others eliminated; NaN if unsettled.

    With ``R`` the others' part of ``sum_p u_p/(lambda - d_p)``, the first ones have
    ``u/(1 - R(lambda))``, and ``R`` changes little with lambda.
    """
    others, heard = diagonal[..., near:], u[..., near:]
    size = min(near, u.shape[-1])
    matrix = np.empty((*u.shape[:-1], size, size), dtype=np.complex128)
    every = np.arange(size)
    far = root = np.zeros(u.shape[:-1], dtype=np.complex128)
    for _ in range(_ELIMINATIONS if others.shape[-1] else 1):
        last = root
        matrix[...] = (u[..., :near] / (1.0 - far[..., np.newaxis]))[..., np.newaxis]
        matrix[..., every, every] += diagonal[..., :near]
        roots = np.linalg.eigvals(matrix)
        at = np.argmax(np.abs(roots), axis=-1)[..., np.newaxis]
        root = np.take_along_axis(roots, at, -1)[..., 0]
        far = (heard / (root[..., np.newaxis] - others)).sum(axis=-1)
        moved = np.abs(root - last)
        if (moved < _SETTLED).all():
            break
    radius = np.abs(root)
    settled = (moved < _SETTLED) & (radius < _UNLIKELY)
    if near == _NEAR[-1] or not others.shape[-1]:
        settled[...] = True
    return np.where(settled, radius, np.nan)


def refined_peaks(size: Callable[[Float], Float], low: Float, high: Float) -> tuple[Float, Float]:
    """Close in on a peak of each row of `size` between `low` and `high`: its height and place."""
    rows = np.arange(low.size)
    for _ in range(_PASSES):
        local = between(low, high, _SHARES)
        found = size(local)
        top = np.argmax(found, axis=1)
        low = local[rows, np.maximum(top - 1, 0)]
        high = local[rows, np.minimum(top + 1, _SHARES.size - 1)]
    return found[rows, top], local[rows, top]
