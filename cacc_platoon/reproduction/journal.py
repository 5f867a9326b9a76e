"""The journal version of the paper beside ours, as far as its figures can be read.

G. Ma, P. R. Pagilla, S. Darbha, IEEE Transactions on Intelligent Transportation Systems 26(1),
2025. What it says is read from printed curves, so that numbers are about right at best; what cannot
be compared at all is a question, not a verdict.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.model import Gains
from cacc_platoon.reproduction.cases import CASES, RHO, TAU_0, case_scenario
from cacc_platoon.reproduction.claim import Claim
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import simulate
from cacc_platoon.theory import Hop, certify_chain

if TYPE_CHECKING:
    from cacc_platoon.analysis.analyse import Report
    from cacc_platoon.simulation.trajectory import Array

DOI = "10.1109/TITS.2024.3498701"
LAGS = (
    *(0.2530, 0.1111, 0.1535, 0.3987, 0.1253, 0.0562),
    *(0.2240, 0.4101, 0.1998, 0.2375, 0.0257, 0.1761),
)
"""Lags of the followers in its case 5 [s]."""

LENGTH_READING, ACCELERATION_READING = 2.0, 0.01
"""How well a curve of lengths [m], or of accelerations [m/s^2], is read."""


def journal_claims(reports: Mapping[str, Report]) -> list[Claim]:
    """Return what the journal version shows, with the reports of the cases by name."""
    return [*_case_4(reports), *_case_5(reports["A"]), _case_3(reports["C"])]


def _case_4(reports: Mapping[str, Report]) -> Iterator[Claim]:
    wide, close = (reports[name].expected.platoon_length for name in ("A", "C"))
    for what, paper, ours in (
        ("at rest", (345.0, 324.0), (wide.initial, close.initial)),
        ("at most", (437.0, 418.0), (wide.max, close.max)),
    ):
        far = max(abs(one - other) for one, other in zip(paper, ours, strict=True))
        yield Claim(
            "Case 4",
            f"platoon length {what} [m], h_w = 0.95 s and 0.88 s",
            f"about {paper[0]:g} and {paper[1]:g}",
            f"{ours[0]:.3f} and {ours[1]:.3f}",
            far <= LENGTH_READING,
            f"expectation runs A and C; read from a figure, to {LENGTH_READING:g} m",
        )


def unequal_lags(duration: float = 100.0) -> Scenario:
    """Return the mean system of case A with the lags of case 5.

    Examples
    --------
    >>> unequal_lags().followers[3].tau
    0.3987
    """
    settings = {"v2v.noise": "expected", "run.duration": duration}
    own = {index: {"vehicle.tau": lag} for index, lag in enumerate(LAGS, start=1)}
    common = case_scenario(CASES[0], settings).values()
    return Scenario.from_values(common, own, source="journal_case_5")


def _case_5(report: Report) -> Iterator[Claim]:
    gains, k = Gains(*CASES[0][1:5]), CASES[0].k_a * report.measured.noise[0].expected_mean
    run = simulate(unequal_lags())
    a, delta = (np.abs(part).max(axis=0) for part in (run.acceleration, run.spacing_error))
    basis = "array simulation of the mean system with its 12 lags; gains taken as those of case A"
    paper = 0.49, 0.455
    far = max(abs(a[1] - paper[0]), abs(a[-1] - paper[1]))
    yield Claim(
        "Case 5",
        "unequal lags: max|a_1| and max|a_12| [m/s^2]",
        f"about {paper[0]:g} and {paper[1]:g}",
        f"{a[1]:.4f} and {a[-1]:.4f}",
        bool(far <= ACCELERATION_READING),
        f"{basis}; read from a figure, to {ACCELERATION_READING:g} m/s^2",
    )
    energy = np.sqrt((run.acceleration**2).sum(axis=0))
    chain = certify_chain([Hop(gains, lag, k) for lag in LAGS])
    falls = bool((np.diff(energy) <= 0).all() and (np.diff(a) <= 0).all())
    yield Claim(
        "Case 5",
        "unequal lags: accelerations from vehicle to vehicle",
        "decreasing",
        f"peaks fall at {_falls(a)} of {len(LAGS)} hops, L2 norms at {_falls(energy)}; largest "
        f"sup|H_i| = {max(chain.hop_gains):.9f}",
        falls and chain.string_stable,
        "a_i = H_i a_{i-1} whatever the other lags are, and sup|H_i| <= 1 for every lag up to "
        "tau_0: proven for L2 norms of the mean system, seen for the peaks",
    )
    grows = int((np.diff(delta) > 0).sum())
    ratio = spacing_error_ratio(gains, k)
    yield Claim(
        "Case 5",
        "unequal lags: max|delta_i| from vehicle to vehicle",
        "not monotone",
        f"grows at {grows} of {len(delta) - 1} hops, {delta.min():.4f} to {delta.max():.4f} m; "
        f"sup|delta_i/delta_(i-1)| reaches {ratio:.4g}",
        grows > 0 and ratio > 1.0,
        "delta_i = Phi_i a_{i-1}, Phi_i of its own lag: the ratio is Phi_i H_(i-1)/Phi_(i-1), not "
        f"H, and nothing bounds it by 1; {basis}",
    )


def _falls(values: Array) -> int:
    return int((np.diff(values) <= 0).sum())


def spacing_error_ratio(gains: Gains, k_effective: float) -> float:
    """Return the largest |delta_i/delta_{i-1}| over neighbours of case 5 and frequencies.

    With D_i of the lag tau_i it is ``((h_w k - tau_i) s + c)/((h_w k - tau_(i-1)) s + c) N/D_i``,
    ``c = k + h_w k_v - 1``.
    """
    h, _, k_v, k_p = gains
    s = 1j * np.geomspace(1e-4, 1e2, 2000)
    rest = k_effective + h * k_v - 1.0
    lags = np.array(LAGS)[:, np.newaxis]
    over = (h * k_effective - lags) * s + rest
    loop = ((lags * s + 1.0) * s + k_v + h * k_p) * s + k_p
    hop = (k_effective * s + k_v) * s + k_p
    return float(np.abs(over[1:] / over[:-1] * hop / loop[1:]).max())


def _case_3(report: Report) -> Claim:
    peaks = report.expected.max_abs_spacing_error
    case = CASES[2]
    return Claim(
        "Case 3",
        "max|delta_1| and max|delta_12| [m], optimal k_a",
        "about 0.802 and 0.798",
        f"{peaks[0]:.4f} and {peaks[-1]:.4f}",
        None,
        f"expectation run C: rho = {RHO:g}, tau = {TAU_0:g} s, h_w = {case.time_headway:g} s, "
        f"k_a = {case.k_a:.6f}, k_v = {case.k_v:g}, k_p = {case.k_p:g}. Do other parameters belong "
        "to the figure? Its printed form was not at hand",
    )
