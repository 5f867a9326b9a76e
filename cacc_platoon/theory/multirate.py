"""V2V at its own rate: whether errors grow when packets come every M control periods.

They do iff the spectral radius of the hop lifted over one V2V period (`lifted_hop`) exceeds one at
some angle. Whether it does, a motion that every vehicle repeats tells (`repeated_motion`); by how
much, the lifted hop. The search over angle, lag and the ends of I is numerical
(docs/theory.md, section 7 (V2V latency)).
"""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.theory.errors import require_positive
from cacc_platoon.theory.exact import TOLERANCE
from cacc_platoon.theory.lifted_hop import (
    MOST_INTERVAL,
    PacketTimes,
    first_order_radius,
    refined_peaks,
    spectral_radius,
)
from cacc_platoon.theory.noise_interval import effective_gains
from cacc_platoon.theory.repeated_motion import repeated_motion, repeated_motion_radius
from cacc_platoon.theory.sampled import in_unit_disc, lags_to_try, sampled_hop

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from cacc_platoon.model.control import Gains

    Float = NDArray[np.float64]

__all__ = [
    "HopGrowth",
    "bears_v2v_period",
    "critical_v2v_period",
    "estimated_growth",
    "largest_peak",
    "multirate_growth",
    "worst_multirate_growth",
]

ANGLES, _PEAKS, _ESTIMATED = 96, 4, 3
_RISE = 4.0  # a parabola through three points rises by half of the larger difference at most
_AROUND = 1.0 + np.array([-0.1, -0.03, -0.01, -1e-3, 0.0, 1e-3, 0.01, 0.03, 0.1])
GROWS = 1.0 + TOLERANCE
_ON_THEIR_WAY = 4
_TURNS = np.concatenate((np.geomspace(1e-4, 0.1, 16), np.linspace(0.1, np.pi, 40)[1:]))


class HopGrowth(NamedTuple):
    """How much slow or fast errors grow from vehicle to vehicle.

    Attributes
    ----------
    growth : float
        Factor per hop in the long run, at least 1: ``H = 1`` for signals that never change.
    omega : float
        Frequency at which it is largest [rad/s], 0 where nothing grows.
    tau, k_effective : float
        Lag [s] and effective gain at which it is.
    """

    growth: float
    omega: float
    tau: float
    k_effective: float


def estimated_growth(
    gains: tuple[Float, ...],
    tau: ArrayLike,
    k_effective: ArrayLike,
    angle: ArrayLike,
    *,
    period: float,
    interval: int,
    latency: float,
    held: float,
) -> Float:
    """First-order estimate of the spectral radius for arrays of designs, for a search.

    All arrays broadcast; see `multirate_growth`. `angle` is ``omega`` times the V2V period.
    """
    channel = PacketTimes.of(period, interval, latency, held)
    return first_order_radius(channel.hop(gains, tau, k_effective, angle, nearest=_ESTIMATED))


def _growth(packets: PacketTimes, gains: Gains, pairs: tuple[Float, Float]) -> HopGrowth:
    """Growth for pairs of lag and effective gain, each of shape (n, 1).

    A motion that every vehicle repeats decides whether there is any; then `spectral_radius` says
    how much.
    """
    if not _own_loops_stable(gains, pairs, packets.period):
        return HopGrowth(math.inf, 0.0, float(pairs[0][-1, 0]), float(pairs[1][-1, 0]))
    radius, near, row = _amplified(packets, gains, pairs)
    tau, k = (float(column[row, 0]) for column in pairs)
    if not radius > GROWS:
        return HopGrowth(1.0, 0.0, tau, k)
    angles = np.concatenate((packets.angles(gains, ANGLES), near * _AROUND))
    growth, angle, _ = largest_peak(
        lambda angle, tau, k: spectral_radius(packets.hop(gains, tau, k, angle)),
        np.unique(np.clip(angles, None, np.pi)),
        (np.array([[tau]]), np.array([[k]])),
    )
    omega = angle / (packets.period * packets.interval)
    return HopGrowth(max(growth, math.nextafter(1.0, 2.0)), omega, tau, k)


