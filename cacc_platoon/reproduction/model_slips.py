"""Where the paper's noise model, its example and its figures leave something open or slip."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.model import Gains, factor_variance
from cacc_platoon.reproduction.cases import CASES, DISTANCE, RHO, TAU_0, case_scenario
from cacc_platoon.reproduction.slip import Slip
from cacc_platoon.scenario.v2v_parameters import PAPER_BITS
from cacc_platoon.simulation import simulate
from cacc_platoon.theory import (
    effective_interval,
    sampled_mean_square_index,
    slowest_time_constant,
    snr_db_from_rho,
)
from cacc_platoon.theory.capacity import capacity
from cacc_platoon.theory.impulse import inverse_laplace
from cacc_platoon.theory.transfer import poles

if TYPE_CHECKING:
    from cacc_platoon.analysis.analyse import Report
    from cacc_platoon.simulation.trajectory import Array

A, C = (Gains(*case[1:5]) for case in (CASES[0], CASES[2]))
CAR = 4.5
"""Length of a car [m] in the check of point vehicles."""

_COARSE = {"run.step": 0.1, "run.duration": 100.0, "v2v.noise": "expected"}


def model_slips(reports: Mapping[str, Report]) -> Iterator[Slip]:
    """Yield the slips of the noise model, the example and its figures, from runs of the cases."""
    a = reports["A"]
    yield from noise_values()
    yield attained_ratio(a)
    yield first_error(a)
    yield leader_lag(a)
    yield initial_speed()
    yield redraw_period(a)
    yield single_run(a)
    yield not_convergence(a)
    yield slow_modes(reports)
    yield point_vehicles()


def noise_values() -> Iterator[Slip]:
    """Yield what values n bits can give w."""
    words = np.arange(2 ** len(PAPER_BITS))
    factors = 1.0 - 1.0 / RHO + words / (2.0 ** (len(PAPER_BITS) - 1) * RHO)
    top = effective_interval(1.0, RHO).high
    largest = 1.0 - 1.0 / RHO + sum(2.0**-j for j in range(len(PAPER_BITS))) / RHO
    yield Slip(
        "Sec. III-A, equation (5), noise factor",
        "1 - 1/rho <= w <= 1 + 1/rho",
        "the largest w of n bits is 1 + 1/rho - 2^(1-n)/rho; designing with the closed interval is "
        "on the safe side",
        f"n = {len(PAPER_BITS)}, rho = {RHO:g}: largest {largest:.9f}, not {top:g}",
        largest < top and math.isclose(largest, factors[-1], rel_tol=1e-15),
    )
    apart = np.diff(np.unique(factors))
    yield Slip(
        "Sec. III-A",
        "the communicated signal takes any value between (1 - 1/rho) a and (1 + 1/rho) a",
        "one of 2^n values, equally far apart",
        f"{len(apart) + 1} values of w, {float(np.max(apart)):.3e} apart",
        len(apart) + 1 == 2 ** len(PAPER_BITS) and float(np.ptp(apart)) < 1e-12,
    )


def attained_ratio(report: Report) -> Slip:
    """Look at when the SNR of a run is rho: where the word of zeros occurs."""
    chance = math.prod(1.0 - p for p in PAPER_BITS)
    least = min(link.snr_db for link in report.measured.noise)
    return Slip(
        "Definition 3",
        "rho = min over t of |s(t)|/|n(t)|",
        "a run has at least rho, and rho only if all bits of some draw are 0: |w - 1| = 1/rho at "
        "w = 1 - 1/rho alone",
        f"probability of that word {chance:.4e} a draw; recorded run A {least:.4f} dB, rho is "
        f"{snr_db_from_rho(RHO):.4f} dB",
        0.0 < chance < 1e-3 and least >= snr_db_from_rho(RHO) - 1e-9,
    )


def first_error(report: Report) -> Slip:
    """delta_1 follows a_0, not a delta_0, which does not exist."""
    run = report.expectation
    computed = _first_error(report, run.acceleration[:, 0])
    apart = float(np.max(np.abs(computed - run.spacing_error[:, 0])))
    peak = float(np.max(np.abs(run.spacing_error[:, 0])))
    return Slip(
        "Sec. III-B, equation (14), error propagation",
        "delta_i = H delta_{i-1} for every follower, and nothing is said of the first",
        "delta_1 = Phi a_0, Phi = ((h_w k - tau) s + k + h_w k_v - 1)/D with k = k_a E[w]: there "
        "is no delta_0",
        f"Phi a_0 of the continuous loop is within {apart:.2e} m of delta_1 of the expectation run "
        f"A, max|delta_1| = {peak:.6f} m",
        apart < 0.01 * max(peak, 1e-9),
    )


def leader_lag(report: Report) -> Slip:
    """Whether a_0 is the leader's acceleration or its command."""
    command = report.expectation.acceleration[:, 0]
    step = report.expectation.scenario.run.step
    time = step * np.arange(len(command))
    actual = _convolved(np.exp(-time / TAU_0) / TAU_0, command, step)
    peaks = [float(np.max(np.abs(_first_error(report, a)))) for a in (command, actual)]
    return Slip(
        "Sec. IV",
        "a_0(t) is a 'perturbation on its acceleration', U(t) the 'acceleration input'",
        "taken here as the leader's actual acceleration; as the input of a leader with lag tau_0 "
        "it would give other errors, by little",
        f"case A, mean system: max|delta_1| {peaks[0]:.4f} m or {peaks[1]:.4f} m",
        0.0 < abs(peaks[1] - peaks[0]) < 0.01 * peaks[0],
    )


