"""What a run did, in numbers: errors, hops, length, gaps, comfort, safety; nothing is judged here.

Samples that are missing in a bag are NaN in its arrays and left out of every number.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cacc_platoon.analysis.age import LinkReception, link_reception
from cacc_platoon.analysis.clocks import ClockUse, clock_use
from cacc_platoon.analysis.fallback import FallbackUse, fallback_use
from cacc_platoon.analysis.limits import LimitUse, limit_use
from cacc_platoon.analysis.monitor import MonitorUse, monitor_use
from cacc_platoon.analysis.noise import LinkNoise, link_noise
from cacc_platoon.model.leader import largest_acceleration, least_accelerations
from cacc_platoon.simulation import Trajectory
from cacc_platoon.simulation.trajectory import Array, first_collision

SETTLING_FRACTION = 0.05
"""A spacing error has settled once it stays within this fraction of its peak."""

STILL = 1e-9
"""Speed difference [m/s] below which nobody closes in."""


class PlatoonLength(NamedTuple):
    """x_0 - x_N [m] at the first and the last sample, and its largest."""

    initial: float
    max: float
    final: float


@dataclass(frozen=True)
class Metrics:
    """Numbers of one run; arrays are over followers 1..N unless stated otherwise.

    Attributes
    ----------
    duration : float
        Time from the first to the last sample [s].
    max_abs_spacing_error, time_of_max : ndarray
        max_t |delta_i| [m], and when it was first reached [s].
    rms_spacing_error, l2_spacing_error : ndarray
        Root mean square [m] and sqrt(T sum delta_i^2) [m s^0.5].
    final_spacing_error : ndarray
        delta_i at the last sample [m].
    settling_time : ndarray
        Time after which |delta_i| stays within 5 % of its peak [s]; NaN when it has not settled.
    hop_ratio_max, hop_ratio_l2 : ndarray, shape (N - 1,)
        Ratio of the norm of delta_i to that of delta_{i-1}, i = 2..N; NaN where the latter is 0.
    max_abs_acceleration, rms_acceleration, max_abs_jerk, rms_jerk : ndarray, shape (N + 1,)
        Of vehicles 0..N [m/s^2], [m/s^3]; the leader's largest is that of its profile, between
        samples too; jerk is (a(k+1) - a(k)) / T.
    min_gap, min_time_headway, mean_time_headway : ndarray
        Smallest x_{i-1} - x_i [m] less the length of the vehicle ahead; time headway kept,
        (x_{i-1} - x_i - d) / v_i [s] where v_i > 0.
    sure_min_gap : ndarray
        What no gap falls below between the samples either [m].
    min_time_to_collision : ndarray
        Smallest gap over closing speed [s]; infinite when nobody closed in.
    platoon_length : PlatoonLength
        x_0 - x_N.
    collision : bool
        Whether any gap reached 0.
    first_collision : tuple of (follower, time) or None
        Who and when [s].
    noise : list of LinkNoise
        Realised noise per link.
    reception : list of LinkReception
        Packet loss and age of information per link.
    fallback : list of FallbackUse
        Who may fall back to a law without V2V, and did.
    limits : list of LimitUse
        On whom limits of the actuator may act, and did.
    clocks : list of ClockUse
        How the samples of those came that keep time by clocks.
    monitor : list of MonitorUse
        Who compares packets with what is measured, and said that rho was violated.
    """

    duration: float
    max_abs_spacing_error: Array
    time_of_max: Array
    rms_spacing_error: Array
    l2_spacing_error: Array
    final_spacing_error: Array
    settling_time: Array
    hop_ratio_max: Array
    hop_ratio_l2: Array
    max_abs_acceleration: Array
    rms_acceleration: Array
    max_abs_jerk: Array
    rms_jerk: Array
    min_gap: Array
    sure_min_gap: Array
    min_time_headway: Array
    mean_time_headway: Array
    min_time_to_collision: Array
    platoon_length: PlatoonLength
    collision: bool
    first_collision: tuple[int, float] | None
    noise: list[LinkNoise]
    reception: list[LinkReception]
    fallback: list[FallbackUse]
    limits: list[LimitUse]
    clocks: list[ClockUse]
    monitor: list[MonitorUse]


def compute_metrics(run: Trajectory) -> Metrics:
    """Compute everything that a run's arrays say.

    Parameters
    ----------
    run : Trajectory
        Of a simulation or a bag; the same arrays give the same numbers to the last bit.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> from cacc_platoon.simulation import simulate
    >>> metrics = compute_metrics(simulate(Scenario.from_values({}), "expected"))
    >>> metrics.max_abs_spacing_error[[0, -1]].round(6).tolist()
    [1.596227, 1.544609]
    """
    step = run.scenario.run.step
    error = np.abs(run.spacing_error)
    peak = _over_time(np.nanmax, error)
    energy = _l2(run.spacing_error, step)
    acceleration, jerk = run.acceleration, np.diff(run.acceleration, axis=0) / step
    headway = _headway(run)
    collided = _first_collision(run)
    return Metrics(
        duration=float(run.time[-1]),
        max_abs_spacing_error=peak,
        time_of_max=_time_of_max(error, run.time),
        rms_spacing_error=_rms(run.spacing_error),
        l2_spacing_error=energy,
        final_spacing_error=_last(run.spacing_error),
        settling_time=_settling_time(error, peak, run.time),
        hop_ratio_max=_hop_ratio(peak),
        hop_ratio_l2=_hop_ratio(energy),
        max_abs_acceleration=_largest_accelerations(run),
        rms_acceleration=_rms(acceleration),
        max_abs_jerk=_over_time(np.nanmax, np.abs(jerk)),
        rms_jerk=_rms(jerk),
        min_gap=_over_time(np.nanmin, run.gap),
        sure_min_gap=_over_time(np.nanmin, _least_between(run)),
        min_time_headway=_over_time(np.nanmin, headway),
        mean_time_headway=_over_time(np.nanmean, headway),
        min_time_to_collision=time_to_collision(run),
        platoon_length=_length(run),
        collision=collided is not None,
        first_collision=collided,
        noise=link_noise(run),
        reception=link_reception(run),
        fallback=fallback_use(run),
        limits=limit_use(run),
        clocks=clock_use(run),
        monitor=monitor_use(run),
    )


def _over_time(reduce: object, values: Array) -> Array:
    """Reduce over samples, NaN where a column has none."""
    if not len(values):
        return np.full(values.shape[1], np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.asarray(reduce(values, axis=0), np.float64)  # type: ignore[operator]


def _largest_accelerations(run: Trajectory) -> Array:
    """Return max |a_i| of vehicles 0..N; under a held command a follower's are at samples."""
    largest = _over_time(np.nanmax, np.abs(run.acceleration))
    if len(run.time):
        profile = run.scenario.leader_profile()
        largest[0] = np.fmax(largest[0], largest_acceleration(profile, float(run.time[-1])))
    return largest


