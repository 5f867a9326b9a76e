r"""The spacing error propagation ``H(s) = N(s)/D(s)`` of one hop.

.. math::
    N(s) = \tilde k_a s^2 + k_v s + k_p, \qquad
    D(s) = \tau s^3 + s^2 + \gamma s + k_p, \qquad \gamma = k_v + h_w k_p,

so that ``H(0) = 1`` for every design: a string stable platoon has ``sup |H| = 1``, never less
(docs/theory.md, section 1 (Setting); the paper's equation (14), error propagation).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.theory.errors import require, require_positive

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from cacc_platoon.model.control import Gains

__all__ = [
    "frequency_response",
    "gamma",
    "is_internally_stable",
    "poles",
    "require_resolvable",
    "slowest_time_constant",
]

ROUTH_SLACK = 1e-12
_STIFFEST = 1e14


def gamma(gains: Gains) -> float:
    """Damping coefficient ``gamma = k_v + h_w k_p`` of ``D(s)``, in 1/s."""
    return gains.k_v + gains.time_headway * gains.k_p


def frequency_response(
    gains: Gains, tau: float, k_effective: float, omega: ArrayLike
) -> NDArray[np.complex128]:
    """``H(j omega)`` of the mean system.

    Parameters
    ----------
    gains : Gains
        Controller; ``k_a`` is not used, `k_effective` stands for it.
    tau : float
        Actuation lag [s].
    k_effective : float
        Effective feed-forward gain ``k_a E[w]``.
    omega : array_like, shape (...)
        Frequencies [rad/s].

    Returns
    -------
    ndarray, shape (...)
        Complex response.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> frequency_response(Gains(0.95, 0.5, 0.63, 0.009), 0.5, 0.5, [0.0]).tolist()
    [(1+0j)]
    """
    s = 1j * np.asarray(omega, dtype=float)
    numerator = (k_effective * s + gains.k_v) * s + gains.k_p
    denominator = ((tau * s + 1.0) * s + gamma(gains)) * s + gains.k_p
    return np.asarray(numerator / denominator, dtype=np.complex128)


def is_internally_stable(gains: Gains, tau: float) -> bool:
    """Routh-Hurwitz on ``D(s)``: ``k_p > 0`` and ``gamma > tau k_p`` (paper, proof of Theorem 2).

    When it holds for one lag it holds for every smaller one. A ``gamma`` within a relative 1e-12
    of ``tau k_p`` counts as unstable: the pole is on the axis as far as numbers can tell.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> is_internally_stable(Gains(0.95, 0.5, 0.63, 0.009), 0.5)
    True
    >>> is_internally_stable(Gains(0.4, 0.5, 0.0001, 1.0), 0.5)
    False
    """
    damping = gamma(gains)
    return gains.k_p > 0 and damping > 0 and damping * (1.0 - ROUTH_SLACK) > tau * gains.k_p


def require_resolvable(gains: Gains, tau: float) -> None:
    """Refuse a loop whose modes lie too far apart for double precision.

    Raises
    ------
    DesignError
        If the rates of the fastest and the slowest mode differ by more than 1e14.
    """
    damping, spacing = gamma(gains), math.sqrt(gains.k_p)
    fastest, slowest = max(1.0 / tau, damping, spacing), min(gains.k_p / damping, spacing)
    require(
        math.isfinite(fastest) and fastest <= _STIFFEST * slowest,
        f"the modes of k_v = {gains.k_v:g} 1/s, k_p = {gains.k_p:g} 1/s^2, tau = {tau:g} s, from "
        f"{slowest:.3g} to {fastest:.3g} 1/s, are too far apart: no gain can be computed. Choose "
        "gains nearer to 1/tau and 1/tau^2.",
    )


def poles(gains: Gains, tau: ArrayLike) -> NDArray[np.complex128]:
    """Roots of ``D(s)``, the slowest first.

    Parameters
    ----------
    gains : Gains
        Controller.
    tau : array_like, shape (...)
        Actuation lags [s].

    Returns
    -------
    ndarray, shape (..., 3)
        Poles [1/s] by falling real part, complex pairs as conjugates.

    Raises
    ------
    DesignError
        If a lag is not positive.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> poles(Gains(0.95, 0.5, 0.63, 0.009), 0.5)[0].real.round(6).item()
    -0.014418
    """
    lags = np.asarray(tau, dtype=np.float64)
    for lag in (float(np.min(lags)), float(np.max(lags))):
        require_positive("tau", lag, "s")
        if is_internally_stable(gains, lag):
            require_resolvable(gains, lag)
    monic = np.stack(
        [np.ones_like(lags), 1.0 / lags, gamma(gains) / lags, gains.k_p / lags], axis=-1
    )
    companion = np.zeros((*lags.shape, 3, 3))
    companion[..., 0, :] = -monic[..., 1:]
    companion[..., 1, 0] = companion[..., 2, 1] = 1.0
    roots = np.linalg.eigvals(companion).astype(np.complex128)
    c2, c1, c0 = (monic[..., i, np.newaxis] for i in (1, 2, 3))
    with np.errstate(over="ignore", invalid="ignore"):  # a step to infinity is not taken
        for _ in range(3):  # a small root next to a large one has few digits at first
            value = ((roots + c2) * roots + c1) * roots + c0
            slope = (3.0 * roots + 2.0 * c2) * roots + c1
            moved = roots - value / np.where(slope == 0, 1.0, slope)
            better = np.abs(((moved + c2) * moved + c1) * moved + c0) < np.abs(value)
            roots = np.where(better, moved, roots)
    order = np.lexsort((-roots.imag, -roots.real), axis=-1)
    return np.take_along_axis(roots, order, axis=-1)


def slowest_time_constant(gains: Gains, tau: float) -> float:
    """Time constant of the slowest pole [s]; infinite when the loop is not internally stable.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> round(slowest_time_constant(Gains(0.95, 0.5, 0.63, 0.009), 0.5), 1)
    69.4
    """
    if not is_internally_stable(gains, tau):
        return float("inf")
    return float(-1.0 / poles(gains, tau)[0].real)