def initial_speed() -> Slip:
    """Compare two initial speeds: from equilibrium, errors do not depend on it."""
    speeds = (15.0, 25.0)
    runs = [
        simulate(case_scenario(CASES[0], {**_COARSE, "platoon.initial_speed": v})) for v in speeds
    ]
    errors = [run.spacing_error for run in runs]
    lengths = [float(run.platoon_length[0]) for run in runs]
    apart = float(np.max(np.abs(errors[1] - errors[0])))
    return Slip(
        "Sec. IV",
        "initial state, speed and the period at which noise is redrawn are not given",
        "from equilibrium spacing errors do not depend on the speed, the platoon's length does; "
        "taken here as equilibrium, 25 m/s, redrawn every control period",
        f"case A at {speeds[0]:g} and {speeds[1]:g} m/s: delta differs by at most {apart:.1e} m, "
        f"lengths at rest {lengths[0]:g} and {lengths[1]:g} m",
        apart < 1e-9 and lengths[1] > lengths[0],
    )


def redraw_period(report: Report) -> Slip:
    """Compare two redraw periods: not the mean depends on it, the mean square does."""
    mean, variance = report.measured.noise[0].expected_mean, factor_variance(RHO, PAPER_BITS)
    index = [
        sampled_mean_square_index(A, TAU_0, A.k_a * mean, 0.01, variance=variance, hold=hold)
        for hold in (1, 10)
    ]
    return Slip(
        "Sec. III-A",
        "how often z_{i,j}(t) changes is not given",
        "the mean does not depend on it; how far single runs are from the mean does",
        f"case A sampled at 10 ms: mean-square index {index[0]:.3e} when w is redrawn every "
        f"10 ms, {index[1]:.3e} every 100 ms",
        index[1] > 2.0 * index[0] > 0.0,
    )


def single_run(report: Report) -> Slip:
    """Look for the trend from vehicle to vehicle in noisy runs: it is too small."""
    expected = report.expected.max_abs_spacing_error
    if report.ensemble is None:
        peaks = report.measured.max_abs_spacing_error[np.newaxis]
    else:
        peaks = report.ensemble.max_abs_spacing_error
    monotone = int((np.diff(peaks, axis=1) <= 0).all(axis=1).sum())
    per_hop = 100.0 * (1.0 - (expected[-1] / expected[0]) ** (1.0 / (len(expected) - 1)))
    return Slip(
        "Figs. of delta_i",
        "spacing errors, in the presence of noise, as evidence of string stability",
        "that is seen in the mean system; one noisy run neither shows nor refutes it",
        f"case A: max|delta_i| falls by {per_hop:.2f} % a hop in the expectation run; it falls at "
        f"every hop in {monotone} of {len(peaks)} noisy runs",
        monotone < len(peaks) and not (np.diff(expected) > 0).any(),
    )


