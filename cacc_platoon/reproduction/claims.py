"""What the paper says, and what we measured: every number on our side is computed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from cacc_platoon.analysis.metrics import describe_growth
from cacc_platoon.model import Gains
from cacc_platoon.reproduction.cases import CASES, RHO, TAU_0, Case
from cacc_platoon.reproduction.claim import Claim, yes
from cacc_platoon.reproduction.mean_claims import ensemble_claims, mean_claims
from cacc_platoon.reproduction.theorem_claims import theorem_claims
from cacc_platoon.theory import l2_gain, paper_region, snr_db_from_rho

if TYPE_CHECKING:
    from cacc_platoon.analysis.analyse import Report


def claims(reports: Mapping[str, Report]) -> list[Claim]:
    """Return the paper's statements that can be checked, with the reports of its cases by name."""
    mean = reports["A"].measured.noise[0].expected_mean
    return [
        *theorem_claims(CASES[0].k_a * mean),
        *mean_claims(mean),
        *ensemble_claims(reports["A"]),
        *(claim for case in CASES for claim in _case_claims(case, reports[case.name])),
        *_length_claims(reports),
        *_channel_claims(reports["A"]),
    ]


def _case_claims(case: Case, report: Report) -> Iterator[Claim]:
    gains = Gains(case.time_headway, case.k_a, case.k_v, case.k_p)
    verdict, peaks = report.verdict, report.expected.max_abs_spacing_error
    where = f"Sec. IV, h_w = {case.time_headway:g} s"
    expected = "string stable" if case.string_stable else "string unstable"
    if case.string_stable:
        region = paper_region(case.k_a, case.time_headway, RHO, TAU_0)
        yield Claim(
            where,
            f"case {case.name}: (k_p, k_v) = ({case.k_p:g}, {case.k_v:g}) in S",
            "chosen from S",
            f"in S = {yes(verdict.in_paper_region)}, area of S {region.area:.6g} 1/s^3",
            verdict.in_paper_region,
            "Theorem 2 (b), both inequalities",
        )
    mean = gains.k_a * report.measured.noise[0].expected_mean
    gain = l2_gain(gains, TAU_0, mean)
    yield Claim(
        where,
        f"case {case.name}: sup|H(jw; tau_0)| [-]",
        f"<= 1, {expected}" if case.string_stable else f"> 1, {expected}",
        f"{gain.gain:.9f} at {gain.peak_omega:.6f} rad/s",
        (gain.gain <= 1.0) == case.string_stable,
        f"closed form at tau_0, k_a E[w] = {mean:.9f}",
    )
    yield Claim(
        where,
        f"case {case.name}: robustly string stable (L2)",
        expected,
        f"{'string stable' if verdict.string_stable else 'string unstable'}, worst sup|H| "
        f"{verdict.weakest.l2_gain:.9f}",
        verdict.string_stable == case.string_stable,
        "exact test, every tau <= tau_0 and every k_a E[w] in I",
    )
    growing = bool((peaks[1:] > peaks[:-1]).any())
    yield Claim(
        where,
        f"case {case.name}: max|delta_i| along the platoon [m]",
        "not growing" if case.string_stable else "growing",
        f"{describe_growth(peaks)}, {peaks[0]:.6f} -> {peaks[-1]:.6f}",
        growing != case.string_stable,
        "expectation run, w = E[w]",
    )


def _length_claims(reports: Mapping[str, Report]) -> Iterator[Claim]:
    wide, close = (reports[name].measured.platoon_length for name in ("A", "C"))
    where = "Fig. platoon length"
    for what, one, other in (
        ("at first", wide.initial, close.initial),
        ("at most", wide.max, close.max),
        ("at last", wide.final, close.final),
    ):
        yield Claim(
            where,
            f"platoon length {what} [m], h_w = 0.88 s against 0.95 s",
            "shorter",
            f"{other:.3f} against {one:.3f}",
            other < one,
            "recorded runs C and A",
        )


def _channel_claims(report: Report) -> Iterator[Claim]:
    links = report.measured.noise
    low, high = min(link.low for link in links), max(link.high for link in links)
    snr = min(link.snr_db for link in links)
    yield Claim(
        "Sec. III-A",
        "noise factor w [-]",
        f"{1 - 1 / RHO:g} <= w <= {1 + 1 / RHO:g}",
        f"{low:.9f} to {high:.9f}",
        not any(link.breaches for link in links),
        "every sample of every link of recorded run A",
    )
    asked = snr_db_from_rho(RHO)
    yield Claim(
        "Definition 3",
        "signal-to-noise ratio [dB]",
        f"{asked:.4f}, follows from rho = {RHO:g}",
        f"{snr:.4f}",
        snr >= asked - 1e-9,
        "smallest of recorded run A; a finite run stays above its bound",
    )
