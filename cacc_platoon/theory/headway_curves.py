"""Headway bounds over the gain and the SNR, as records of arrays to look at.

The bounds are those of docs/theory.md, section 2 (The paper's theorem, and its slips), and of
docs/theory.md, section 4 (The exact region and the exact minimum headway).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.theory.noise_interval import k_a_max, rho_from_snr_db
from cacc_platoon.theory.region import infimum_headway, minimum_headway
from cacc_platoon.theory.theorem2 import headway_bound, headway_slope, headway_slope_roots, optimum

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from cacc_platoon.theory.theorem2 import Optimum

    Float = NDArray[np.float64]

__all__ = [
    "BoundCurve",
    "HeadwayOverSnr",
    "SlopeCurve",
    "bound_curves",
    "headway_over_snr",
    "slope_curve",
]


class SlopeCurve(NamedTuple):
    """The paper's ``f(k_a)``, its roots and the cap of ``k_a``."""

    k_a: Float
    slope: Float
    roots: tuple[float, float]
    k_a_max: float


def slope_curve(rho: float) -> SlopeCurve:
    """Compute `SlopeCurve` over a range that shows both roots.

    Examples
    --------
    >>> round(slope_curve(5.0).roots[0], 6)
    0.318305
    """
    roots = headway_slope_roots(rho)
    k_a = np.linspace(0.0, min(1.15 * roots[1], 6.0), 400)
    slope = np.array([headway_slope(float(k), rho) for k in k_a])
    return SlopeCurve(k_a, slope, roots, k_a_max(rho))


class BoundCurve(NamedTuple):
    """Headway bounds [s] over ``k_a`` for one SNR: the paper's, the exact one, and ``k_a*, h*``."""

    rho: float
    k_a: Float
    paper: Float
    exact: Float
    optimum: Optimum


def bound_curves(rhos: Sequence[float], tau_max: float) -> list[BoundCurve]:
    """Compute a `BoundCurve` for every SNR.

    Examples
    --------
    >>> curve = bound_curves([5.0], tau_max=0.5)[0]
    >>> bool((curve.exact <= curve.paper + 1e-12).all())
    True
    """
    curves = []
    for rho in rhos:
        k_a = k_a_max(rho) * np.linspace(0.0, 0.97, 300)
        paper = np.array([headway_bound(float(k), rho, tau_max) for k in k_a])
        exact = np.array([minimum_headway(float(k), rho, tau_max) for k in k_a])
        curves.append(BoundCurve(rho, k_a, paper, exact, optimum(rho, tau_max)))
    return curves


class HeadwayOverSnr(NamedTuple):
    """Headways [s] over SNR [dB]: ``h*``, the exact minimum at ``k_a*``, and the infimum."""

    snr_db: Float
    paper: Float
    exact: Float
    infimum: Float


def headway_over_snr(tau_max: float, snr_db: Float | None = None) -> HeadwayOverSnr:
    """Compute `HeadwayOverSnr`, from 0.5 to 60 dB unless given otherwise.

    Examples
    --------
    >>> curve = headway_over_snr(0.5, np.array([20.0]))
    >>> curve.infimum.tolist()
    [0.55]
    """
    levels = np.linspace(0.5, 60.0, 240) if snr_db is None else np.asarray(snr_db, dtype=float)
    rhos = [rho_from_snr_db(float(level)) for level in levels]
    best = [optimum(rho, tau_max) for rho in rhos]
    exact = [minimum_headway(b.k_a, rho, tau_max) for b, rho in zip(best, rhos, strict=True)]
    infimum = [infimum_headway(rho, tau_max) for rho in rhos]
    return HeadwayOverSnr(
        levels, np.array([b.time_headway for b in best]), np.array(exact), np.array(infimum)
    )
