"""Where theorems, definitions and notation of the paper slip; every check is computed."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from cacc_platoon.model import Gains
from cacc_platoon.reproduction.cases import CASES, RHO, TAU_0
from cacc_platoon.reproduction.claim import yes
from cacc_platoon.reproduction.mean_claims import TIMES, exponential_gaps
from cacc_platoon.reproduction.slip import Slip
from cacc_platoon.scenario.v2v_parameters import PAPER_BITS
from cacc_platoon.theory import (
    conservatism,
    effective_interval,
    exact_region,
    gamma,
    headway_bound,
    in_paper_region,
    is_robustly_string_stable,
    is_string_stable,
    k_a_max,
    l2_gain,
    linf_gain,
    minimum_headway,
    paper_region,
    slow_error_ratio,
    stable_gain_range,
    sure_gain,
)

A, B, C = (Gains(*case[1:5]) for case in CASES)
OUTSIDE_S = Gains(0.95, 0.5, 0.75, 1.0)
"""Robustly string stable at the headway of case A, far outside S."""

BELOW_BOUND = Gains(0.75, 0.5, 0.8, 0.5)
"""Robustly string stable at a headway below h_lb(0.5)."""

NEGATIVE_GAIN = Gains(1.5, -0.2, 0.8, 0.1)
"""String stable with k_a E[w] < 0."""


def theorem_slips(mean: float) -> Iterator[Slip]:
    """Yield the slips of definitions, theorems, proof and notation.

    Parameters
    ----------
    mean : float
        E[w] of the example.
    """
    yield two_norms(mean)
    yield strict()
    yield nonempty()
    yield from only_sufficient()
    yield announced_bound()
    yield sign_of_gain()
    yield unequal_links()
    yield independence(mean)
    yield depends_on_bits(mean)
    yield worst_noise()
    yield from notation(mean)


def two_norms(mean: float) -> Slip:
    """Peaks and energies are two norms."""
    gains = [(one, one.k_a * mean) for one in (A, C)]
    energy = [l2_gain(one, TAU_0, k).gain for one, k in gains]
    peak = [linf_gain(one, TAU_0, k) for one, k in gains]
    return Slip(
        "Definition 2",
        "|delta_i|_inf <= |delta_{i-1}|_inf, or in the frequency domain sup|H| <= 1",
        "two conditions: sup|H| is the gain between energies (L2); between peaks it is the L1 norm "
        "of the impulse response, never smaller and here larger",
        f"mean system at tau_0: L2 gain {energy[0]:.4f} (A), {energy[1]:.4f} (C); L-infinity gain "
        f"{peak[0]:.4f} (A), {peak[1]:.4f} (C)",
        max(energy) <= 1.0 < min(peak),
    )


def strict() -> Slip:
    """At equality S is empty, Theorem 1 (b) holds."""
    bound = headway_bound(0.5, RHO, TAU_0)
    at, above = (paper_region(0.5, h, RHO, TAU_0).nonempty for h in (bound, bound * 1.001))
    exact = exact_region(0.5, bound, RHO, TAU_0).nonempty
    return Slip(
        "Theorems 1 (b), 2 (b), proof",
        "h_w >= in Theorem 1 (b), > in Theorem 2 (b), >= again in its proof and in Sec. IV",
        ">= is right for one known k; for S only >, as nothing is left of it at equality",
        f"h_w = {bound:.4f} s: S nonempty: {yes(at)}, 0.1 % above: {yes(above)}; the exact region "
        f"is nonempty at equality: {yes(exact)}",
        not at and above and exact,
    )


def nonempty() -> Slip:
    """S is nonempty exactly when a_1 > a_2; sections of S over k_p decide, not its formula."""
    k_p = np.geomspace(1e-12, 1e3, 400)
    right = needless = designs = 0
    for k_a in np.linspace(0.03, 0.97 * k_a_max(RHO), 24).tolist():
        for h in np.linspace(0.4, 4.0, 25).tolist():
            a1, b1, a2, b2 = paper_region(k_a, h, RHO, TAU_0)[:4]
            low, high = np.maximum(a2 * (1 - k_p / b2), 0.0), a1 * (1 - k_p / b1)
            some = bool((high > low).any())
            right += some == (a1 > a2)
            needless += (b1 >= b2) <= (a1 >= a2)
            designs += 1
    equal = paper_region(0.5, headway_bound(0.5, RHO, TAU_0), RHO, TAU_0)
    touching = math.isclose(equal.a1, equal.a2) and not equal.area
    return Slip(
        "Proof of Theorem 2",
        "S is nonempty if a_1 >= a_2 or b_1 >= b_2",
        "exactly when a_1 > a_2; b_1 >= b_2 means a_1 >= 2 a_2 and adds nothing",
        f"S cut along 400 k_p: nonempty iff a_1 > a_2 in {right} of {designs} pairs (k_a, h_w); "
        f"b_1 >= b_2 without a_1 >= a_2 in {designs - needless}; a_1 = a_2 = {equal.a2:.6f} "
        f"leaves no area: {yes(touching)}",
        right == needless == designs and touching,
    )


def only_sufficient() -> Iterator[Slip]:
    """S is inside of the intersection of all F(k), and h_lb above the least headway."""
    share = conservatism(A.k_a, A.time_headway, RHO, TAU_0).area
    upper = paper_region(A.k_a, A.time_headway, RHO, TAU_0).a1
    stable, inside = _both(OUTSIDE_S)
    yield Slip(
        "Theorem 2, proof",
        "S = S_1 and S_2 is the intersection of F(k) over all k in I, the feasible region",
        "S is inside of it: sufficient. S_2 at k = m k_a is necessary, S_1 is not",
        f"case A: S has {100 * share:.2f} % of the exact region up to its largest k_p; h_w = "
        f"{OUTSIDE_S.time_headway:g} s, k_v = {OUTSIDE_S.k_v:g}, k_p = {OUTSIDE_S.k_p:g}: robustly "
        f"string stable {yes(stable)}, in S {yes(inside)}, gamma = {gamma(OUTSIDE_S):g} > a_1 = "
        f"{upper:g}",
        stable and not inside and gamma(OUTSIDE_S) > upper and share < 1.0,
    )
    bound, least = headway_bound(0.5, RHO, TAU_0), minimum_headway(0.5, RHO, TAU_0)
    stable, inside = _both(BELOW_BOUND)
    yield Slip(
        "Theorem 2 (b), (c)",
        "h_lb(k_a) and h* are the lower bounds of the time headway",
        "of headways with a nonempty S; robust string stability needs 2 tau_0/(1 + m k_a) alone",
        f"k_a = 0.5: {least:.6f} s instead of {bound:.4f} s; h_w = {BELOW_BOUND.time_headway:g} s, "
        f"k_v = {BELOW_BOUND.k_v:g}, k_p = {BELOW_BOUND.k_p:g} is robustly string stable: "
        f"{yes(stable)}",
        stable and not inside and least < BELOW_BOUND.time_headway < bound,
    )


def announced_bound() -> Slip:
    """S is empty at the headway that the proof says it employs."""
    least, bound = minimum_headway(0.5, RHO, TAU_0), headway_bound(0.5, RHO, TAU_0)
    between = np.linspace(least, bound, 50)
    empty = sum(not paper_region(0.5, h, RHO, TAU_0).nonempty for h in between.tolist())
    return Slip(
        "Proof of Theorem 2",
        "S is shown to be nonempty 'employing' h_w >= 2 tau_0/(1 + m k_a)",
        "the end of the proof puts in h_lb instead, which S needs",
        f"k_a = 0.5: S is empty at {empty} of {len(between)} headways from {least:.6f} s to "
        f"{bound:.4f} s",
        empty == len(between),
    )


def sign_of_gain() -> Slip:
    """|H| <= 1 leaves negative gains."""
    k = NEGATIVE_GAIN.k_a
    lags = (TAU_0 * np.linspace(0.01, 1.0, 100)).tolist()
    stable = sum(is_string_stable(NEGATIVE_GAIN, tau, k) for tau in lags)
    return Slip(
        "Theorems 1 (a), 2 (a)",
        "sup|H| <= 1 for every tau implies 0 < k_a E[w] < 1",
        "only |k_a E[w]| <= 1 follows; that it is positive is an assumption",
        f"k_a E[w] = {k:g}, h_w = {NEGATIVE_GAIN.time_headway:g} s, k_v = {NEGATIVE_GAIN.k_v:g}, "
        f"k_p = {NEGATIVE_GAIN.k_p:g}: string stable at {stable} of {len(lags)} lags up to tau_0",
        stable == len(lags),
    )


def unequal_links() -> Slip:
    """gamma_{i,j} may differ between links, and then delta_i = H delta_{i-1} is false."""
    ratios = [slow_error_ratio(one, RHO) for one in (A, C)]
    return Slip(
        "Sec. III-A, equation (14), error propagation",
        "gamma_{i,j} carries the vehicle i, and delta_i = H delta_{i-1} is used for every i",
        "it holds for i >= 2 and one E[w] on all links. With several a_i = H_i a_{i-1} holds, and "
        "slow spacing errors may grow from one vehicle to the next",
        f"ratio of slow errors of neighbours, E[w] at both ends of its range: {ratios[0]:.4g} "
        f"(case A), {ratios[1]:.4g} (case C)",
        min(map(abs, ratios)) > 1.0,
    )


def independence(mean: float) -> Slip:
    """With one factor for all links E[exp(A t)] is another matrix."""
    values = effective_interval(1.0, RHO)
    up = (mean - values.low) / (values.high - values.low)
    common = np.array([[values.low] * 3, [values.high] * 3])
    gaps = exponential_gaps(A, common, np.array([1.0 - up, up]), mean)
    return Slip(
        "Sec. III-B",
        "E[exp(A t)] = exp(E[A] t) because A is lower triangular and banded",
        "it needs links that are independent of each other as well; then the mean equation holds "
        "whatever each link does in time; 'converge to' the deterministic equation is true of the "
        "mean alone",
        f"case A, 3 followers with one common w: they differ by {max(gaps):.1e} at "
        f"t = {TIMES[int(np.argmax(gaps))]:g} s, relative to the largest entry",
        max(gaps) > 1e-6,
    )


def depends_on_bits(mean: float) -> Slip:
    """Case B is string stable for other bit probabilities."""
    low, high = stable_gain_range(B, TAU_0) or (math.nan, math.nan)
    reach = effective_interval(B.k_a, RHO).high
    growing = l2_gain(B, TAU_0, B.k_a * mean).gain
    return Slip(
        "Sec. IV, h_w = 0.65 s",
        "case B 'exhibits string instability'",
        "not robustly string stable; for one E[w] it depends on the bit probabilities",
        f"string stable for k_a E[w] from {low:.6f} to {high:.6f}, of which I reaches {reach:g}; "
        f"at {B.k_a * mean:.6f} sup|H| = {growing:.6f}",
        low < reach and growing > 1.0 and is_string_stable(B, TAU_0, 0.5 * (low + reach)),
    )


def worst_noise() -> Slip:
    """Take the worst factor that changes in time: it is not covered."""
    gains = [sure_gain(one, RHO, TAU_0) for one in (A, C)]
    return Slip(
        "Sec. I",
        "cyber-attacks are named among the causes of noise",
        "the theorems are about the mean; against a factor that changes in time in the worst way "
        "within its range, peaks of the acceleration may grow from vehicle to vehicle",
        f"largest ratio of peaks over one hop at tau_0, attained by some w(t): {gains[0]:.5f} (A), "
        f"{gains[1]:.5f} (C)",
        min(gains) > 1.0,
    )


def notation(mean: float) -> Iterator[Slip]:
    """Yield names that mean two things, and an index and a file name that cannot be meant."""
    n, square = len(PAPER_BITS), (1.0 + 1.0 / RHO) ** 2
    yield Slip(
        "Secs. III, IV",
        "n counts the bits and is (1 + 1/rho)^2; gamma is k_v + h_w k_p, gamma_{i,j} a "
        "probability; w and omega are the noise, omega the frequency; a_{i,i-1} stands once "
        "for a_{i-1}; bits up to gamma_{i,n}",
        "n bits are gamma_{i,0} to gamma_{i,n-1}; the meaning follows from the place",
        f"in the example n = {n} and n = {square:g}; gamma = {gamma(A):.5f} 1/s and "
        f"gamma_{{i,0}} = {PAPER_BITS[0]:g}; {n} bits end at j = {n - 1}",
        not math.isclose(n, square) and not math.isclose(gamma(A), PAPER_BITS[0]),
    )
    other = A._replace(time_headway=0.75)
    named, drawn = (l2_gain(one, TAU_0, A.k_a * mean).gain for one in (other, A))
    yield Slip(
        "Sec. IV",
        "in its source the figures for h_w = 0.95 s are labelled hw-0point75",
        "0.95 s is meant: with 0.75 s the drawn curve would exceed 1",
        f"sup|H| at k_a E[w] = {A.k_a * mean:.6f}: {named:.9f} at 0.75 s, {drawn:.9f} at 0.95 s",
        named > 1.0 >= drawn,
    )


def _both(gains: Gains) -> tuple[bool, bool]:
    return is_robustly_string_stable(gains, RHO, TAU_0), in_paper_region(gains, RHO, TAU_0)
