r"""More predecessors, by reduction to one.

With ``r`` predecessors and

.. math::
    u_i = \sum_{j=1}^{r} \left[k_a w a_{i-j} - k_v (v_i - v_{i-j})
          - k_p (x_i - x_{i-j} + j d + j h_w v_i)\right]

the platoon is the one-predecessor platoon with gains ``r k_a, r k_v, r k_p`` and headway
``(r + 1) h_w/2`` (docs/theory.md, section 11 (Extensions)).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.model.control import Gains
from cacc_platoon.theory.errors import require
from cacc_platoon.theory.exact import l2_gain
from cacc_platoon.theory.noise_interval import (
    checked_interval,
    effective_interval,
)
from cacc_platoon.theory.theorem2 import headway_bound, optimum

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

__all__ = [
    "MultiPredecessorBounds",
    "equivalent_gains",
    "first_followers_gains",
    "hop_responses",
    "multi_predecessor_bounds",
    "multi_predecessor_gains",
    "several_predecessors_growth",
]


class MultiPredecessorBounds(NamedTuple):
    """Bounds for ``r`` predecessors, all headways per vehicle.

    Attributes
    ----------
    paper : float
        ``2/(r + 1) h_lb(r k_a)`` [s].
    exact : float
        ``4 tau_0/((1 + r)(1 + m r k_a))`` [s].
    optimal_k_a : float
        ``k_a*/r``.
    optimal_headway : float
        ``2 h*/(r + 1)`` [s].
    k_a_max : float
        ``1/(r (1 + 1/rho))``, excluded.
    """

    paper: float
    exact: float
    optimal_k_a: float
    optimal_headway: float
    k_a_max: float


def _check_count(predecessors: int) -> None:
    require(
        predecessors >= 1,
        f"predecessors = {predecessors} is below 1: a follower needs a vehicle to follow. Give "
        "1 or more.",
    )


def hop_responses(
    gains: Gains, tau: float, k_effective: Sequence[float], omega: ArrayLike
) -> NDArray[np.complex128]:
    """``H_j(j omega)`` from each predecessor, nearest first; they add up to the equivalent hop.

    Parameters
    ----------
    gains : Gains
        Per predecessor; ``k_a`` is not used.
    tau : float
        Lag [s].
    k_effective : sequence of float, length r
        ``k_a E[w_j]`` of each predecessor that is heard.
    omega : array_like, shape (n,)
        Frequencies [rad/s].

    Returns
    -------
    ndarray, shape (r, n)
    """
    h, _, k_v, k_p = gains
    r, s = len(k_effective), 1j * np.asarray(omega, dtype=float)
    below = ((tau * s + 1.0) * s + r * k_v + 0.5 * r * (r + 1) * h * k_p) * s + r * k_p
    return np.stack([((k * s + k_v) * s + k_p) / below for k in k_effective])


def several_predecessors_growth(
    gains: Gains, tau: float, k_effective: Sequence[float]
) -> tuple[float, float]:
    """Growth per vehicle with several predecessors, exactly, and the sufficient sum beside it.

    ``x_i = sum_j H_j x_{i-j}`` grows along the platoon iff a root of
    ``z^r = sum_j H_j z^(r-j)`` leaves the unit disc at some frequency. ``sum_j |H_j| <= 1`` at all
    of them is sufficient, and covers unequal ``E[w_j]``.

    Parameters
    ----------
    gains, tau, k_effective
        As in `hop_responses`.

    Returns
    -------
    growth, total : float
        Largest root and largest ``sum_j |H_j|`` over a frequency grid, both at least 1.

    Examples
    --------
    >>> growth, total = several_predecessors_growth(Gains(0.65, 0.25, 0.32, 0.2), 0.5, [0.3, 0.3])
    >>> growth <= total
    True
    """
    _check_count(len(k_effective))
    rate = math.sqrt(gains.k_p) + gains.k_v + 1.0 / tau
    omega = np.geomspace(1e-4 * math.sqrt(gains.k_p), 30.0 * rate, 4000)
    H = hop_responses(gains, tau, k_effective, omega)
    r = len(k_effective)
    companion = np.zeros((omega.size, r, r), dtype=complex)
    companion[:, 0, :] = H.T
    companion[:, np.arange(1, r), np.arange(r - 1)] = 1.0
    growth = np.max(np.abs(np.linalg.eigvals(companion)))
    return max(1.0, float(growth)), max(1.0, float(np.max(np.abs(H).sum(axis=0))))


def first_followers_gains(
    gains: Gains, tau: float, k_effective: float, predecessors: int
) -> list[float]:
    """``sup |H|`` of the first followers, which hear 1 to ``predecessors - 1`` vehicles ahead.

    With the gains of the others they are hops of their own, which may amplify although the rest
    of the platoon does not.

    Parameters
    ----------
    gains : Gains
        Per predecessor; ``k_a`` is not used.
    tau, k_effective : float
        Lag [s] and ``k_a E[w]`` per predecessor.
    predecessors : int
        That the others hear.

    Examples
    --------
    >>> gains = multi_predecessor_gains(Gains(0.75, 0.5, 0.7, 0.5), 3)
    >>> [round(gain, 2) for gain in first_followers_gains(gains, 0.5, 0.5 / 3, 3)]
    [1.94, 1.24]
    """
    _check_count(predecessors)
    return [
        l2_gain(equivalent_gains(gains, heard), tau, heard * k_effective).gain
        for heard in range(1, predecessors)
    ]


def equivalent_gains(gains: Gains, predecessors: int) -> Gains:
    """One-predecessor gains equivalent to the given ones with `predecessors` predecessors.

    Examples
    --------
    >>> equivalent_gains(Gains(0.8, 0.25, 0.3, 0.005), predecessors=2)
    Gains(time_headway=1.2000000000000002, k_a=0.5, k_v=0.6, k_p=0.01)
    """
    _check_count(predecessors)
    h, k_a, k_v, k_p = gains
    r = predecessors
    return Gains(0.5 * (r + 1) * h, r * k_a, r * k_v, r * k_p)


def multi_predecessor_gains(gains: Gains, predecessors: int) -> Gains:
    """Invert `equivalent_gains`: spread a one-predecessor design over `predecessors`.

    Examples
    --------
    >>> round(multi_predecessor_gains(Gains(1.2, 0.5, 0.6, 0.01), predecessors=2).time_headway, 6)
    0.8
    """
    _check_count(predecessors)
    h, k_a, k_v, k_p = gains
    r = predecessors
    return Gains(2.0 * h / (r + 1), k_a / r, k_v / r, k_p / r)


def multi_predecessor_bounds(
    k_a: float, rho: float, tau_max: float, predecessors: int
) -> MultiPredecessorBounds:
    """Headway bounds and best gain with `predecessors` predecessors.

    Raises
    ------
    DesignError
        If ``r k_a`` is not below ``1/(1 + 1/rho)`` or another value is out of its range.

    Examples
    --------
    >>> bounds = multi_predecessor_bounds(0.25, 5.0, 0.5, predecessors=2)
    >>> round(bounds.paper, 6), round(bounds.exact, 6)
    (0.625, 0.47619)
    """
    _check_count(predecessors)
    r = predecessors
    require(
        k_a < 1.0 / (r * effective_interval(1.0, rho).high),
        f"k_a = {k_a:g} for each of {r} predecessors is not below "
        f"{1.0 / (r * effective_interval(1.0, rho).high):.6g} = 1/(r (1 + 1/rho)): their sum may "
        "reach 1 and no headway is string stable. Lower k_a.",
    )
    low, _ = checked_interval(r * k_a, rho)
    best = optimum(rho, tau_max)
    return MultiPredecessorBounds(
        paper=2.0 / (r + 1) * headway_bound(r * k_a, rho, tau_max),
        exact=4.0 * tau_max / ((1 + r) * (1.0 + low)),
        optimal_k_a=best.k_a / r,
        optimal_headway=2.0 * best.time_headway / (r + 1),
        k_a_max=1.0 / (r * effective_interval(1.0, rho).high),
    )
