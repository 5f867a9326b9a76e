r"""What noise that changes in time does to the energy of the sampled platoon, exactly.

Vehicle i receives ``w a_{i-1}`` with ``w`` redrawn every ``n`` control periods, independently of
everything before. With ``G = k_a N_a/D_T`` and the mean hop ``H = H_T``, the energies of
successive vehicles obey a renewal equation; they stay bounded iff its growth is below one
(docs/theory.md, section 8 (Mean square)). Redrawn at every period (``n = 1``),

.. math::
    c_T = \mathrm{Var}[w]\,\frac{1}{2\pi}\int \frac{|G|^2}{1 - |H|^2}\,d\theta
        = \mathrm{Var}[w]\,k_a^2\,\frac{1}{2\pi}\int \frac{a_1^2\,\eta}{q(\eta)}\,d\theta ,

the integral of a rational function, by residues. Held for ``n`` periods the loop is lifted over
them: the growth is the spectral radius of a positive map on ``n x n`` matrices. Noise that never
changes is random, but constant: then every vehicle's mean square must not grow at any frequency.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.theory.errors import require, require_positive
from cacc_platoon.theory.exact import TOLERANCE, is_string_stable, propagation_margins
from cacc_platoon.theory.mean_square import NoiseStatistics
from cacc_platoon.theory.sampled import (
    LAG_FRACTIONS,
    is_sampled_string_stable,
    propagation_polynomial,
    sampled_hop,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cacc_platoon.model.control import Gains

    Complex = NDArray[np.complex128]

__all__ = [
    "frozen_noise_margin",
    "sampled_mean_square_index",
    "worst_frozen_noise_margin",
    "worst_mean_square_index",
]

_MOST_LIFTED = 16
_NEXT_TO_NONE = 1e-6
_ANGLES = 192
_ITERATIONS, _SETTLED = 200, 1e-9


def sampled_mean_square_index(
    gains: Gains,
    tau: float,
    k_effective: float,
    period: float,
    *,
    variance: float,
    hold: int = 1,
) -> float:
    """Growth of mean-square energy along a sampled platoon; below one it stays bounded.

    Parameters
    ----------
    gains : Gains
        Controller.
    tau, k_effective, period : float
        Lag [s], ``k_a E[w]``, control period ``T`` [s].
    variance : float
        ``Var[w]`` of one draw.
    hold : int, optional
        Control periods that a draw is held. Of more than 16 the loop is taken as sampled 16 times
        in a draw.

    Returns
    -------
    float
        ``c_T``: below one energies stay bounded and tend to zero along the platoon, above one they
        grow geometrically. Redrawn at every period, ``E||a_i||^2 <= ||a_0||^2/(1 - c_T)``.
        Infinite when the mean sampled loop is not string stable, NaN when it is, but is not with
        16 samples in a draw: then noise is as good as frozen, see `frozen_noise_margin`.

    Raises
    ------
    DesignError
        If a value is out of its range.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> question = Gains(0.75, 0.5, 0.8, 0.5), 0.5, 0.524086844, 0.04
    >>> for n in (1, 2, 5):
    ...     print(round(sampled_mean_square_index(*question, variance=4.0, hold=n), 4))
    0.2386
    0.472
    1.1476
    """
    require_positive("tau", tau, "s")
    require_positive("period", period, "s")
    require(
        0 <= variance < math.inf,
        f"variance = {variance:g} is not a finite, nonnegative number: the noise would have no "
        "energy balance. Give variance >= 0.",
    )
    require(hold >= 1, f"hold = {hold} is below one control period: no draw is so short. Give 1.")
    if not is_sampled_string_stable(gains, math.inf, tau, period, k_effective=k_effective):
        return math.inf
    strength = variance * gains.k_a**2
    if strength == 0:
        return 0.0
    if hold == 1:
        return strength * _white(gains, tau, k_effective, period)
    if hold > _MOST_LIFTED:
        period *= hold / _MOST_LIFTED
        if not is_sampled_string_stable(gains, math.inf, tau, period, k_effective=k_effective):
            return math.nan
    return strength * _held(gains, tau, k_effective, period, min(hold, _MOST_LIFTED))


def _white(gains: Gains, tau: float, k: float, period: float) -> float:
    """``(1/2 pi) int a1^2 eta/q(eta) d theta``, with ``eta = (2 - 2 cos theta)/T^2``."""
    h, _, k_v, k_p = gains
    hop = sampled_hop(h, k_v, k_p, tau, k, period=period)
    q, _ = propagation_polynomial(hop, np.asarray(period))
    a1 = (
        float(hop.numerator[2] - sampled_hop(h, k_v, k_p, tau, 0.0, period=period).numerator[2]) / k
    )
    r1, r2 = np.roots(q[2::-1]).astype(complex)
    if abs(r1 - r2) < 1e-7 * abs(r1):
        r2 = r1 * (1.0 + 1e-6)
    total = (r1 * _pole_mean(r1, period) - r2 * _pole_mean(r2, period)) / (r1 - r2)
    value = float((a1 * a1 / float(q[2]) * total).real)
    return value if math.isfinite(value) and value >= 0 else math.inf


def _pole_mean(r: complex, period: float) -> complex:
    """``(1/2 pi) int d theta/(eta - r)``: with ``z + 1/z = 2 - T^2 r``, by the root inside."""
    c = -period * period * r
    root = np.sqrt(c * (c + 4.0) + 0j)
    inside = 0.5 * (2.0 + c - root)
    return complex(period * period / (root if abs(inside) < 1.0 else -root))


def _held(gains: Gains, tau: float, k: float, period: float, n: int) -> float:
    r"""Spectral radius of ``X -> (1/2 pi) int sum_m (H^m G) X (H^m G)^* d theta``, over ``k_a^2``.

    At one angle the lifted hop is diagonal in the basis of the ``n`` frequencies that alias to it,
    where the sum over m is the kernel ``G_p conj(G_q)/(1 - H_p conj(H_q))``.
    """
    angle = np.pi * (np.arange(_ANGLES) + 0.5) / _ANGLES
    weight = np.full(_ANGLES, 1.0 / _ANGLES)
    for _ in range(2):  # dense where the loop is slow
        angle, weight = angle - np.sin(angle), weight * (1.0 - np.cos(angle))
    alias = (angle[:, np.newaxis] + 2.0 * np.pi * np.arange(n)) / n
    d = 2.0 * np.sin(0.5 * alias) / period * (1j * np.cos(0.5 * alias) - np.sin(0.5 * alias))
    h, _, k_v, k_p = gains
    hop = sampled_hop(h, k_v, k_p, tau, k, period=period)
    silent = sampled_hop(h, k_v, k_p, tau, 0.0, period=period)
    own, moved, heard, error = (
        np.polynomial.polynomial.polyval(d, np.array(c, dtype=float))
        for c in (
            hop.denominator,
            hop.numerator,
            np.subtract(hop.numerator, silent.numerator) / k,
            np.subtract(hop.denominator, hop.numerator),
        )
    )
    rest = own[:, :, np.newaxis] * own.conj()[:, np.newaxis, :]
    rest = rest - moved[:, :, np.newaxis] * moved.conj()[:, np.newaxis, :]
    every = np.arange(n)
    rest[:, every, every] = (error * (own + moved).conj()).real  # |D|^2 - |N|^2, all its digits
    kernel = heard[:, :, np.newaxis] * heard.conj()[:, np.newaxis, :] / rest
    basis = np.exp(-1j * alias[:, :, np.newaxis] * np.arange(n)) / math.sqrt(n)
    back = basis.conj().transpose(0, 2, 1)
    X, growth = np.eye(n) / n, 0.0
    for _ in range(_ITERATIONS):
        Y = np.tensordot(weight, (back @ (kernel * (basis @ X @ back)) @ basis).real, 1)
        before, growth = growth, float(np.trace(Y))
        X = Y / growth
        if abs(growth - before) <= _SETTLED * growth:
            break
    return growth


def worst_mean_square_index(
    gains: Gains, tau_max: float, k_effective: float, period: float, noise: NoiseStatistics
) -> float:
    """`sampled_mean_square_index`, largest of 22 lags up to `tau_max`, the first next to none.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> A, noise = Gains(0.95, 0.5, 0.63, 0.009), NoiseStatistics(1.048, 0.0092, 0.01)
    >>> f"{worst_mean_square_index(A, 0.5, 0.524, 0.01, noise):.3g}"
    '0.00321'
    """
    hold = max(1, round(noise.redraw_period / period))
    return max(
        sampled_mean_square_index(
            gains, float(tau), k_effective, period, variance=noise.variance, hold=hold
        )
        for tau in tau_max * np.maximum(LAG_FRACTIONS, _NEXT_TO_NONE)
    )


def worst_frozen_noise_margin(
    gains: Gains, tau_max: float, k_effective: float, noise: NoiseStatistics
) -> float:
    """`frozen_noise_margin` over all lags up to `tau_max`, linear in the lag: the worse end.

    Without lag it is ``1 - k^2 - Var[w] k_a^2``.
    """
    variance = noise.variance * gains.k_a**2
    return min(
        frozen_noise_margin(gains, tau_max, k_effective, variance=noise.variance),
        1.0 - k_effective**2 - variance,
    )


def frozen_noise_margin(gains: Gains, tau: float, k_effective: float, *, variance: float) -> float:
    """``B - Var[w] k_a^2 + 2 tau sqrt(C)`` of noise that is random but never changes.

    Drawn once per link, independently, ``E|a_i(j omega)|^2`` does not grow along the platoon at any
    frequency iff this is at least zero and ``C >= 0``.

    Parameters
    ----------
    gains : Gains
        Controller.
    tau, k_effective : float
        Lag [s] and ``k_a E[w]``.
    variance : float
        ``Var[w]``.

    Returns
    -------
    float
        The margin; minus infinity when the mean system is not string stable.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> frozen_noise_margin(Gains(0.95, 0.5, 0.63, 0.009), 0.5, 0.5, variance=1 / 75) > 0
    True
    """
    require_positive("tau", tau, "s")
    if not is_string_stable(gains, tau, k_effective):
        return -math.inf
    margin = propagation_margins(gains, tau, k_effective).margin - variance * gains.k_a**2
    return 0.0 if -TOLERANCE < margin < 0 else margin
