"""Everything a design guarantees and tolerates, in one record."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cacc_platoon.theory.errors import require, require_positive, require_rho
from cacc_platoon.theory.exact import (
    L2Gain,
    is_robustly_string_stable,
    is_string_stable,
    l2_gain,
    linf_gain,
)
from cacc_platoon.theory.latency import latency_margin
from cacc_platoon.theory.mean_square import leader_error_norm, mean_square_index
from cacc_platoon.theory.noise_interval import effective_interval
from cacc_platoon.theory.region import stable_gain_range
from cacc_platoon.theory.sampled import critical_period, is_sampled_string_stable
from cacc_platoon.theory.theorem2 import in_paper_region
from cacc_platoon.theory.transfer import is_internally_stable, slowest_time_constant

if TYPE_CHECKING:
    from cacc_platoon.model.control import Gains

__all__ = ["Certificate", "NoiseStatistics", "SampledCertificate", "certify", "worst_l2_gain"]


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


@dataclass(frozen=True)
class SampledCertificate:
    """String stability of the sampled loop.

    Attributes
    ----------
    period : float
        Control period asked for [s].
    string_stable : bool
        Whether that period keeps string stability, with a fresh acceleration.
    critical_period, critical_period_stale_accel : float
        Period at which it is first lost [s], acceleration fresh or one period old.
    """

    period: float
    string_stable: bool
    critical_period: float
    critical_period_stale_accel: float


@dataclass(frozen=True)
class Certificate:
    """What one design guarantees: worst over tau in (0, tau_max] and I unless said otherwise.

    Attributes
    ----------
    internally_stable, in_paper_region, string_stable : bool
        Routh; the paper's sufficient region; the exact test.
    l2_gain, peak_frequency : float
        Worst ``sup |H|`` and its frequency [rad/s].
    linf_gain : float
        Largest L1 norm of the impulse response at `tau_max` over both ends of I.
    sampled : SampledCertificate
        The same at a control period.
    latency_margin : float
        Largest V2V latency [s].
    mean_square_index : float
        ``c_I`` at `tau_max` and the mean noise; below one is bounded.
    slowest_time_constant : float
        Slowest mode at `tau_max` [s].
    leader_error_norm : float
        ``||Phi||_2`` at `tau_max`, largest over both ends of I.
    gain_range : tuple of float or None
        Effective gains ``k_a E[w]`` that these gains tolerate.
    """

    internally_stable: bool
    in_paper_region: bool
    string_stable: bool
    l2_gain: float
    peak_frequency: float
    linf_gain: float
    sampled: SampledCertificate
    latency_margin: float
    mean_square_index: float
    slowest_time_constant: float
    leader_error_norm: float
    gain_range: tuple[float, float] | None


def worst_l2_gain(gains: Gains, rho: float, tau_max: float) -> L2Gain:
    """Compute ``sup |H|`` over all frequencies, lags in (0, tau_max] and ``k`` in I.

    It is that of `tau_max` at an end of I: ``|N|^2`` is convex in ``k``, and where a smaller lag
    is worse at one frequency, `tau_max` is worse still at another (docs/theory.md, Theorem F).

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> worst_l2_gain(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5)
    L2Gain(gain=1.0, peak_omega=0.0)
    """
    low, high = effective_interval(gains.k_a, rho)
    return max(l2_gain(gains, tau_max, low), l2_gain(gains, tau_max, high))


def certify(
    gains: Gains,
    rho: float,
    tau_max: float,
    *,
    period: float = 0.01,
    noise: NoiseStatistics | None = None,
    k_effective: float | None = None,
) -> Certificate:
    """Certify one design.

    Parameters
    ----------
    gains : Gains
        Controller.
    rho : float
        Linear signal-to-noise ratio, > 1.
    tau_max : float
        Largest actuation lag ``tau_0`` [s].
    period : float, optional
        Control period [s].
    noise : NoiseStatistics, optional
        Mean and variance for the mean-square index; no noise by default.
    k_effective : float, optional
        Certify for this effective gain at `tau_max` only, instead of the worst case.

    Returns
    -------
    Certificate
        All guarantees. A design that is not string stable is an answer, not an error.

    Raises
    ------
    DesignError
        If a value is out of its range or not finite.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> certificate = certify(Gains(0.95, 0.5, 0.63, 0.009), rho=5.0, tau_max=0.5)
    >>> certificate.string_stable, round(certificate.latency_margin, 4)
    (True, 0.0818)
    """
    _check(gains, rho, tau_max, period, k_effective)
    noise = noise or NoiseStatistics(redraw_period=period)
    if k_effective is None:
        ends = tuple(effective_interval(gains.k_a, rho))
        stable = is_robustly_string_stable(gains, rho, tau_max)
        worst = worst_l2_gain(gains, rho, tau_max)
        mean_gain = gains.k_a * noise.mean
    else:
        ends, mean_gain = (k_effective,), k_effective
        stable = is_string_stable(gains, tau_max, k_effective)
        worst = l2_gain(gains, tau_max, k_effective)
    return Certificate(
        internally_stable=is_internally_stable(gains, tau_max),
        in_paper_region=in_paper_region(gains, rho, tau_max),
        string_stable=stable,
        l2_gain=worst.gain,
        peak_frequency=worst.peak_omega,
        linf_gain=max(linf_gain(gains, tau_max, k) for k in ends),
        sampled=_certify_sampled(gains, rho, tau_max, period, k_effective),
        latency_margin=latency_margin(gains, rho, tau_max, k_effective=k_effective),
        mean_square_index=mean_square_index(
            gains,
            tau_max,
            mean_gain,
            variance=noise.variance,
            redraw_period=noise.redraw_period,
        ),
        slowest_time_constant=slowest_time_constant(gains, tau_max),
        leader_error_norm=max(leader_error_norm(gains, tau_max, k) for k in ends),
        gain_range=stable_gain_range(gains, tau_max),
    )


def _certify_sampled(
    gains: Gains, rho: float, tau_max: float, period: float, k_effective: float | None
) -> SampledCertificate:
    fresh, stale = (
        critical_period(gains, rho, tau_max, stale=stale, k_effective=k_effective)
        for stale in (False, True)
    )
    stable = is_sampled_string_stable(gains, rho, tau_max, period, k_effective=k_effective)
    return SampledCertificate(period, stable, fresh, stale)


def _check(
    gains: Gains, rho: float, tau_max: float, period: float, k_effective: float | None
) -> None:
    require_rho(rho)
    require_positive("tau_max", tau_max, "s")
    require_positive("period", period, "s")
    require_positive("time_headway", gains.time_headway, "s")
    numbers = {**gains._asdict(), "k_effective": 0.0 if k_effective is None else k_effective}
    for name, value in numbers.items():
        require(
            math.isfinite(value) and value >= 0,
            f"{name} = {value:g} is not a finite, nonnegative number: the control law would push "
            f"the wrong way. Give {name} >= 0.",
        )
