"""The paper's mean equation, checked on the platoon's own matrices."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.model import Gains
from cacc_platoon.reproduction.cases import CASES, RHO, TAU_0
from cacc_platoon.reproduction.claim import Claim
from cacc_platoon.theory import effective_interval
from cacc_platoon.theory.mean_equation import link_outcomes, matrix_exponential, platoon_matrix

if TYPE_CHECKING:
    from cacc_platoon.analysis.analyse import Report

LINKS = 3
TIMES = (1.0, 10.0, 100.0)
"""Times [s] at which exponentials are compared."""

_ROUNDING = 1e-11


def mean_claims(mean: float) -> Iterator[Claim]:
    """Yield what the paper says of E[A] and E[exp(A t)], with the noise mean E[w] of case A."""
    gains = Gains(*CASES[0][1:5])
    values = effective_interval(1.0, RHO)
    factors, probability = link_outcomes(values, mean, LINKS)
    every = platoon_matrix(gains, TAU_0, factors)
    average = platoon_matrix(gains, TAU_0, [mean] * LINKS)
    basis = (
        f"case A, {LINKS} followers, all {len(factors)} outcomes of independent links, w = "
        f"{values.low:g} or {values.high:g} with E[w] = {mean:.6f}"
    )
    gap = _apart(_mean(probability, every), average)
    yield Claim(
        "Sec. III-B",
        "E[A] = A(E[w]), largest difference, relative [-]",
        "0",
        f"{gap:.1e}",
        gap < _ROUNDING,
        f"{basis}; A is linear in w",
    )
    gaps = exponential_gaps(gains, factors, probability, mean)
    yield Claim(
        "Sec. III-B",
        f"E[exp(A t)] = exp(E[A] t) at t = {', '.join(f'{t:g}' for t in TIMES)} s, largest "
        "difference, relative [-]",
        "0",
        ", ".join(f"{gap:.1e}" for gap in gaps),
        max(gaps) < _ROUNDING,
        f"{basis}; exact for every law, as each entry is of degree one in each w_i",
    )


def ensemble_claims(report: Report) -> Iterator[Claim]:
    """Yield how far the mean of noisy runs of a case is from its mean system, where there are."""
    ensemble, test = report.ensemble, report.agreement
    if ensemble is None or test is None:
        return
    apart = float(np.max(np.abs(ensemble.mean - report.expectation.spacing_error)))
    yield Claim(
        "Sec. III-B",
        "E[X] is the state of the equation with E[w]: mean of noisy runs, case A, delta_i",
        "equal",
        f"mean of {ensemble.runs} runs within {apart:.4f} m, {test.largest_share:.3g} of the bound",
        test.largest_share <= 1.0,
        f"every follower and sample; a true equation leaves the bound with probability "
        f"{test.level:g} at most",
    )


def exponential_gaps(
    gains: Gains, factors: np.ndarray, probability: np.ndarray, mean: float
) -> list[float]:
    """Return how far E[exp(A t)] is from exp(E[A] t), relative, at each of `TIMES`."""
    every = platoon_matrix(gains, TAU_0, factors)
    average = platoon_matrix(gains, TAU_0, [mean] * factors.shape[-1])
    return [
        _apart(_mean(probability, matrix_exponential(every * t)), matrix_exponential(average * t))
        for t in TIMES
    ]


def _mean(probability: np.ndarray, every: np.ndarray) -> np.ndarray:
    return np.asarray(np.tensordot(probability, every, axes=1))


def _apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.max(np.abs(one - other)) / np.max(np.abs(other)))