def _rms(values: Array) -> Array:
    return np.sqrt(_over_time(np.nanmean, values**2))


def _l2(values: Array, step: float) -> Array:
    missing = ~np.isfinite(values).any(axis=0)
    return np.where(missing, np.nan, np.sqrt(step * np.nansum(values**2, axis=0)))


def _hop_ratio(norm: Array) -> Array:
    ratio = np.full(max(len(norm) - 1, 0), np.nan)
    np.divide(norm[1:], norm[:-1], out=ratio, where=norm[:-1] > 0)
    return ratio


def _time_of_max(error: Array, time: Array) -> Array:
    filled = np.where(np.isfinite(error), error, -1.0)
    index = filled.argmax(axis=0)
    return np.where(filled.max(axis=0) > 0, time[index], np.nan)


def _last(values: Array) -> Array:
    known = np.isfinite(values)
    index = len(values) - 1 - known[::-1].argmax(axis=0)
    found: Array = values[index, np.arange(values.shape[1])]
    return found


def _settling_time(error: Array, peak: Array, time: Array) -> Array:
    """Return when the error last exceeded its band; NaN when it ends outside of it."""
    above = error > SETTLING_FRACTION * peak
    last = len(time) - 1 - above[::-1].argmax(axis=0)
    settled = np.where(last + 1 < len(time), time[np.minimum(last + 1, len(time) - 1)], np.nan)
    return np.where(above.any(axis=0), settled, np.where(np.isfinite(peak), 0.0, np.nan))