def _amplified(
    packets: PacketTimes, gains: Gains, pairs: tuple[Float, Float], *, enough: float = math.inf
) -> tuple[float, float, int]:
    """Say whether the worst pair amplifies, above one, at which angle, and which pair that is.

    With many packets on their way the lifted hop is smaller than a repeated motion's matrix.
    """
    if packets.latency > _ON_THEIR_WAY * packets.interval:
        angles = packets.angles(gains, ANGLES)
        return largest_peak(
            lambda angle, tau, k: spectral_radius(packets.hop(gains, tau, k, angle)),
            angles,
            pairs,
            enough=enough,
        )
    radius, turn, row = largest_peak(
        lambda turn, tau, k: repeated_motion_radius(packets, gains, tau, k, turn),
        _TURNS,
        pairs,
        enough=enough,
    )
    tau, k = (float(column[row, 0]) for column in pairs)
    motion = complex(repeated_motion(packets, gains, tau, k, turn))
    return radius, abs(cmath.phase(motion)), row


def _own_loops_stable(gains: Gains, pairs: tuple[Float, Float], period: float) -> bool:
    h, _, k_v, k_p = gains
    hop = sampled_hop(h, k_v, k_p, *pairs, period=period)
    return bool(in_unit_disc(hop.loop, np.asarray(period)).all())


def largest_peak(
    measure: Callable[[Float, Float, Float], Float],
    places: Float,
    pairs: tuple[Float, Float],
    *,
    enough: float = math.inf,
) -> tuple[float, float, int]:
    """Close in on the highest peaks, as far as is `enough`: height, place, row of the pair.

    Every measure is one at the start, from where it falls or rises.
    """
    size = measure(places, *pairs)
    top, first = divmod(int(np.argmax(size)), places.size)
    if size[top, first] > enough:
        return float(size[top, first]), float(places[first]), top
    padded = np.pad(size, ((0, 0), (1, 1)), constant_values=((0, 0), (np.inf, -np.inf)))
    row, at = np.nonzero((size >= padded[:, :-2]) & (size >= padded[:, 2:]))
    if not row.size:
        return 1.0, 0.0, len(size) - 1
    best = np.argsort(-size[row, at], kind="stable")[:_PEAKS]
    row, at = row[best], at[best]
    peak = size[row, at]
    rise = peak - np.minimum(size[row, at - 1], size[row, np.minimum(at + 1, places.size - 1)])
    if enough < np.inf and (peak + _RISE * rise <= enough).all():
        return float(size[top, first]), float(places[first]), top
    low, high = places[np.maximum(at - 1, 0)], places[np.minimum(at + 1, places.size - 1)]
    tau, k = (column[row] for column in pairs)
    found, local = refined_peaks(lambda near: measure(near, tau, k), low, high)
    top = int(np.argmax(found))
    return float(found[top]), float(local[top]), int(row[top])


def multirate_growth(
    gains: Gains,
    tau: float,
    k_effective: float,
    period: float,
    interval: int,
    *,
    latency: float = 0.0,
    held: float = 1.0,
) -> HopGrowth:
    """Growth per hop when a packet comes every `interval` control periods and is held.

    All vehicles send at the same control instants.

    Parameters
    ----------
    gains : Gains
        Controller.
    tau, k_effective : float
        Lag [s] and ``k_a E[w]``; times the reception where a lost packet counts as zero.
    period : float
        Control period ``T`` [s].
    interval : int
        Control periods per packet ``M``.
    latency : float, optional
        Constant V2V latency [s], rounded up to control periods.
    held : float, optional
        Packet reception probability of a receiver that holds the last packet that arrived: exact
        in the mean.

    Returns
    -------
    HopGrowth
        Supremum over frequency of the spectral radius of the hop lifted over one V2V period, by a
        search over frequency (numerical); infinite when the vehicle's own loop is unstable.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> found = multirate_growth(Gains(0.95, 0.5, 0.63, 0.009), 0.5, 0.6, 0.01, interval=20)
    >>> round(found.growth, 6), round(found.omega, 2)
    (1.002996, 0.39)
    """
    require_positive("tau", tau, "s")
    packets = PacketTimes.of(period, interval, latency, held)
    return _growth(packets, gains, (np.array([[tau]]), np.array([[k_effective]])))


