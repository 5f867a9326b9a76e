"""The interval I = [m k_a, M k_a] that noise of one SNR leaves for k_a E[w], m, M = 1 -+ 1/rho.

A packet that arrives with probability ``p`` and counts as zero when lost has ``k = p k_a E[w]``:
where at least a share `reception` arrives, I becomes ``[reception m k_a, M k_a]``. The symbols are
those of docs/theory.md, section 1 (Setting).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cacc_platoon.model import factor_interval
from cacc_platoon.theory.errors import require, require_reception, require_rho

__all__ = [
    "EffectiveInterval",
    "checked_interval",
    "effective_gains",
    "effective_interval",
    "k_a_max",
    "rho_from_snr_db",
    "snr_db_from_rho",
]


class EffectiveInterval(NamedTuple):
    """The paper's interval I of effective feed-forward gains ``k_a E[w]``.

    Attributes
    ----------
    low, high : float
        ``m k_a``, times the reception, and ``M k_a``.
    """

    low: float
    high: float


def effective_interval(k_a: float, rho: float, *, reception: float = 1.0) -> EffectiveInterval:
    """Interval ``I = [m k_a, M k_a]`` that holds ``k_a E[w]`` for every noise of this SNR.

    Parameters
    ----------
    k_a : float
        Feed-forward gain.
    rho : float
        Linear signal-to-noise ratio, > 1; infinity means no noise.
    reception : float, optional
        Smallest packet reception probability, losses counted as zero.

    Raises
    ------
    DesignError
        If `rho` is not above one or `reception` is not a probability.

    Examples
    --------
    >>> effective_interval(0.5, 5.0)
    EffectiveInterval(low=0.4, high=0.6)
    """
    require_rho(rho)
    require_reception(reception)
    low, high = factor_interval(rho)
    return EffectiveInterval(reception * low * k_a, high * k_a)


def effective_gains(
    k_a: float, rho: float, *, reception: float = 1.0, k_effective: float | None = None
) -> tuple[float, ...]:
    """List the effective gains that decide a worst case: both ends of I, or the one asked for.

    Every guarantee here is convex or concave in ``k`` so that nothing inside I is worse.

    Examples
    --------
    >>> effective_gains(0.5, 5.0), effective_gains(0.5, 5.0, k_effective=0.52)
    ((0.4, 0.6), (0.52,))
    """
    if k_effective is not None:
        return (k_effective,)
    return tuple(effective_interval(k_a, rho, reception=reception))


def checked_interval(k_a: float, rho: float, *, reception: float = 1.0) -> EffectiveInterval:
    """`effective_interval`, refusing a gain outside ``[0, k_a_max(rho))``.

    Raises
    ------
    DesignError
        If `k_a`, `rho` or `reception` is out of range.
    """
    interval = effective_interval(k_a, rho, reception=reception)
    require(
        k_a >= 0 and interval.high < 1,
        f"k_a = {k_a:g} is outside [0, {k_a_max(rho):.6g}), the open cap 1/(1 + 1/rho) at "
        f"rho = {rho:g}: k_a E[w] may reach 1 and no headway is string stable. Lower k_a or raise "
        "rho.",
    )
    return interval


def k_a_max(rho: float) -> float:
    """Cap of the feed-forward gain, ``1/(1 + 1/rho)``, excluded (equation (16), largest k_a).

    Examples
    --------
    >>> round(k_a_max(5.0), 6)
    0.833333
    """
    require_rho(rho)
    return 1.0 / (1.0 + 1.0 / rho)


def rho_from_snr_db(snr_db: float) -> float:
    """Linear signal-to-noise ratio ``rho = 10^(SNR/20)``.

    Raises
    ------
    DesignError
        If the SNR is not above 0 dB.

    Examples
    --------
    >>> rho_from_snr_db(20.0)
    10.0
    """
    require(
        0 < snr_db < 6000,
        f"snr_db = {snr_db:g} dB is outside 0 to 6000 dB: the noise would be as large as the "
        "signal, or too small for a number. Give an SNR above 0 dB.",
    )
    return float(10.0 ** (snr_db / 20.0))


def snr_db_from_rho(rho: float) -> float:
    """``SNR = 20 log10(rho)`` in dB.

    Examples
    --------
    >>> snr_db_from_rho(10.0)
    20.0
    """
    require_rho(rho)
    return 20.0 * math.log10(rho)