def not_convergence(report: Report) -> Slip:
    """Measure how far a noisy run, and the mean of many, is from the mean system."""
    run, mean = report.run.trajectory.spacing_error, report.expectation.spacing_error
    rows = min(len(run), len(mean))
    apart = float(np.nanmax(np.abs(run[:rows] - mean[:rows])))
    beside = ""
    if report.ensemble is not None:
        close = float(np.max(np.abs(report.ensemble.mean - mean[: len(report.ensemble.mean)])))
        beside = f"; the mean of {report.ensemble.runs} runs {close:.4f} m"
    return Slip(
        "Sec. III-B",
        "the states 'converge to the states of the deterministic state equation'",
        "their expectation is the solution of it; a single run keeps its distance",
        f"case A: recorded run and expectation run differ by up to {apart:.4f} m in delta{beside}",
        apart > 1e-6,
    )


def slow_modes(reports: Mapping[str, Report]) -> Slip:
    """Gains from S leave a mode of minutes."""
    constants = [slowest_time_constant(one, TAU_0) for one in (A, C)]
    run = reports["A"].expectation
    left = float(run.platoon_length[-1] - run.platoon_length[0])
    return Slip(
        "Sec. IV",
        "gains are chosen from S; how fast errors vanish is not considered",
        "just above h_lb, S holds small k_p only, which leaves a slow mode",
        f"slowest time constants {constants[0]:.0f} s (A) and {constants[1]:.0f} s (C); at "
        f"{run.time[-1]:g} s the platoon of the expectation run A is {left:.2f} m from its length "
        "at rest",
        min(constants) > 60.0,
    )


def point_vehicles() -> Slip:
    """Vehicles are points: d includes one."""
    flows = [capacity(A.time_headway, 30.0, d) for d in (DISTANCE, DISTANCE + CAR)]
    return Slip(
        "Definition 1",
        "d is the minimum spacing between adjacent vehicles, positions are those of points",
        "d includes the vehicle: the gap between bumpers is shorter by its length",
        f"d = {DISTANCE:g} m and cars of {CAR:g} m: {DISTANCE - CAR:g} m between bumpers at "
        f"standstill; if d were that gap, {flows[1]:.0f} instead of {flows[0]:.0f} vehicles/h and "
        f"lane at h_w = {A.time_headway:g} s, 30 m/s",
        flows[1] < flows[0],
    )


def _first_error(report: Report, a_0: Array) -> Array:
    """Return delta_1 = Phi a_0 of case A's mean system under the continuous law."""
    k = A.k_a * report.measured.noise[0].expected_mean
    step = report.expectation.scenario.run.step
    time = step * np.arange(len(a_0))
    numerator = [0.0, A.time_headway * k - TAU_0, k + A.time_headway * A.k_v - 1.0]
    scaled = np.array([numerator], dtype=np.float64) / TAU_0
    times = np.asarray(time[np.newaxis], dtype=np.float64)
    phi = inverse_laplace(scaled, poles(A, TAU_0)[np.newaxis], times)[0]
    return _convolved(phi, a_0, step)


def _convolved(response: Array, signal: Array, step: float) -> Array:
    """Return the integral of response(t - s) signal(s) over s, by the trapezoidal rule."""
    size = 2 * len(signal)
    whole = np.fft.irfft(np.fft.rfft(response, size) * np.fft.rfft(signal, size), size)
    ends = 0.5 * (response[0] * signal + response * signal[0])
    return np.asarray(step * (whole[: len(signal)] - ends), dtype=np.float64)