def worst_multirate_growth(
    gains: Gains,
    rho: float,
    tau_max: float,
    period: float,
    interval: int,
    *,
    latency: float = 0.0,
    held: float = 1.0,
    reception: float = 1.0,
    k_effective: float | None = None,
) -> HopGrowth:
    """`multirate_growth`, largest over both ends of I and 5 lags up to `tau_max`.

    Parameters
    ----------
    rho, tau_max, reception, k_effective
        As in `is_sampled_string_stable`.
    gains, period, interval, latency, held
        As in `multirate_growth`.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> A = Gains(0.95, 0.5, 0.63, 0.009)
    >>> [worst_multirate_growth(A, 5.0, 0.5, 0.01, n).growth > 1 for n in (15, 16)]
    [False, True]
    """
    packets = PacketTimes.of(period, interval, latency, held)
    return _growth(packets, gains, _pairs(gains, rho, tau_max, reception, k_effective))


def bears_v2v_period(
    gains: Gains,
    rho: float,
    tau_max: float,
    period: float,
    interval: int,
    *,
    latency: float = 0.0,
    held: float = 1.0,
    reception: float = 1.0,
    k_effective: float | None = None,
) -> bool:
    """Whether nothing grows: `worst_multirate_growth` without looking for how much.

    Parameters
    ----------
    gains, rho, tau_max, period, interval, latency, held, reception, k_effective
        As in `worst_multirate_growth`.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> A = Gains(0.95, 0.5, 0.63, 0.009)
    >>> [bears_v2v_period(A, 5.0, 0.5, 0.01, n) for n in (15, 16)]
    [True, False]
    """
    packets = PacketTimes.of(period, interval, latency, held)
    pairs = _pairs(gains, rho, tau_max, reception, k_effective)
    if not _own_loops_stable(gains, pairs, period):
        return False
    return not _amplified(packets, gains, pairs, enough=GROWS)[0] > GROWS


def _pairs(
    gains: Gains, rho: float, tau_max: float, reception: float, k_effective: float | None
) -> tuple[Float, Float]:
    ends = effective_gains(gains.k_a, rho, reception=reception, k_effective=k_effective)
    lags = lags_to_try(tau_max, k_effective)
    lag, k = np.meshgrid(lags[:: -max(len(lags) // 4, 1)][::-1], ends)
    return lag.reshape(-1, 1), k.reshape(-1, 1)


def critical_v2v_period(
    gains: Gains,
    rho: float,
    tau_max: float,
    period: float,
    *,
    latency: float = 0.0,
    held: float = 1.0,
    reception: float = 1.0,
    k_effective: float | None = None,
    kept_at: int = 0,
) -> float:
    """Longest V2V period [s], a multiple of the control period, at which nothing grows.

    Parameters
    ----------
    gains, rho, tau_max, period, latency, held, reception, k_effective
        As in `worst_multirate_growth`.
    kept_at : int, optional
        An interval at which nothing is known to grow, to begin with.

    Returns
    -------
    float
        Found by doubling and halving at the largest lag, then by all lags, so that a band of growth
        between shorter periods that were not tried could be missed; 0 when errors grow although a
        packet comes every control period, infinite when nothing grows at 256 of them.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> critical_v2v_period(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5, 0.01)
    0.15
    """
    packets = PacketTimes.of(period, 1, latency, held)
    pairs = _pairs(gains, rho, tau_max, reception, k_effective)
    slowest = pairs[0][:, 0] == np.max(pairs[0])

    def grows(interval: int, rows: slice | NDArray[np.bool_] = slice(None)) -> bool:
        now = packets._replace(interval=interval)
        found, _, _ = _amplified(now, gains, (pairs[0][rows], pairs[1][rows]), enough=GROWS)
        return found > GROWS

    if not kept_at and (not _own_loops_stable(gains, pairs, period) or grows(1)):
        return 0.0
    low = max(kept_at, 1)
    high = 2 * low
    while high <= MOST_INTERVAL and not grows(high, slowest):
        low, high = high, 2 * high
    if high > MOST_INTERVAL and not grows(MOST_INTERVAL, slowest):
        low = high = MOST_INTERVAL
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if grows(middle, slowest) else (middle, high)
    while low > max(kept_at, 1) and grows(low):
        low -= 1
    if low == MOST_INTERVAL:
        return math.inf
    return round(low * period, 12)
