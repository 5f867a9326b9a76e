r"""What zero-mean noise adds: mean-square growth along the platoon and a uniform bound.

With white noise of variance ``Var[w]`` redrawn every ``Tc``, the energy of hop i obeys a renewal
equation whose weights sum to

.. math::
    c_I = \mathrm{Var}[w]\,k_a^2 T_c \frac{1}{2\pi}\int
          \frac{\omega^2\,d\omega}{\tau^2\omega^4 + B\omega^2 + C}
        = \frac{\mathrm{Var}[w]\,k_a^2 T_c}{2\tau\sqrt{B + 2\tau\sqrt{C}}} .

``c_I < 1`` gives ``E||a_i||^2 <= ||a_0||^2/(1 - c_I)`` for every i; ``c_I > 1`` lets the energy
grow without bound along the platoon (docs/theory.md, section 8 (Mean square)).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.theory.errors import require
from cacc_platoon.theory.exact import is_string_stable, propagation_margins
from cacc_platoon.theory.sampled import LAG_FRACTIONS
from cacc_platoon.theory.transfer import gamma, is_internally_stable

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cacc_platoon.model.control import Gains

__all__ = [
    "NoiseStatistics",
    "largest_variance",
    "leader_error_gain",
    "leader_error_norm",
    "mean_square_index",
    "uniform_error_bound",
    "worst_leader_error_gain",
]


@dataclass(frozen=True)
class NoiseStatistics:
    """Mean and variance of the noise factor, and how long one draw is held.

    Attributes
    ----------
    mean, variance : float
        ``E[w]`` and ``Var[w]``.
    redraw_period : float
        Time between draws [s].
    """

    mean: float = 1.0
    variance: float = 0.0
    redraw_period: float = 0.01


def largest_variance(rho: float) -> float:
    """Largest ``Var[w]`` of the paper's bit channel at this SNR: fair bits, ``1/(3 rho^2)``.

    Examples
    --------
    >>> round(largest_variance(5.0), 6)
    0.013333
    """
    return 1.0 / (3.0 * rho * rho)


def mean_square_index(
    gains: Gains, tau: float, k_effective: float, *, variance: float, redraw_period: float
) -> float:
    """Index ``c_I`` of mean-square string stability; below one, noise energy stays bounded.

    Parameters
    ----------
    gains : Gains
        Controller.
    tau : float
        Actuation lag [s].
    k_effective : float
        ``k_a E[w]``.
    variance : float
        ``Var[w]`` of one draw, see ``cacc_platoon.model.noise.factor_variance``.
    redraw_period : float
        Time ``Tc`` between draws [s].

    Returns
    -------
    float
        ``c_I`` (white-noise limit: ``Tc`` short against the loop); infinite when the mean system
        is not string stable.

    Raises
    ------
    DesignError
        If the variance or the period is negative or not finite.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> gains = Gains(0.95, 0.5, 0.63, 0.009)
    >>> index = mean_square_index(
    ...     gains, 0.5, 0.524086844, variance=0.00921519566, redraw_period=0.01)
    >>> round(index, 6)
    6.3e-05
    """
    for name, value in (("variance", variance), ("redraw_period", redraw_period)):
        require(
            0 <= value < math.inf,
            f"{name} = {value:g} is not a finite, nonnegative number: the noise would have no "
            f"energy balance. Give {name} >= 0.",
        )
    if not is_string_stable(gains, tau, k_effective):
        return math.inf
    strength = variance * gains.k_a**2 * redraw_period
    if strength == 0:
        return 0.0
    margin = propagation_margins(gains, tau, k_effective).margin
    return strength / (2.0 * tau * math.sqrt(margin)) if margin > 0 else math.inf


def leader_error_norm(gains: Gains, tau: float, k_effective: float) -> float:
    r"""H2 norm of ``Phi = ((h_w k - tau)s + k + h_w k_v - 1)/D``, from ``a_0`` to ``delta_1``.

    ``||Phi||_2^2 = (b1^2 k_p + b0^2) / (2 k_p (gamma - tau k_p))`` with the numerator
    ``b1 s + b0``; infinite when the loop is not internally stable.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> round(leader_error_norm(Gains(0.95, 0.5, 0.63, 0.009), 0.5, 0.524086844), 4)
    1.1475
    """
    if not is_internally_stable(gains, tau):
        return math.inf
    b1 = gains.time_headway * k_effective - tau
    b0 = k_effective + gains.time_headway * gains.k_v - 1.0
    energy = b1 * b1 * gains.k_p + b0 * b0
    room = 2.0 * gains.k_p * (gamma(gains) - tau * gains.k_p)
    return math.sqrt(energy / room) if room > 0 else math.inf


def leader_error_gain(gains: Gains, tau: float, k_effective: float) -> float:
    r"""H-infinity norm of ``Phi``, from ``a_{i-1}`` to ``delta_i``, in s^2.

    ``|Phi|^2 = (b1^2 y + b0^2)/|D|^2`` with ``y = omega^2``, whose turning points are the roots of
    a cubic; ``|Phi(0)| = |k + h_w k_v - 1|/k_p``. Infinite when not internally stable.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> round(leader_error_gain(Gains(0.95, 0.5, 0.63, 0.009), 0.5, 0.6), 4)
    22.0556
    """
    if not is_internally_stable(gains, tau):
        return math.inf
    h, _, k_v, k_p = gains
    with np.errstate(all="ignore"):  # in x = y/k_p; what overflows has no bound
        b1, b0 = h * k_effective - tau, k_effective + h * k_v - 1.0
        above = np.array([b1 / k_p * b1, b0 / k_p * (b0 / k_p)])
        load, damping = tau * tau * k_p, gamma(gains)
        below = np.array([load, 1.0 - 2.0 * tau * damping, damping**2 / k_p - 2.0, 1.0])
        if not (np.isfinite(above).all() and np.isfinite(below).all()):
            return math.inf
        slope: NDArray[np.float64] = np.polysub(
            np.polymul(np.polyder(above), below), np.polymul(above, np.polyder(below))
        )
        turning = [0.0, *(float(x) for x in np.roots(slope).real if x > 0)]
        squares = [np.polyval(above, x) / np.polyval(below, x) for x in turning]
    return math.sqrt(max(square for square in squares if math.isfinite(square)))


def worst_leader_error_gain(gains: Gains, tau_max: float, ends: tuple[float, ...]) -> float:
    """`leader_error_gain`, largest of 22 lags up to `tau_max` and none, at an end of I.

    It is convex in ``k``.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> round(worst_leader_error_gain(Gains(0.95, 0.5, 0.63, 0.009), 0.5, (0.4, 0.6)), 4)
    22.0556
    """
    lags = LAG_FRACTIONS * tau_max
    return max(leader_error_gain(gains, float(tau), k) for tau in lags for k in ends)


def uniform_error_bound(
    gains: Gains, tau: float, k_effective: float, leader_acceleration_norm: float
) -> float:
    """Bound on ``|delta_i(t)|`` [m] for every follower and all time, ``||Phi||_2 ||a_0||_2``.

    Parameters
    ----------
    gains, tau, k_effective
        As in `leader_error_norm`.
    leader_acceleration_norm : float
        ``||a_0||_2`` [m/s^1.5], the root of the integral of ``a_0^2``.

    Returns
    -------
    float
        The bound for the mean system; infinite when it is not string stable.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> gains = Gains(0.95, 0.5, 0.63, 0.009)
    >>> round(uniform_error_bound(gains, 0.5, 0.524086844, 2.8025), 3)
    3.216
    """
    if not is_string_stable(gains, tau, k_effective):
        return math.inf
    return leader_error_norm(gains, tau, k_effective) * leader_acceleration_norm