def _headway(run: Trajectory) -> Array:
    """Return the time headway kept, (gap - d)/v_i [s], NaN where the vehicle stands."""
    speed = run.velocity[:, 1:]
    free = run.spacing - run.scenario.platoon.standstill_distance
    headway = np.full(free.shape, np.nan)
    np.divide(free, speed, out=headway, where=speed > STILL)
    return headway


def _least_between(run: Trajectory) -> Array:
    """Return what the gap stays above from each sample to the next [m], shape (samples - 1, N).

    Under a held command an acceleration goes from one sample's value to the next without turning,
    so that the gap lies above the parabola of the least relative acceleration of the two. A leader
    may do between samples what no sample shows: its profile says.
    """
    T = run.scenario.run.step
    least = np.minimum(run.acceleration[1:], run.acceleration[:-1])[:, :-1]
    profile = run.scenario.leader_profile()
    least[:, 0] = np.minimum(least[:, 0], least_accelerations(profile, T, len(least) + 1))
    most = np.maximum(run.acceleration[1:], run.acceleration[:-1])[:, 1:]
    relative = least - most
    opening = (run.velocity[:, :-1] - run.velocity[:, 1:])[:-1]
    turning = np.divide(-opening, relative, out=np.full_like(opening, T), where=relative > 0.0)
    at = np.where(opening < 0.0, np.clip(turning, 0.0, T), np.where(relative < 0.0, T, 0.0))
    gap = run.gap
    lowest = np.minimum(gap[:-1] + (opening + 0.5 * relative * at) * at, gap[:-1])
    return np.asarray(np.minimum(lowest, gap[1:]), dtype=np.float64)


def time_to_collision(run: Trajectory) -> Array:
    """Return the smallest gap over closing speed of followers 1..N [s].

    Infinite when a follower was never faster than its predecessor.
    """
    closing = run.velocity[:, 1:] - run.velocity[:, :-1]
    times = np.full(closing.shape, np.inf)
    np.divide(run.gap, closing, out=times, where=closing > STILL)
    times[~np.isfinite(run.gap) | ~np.isfinite(closing)] = np.nan
    return _over_time(np.nanmin, np.maximum(times, 0.0))


def _length(run: Trajectory) -> PlatoonLength:
    length = run.platoon_length[np.isfinite(run.platoon_length)]
    if not length.size:
        return PlatoonLength(math.nan, math.nan, math.nan)
    return PlatoonLength(float(length[0]), float(np.max(length)), float(length[-1]))


def _first_collision(run: Trajectory) -> tuple[int, float] | None:
    sample = first_collision(run.gap)
    if sample is None:
        return None
    follower = run.scenario.indices[int(np.argmax(run.gap[sample] <= 0.0))]
    return follower, float(run.time[sample])


def describe_growth(peaks: Array) -> str:
    """Say how the largest errors went along the platoon.

    Examples
    --------
    >>> describe_growth(np.array([1.5, 1.4, 1.2]))
    'never growing'
    >>> describe_growth(np.array([1.0, 1.0, 1.1]))
    'growing at 1 of 2 hops'
    """
    known = peaks[np.isfinite(peaks)]
    if len(known) < 2:
        return "of one follower only"
    growing = int((np.diff(known) > 0).sum())
    if not growing:
        return "never growing"
    return (
        "growing at every hop"
        if growing == len(known) - 1
        else (f"growing at {growing} of {len(known) - 1} hops")
    )
