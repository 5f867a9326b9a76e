"""How ``|H(j omega)|`` of one design spreads over the lags and effective gains it must tolerate.

What the band must stay below is derived in docs/theory.md, section 3 (The exact test), and that
of a platoon whose packets are rare or late in section 7 (V2V latency).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.theory.lifted_hop import PacketTimes, spectral_radius
from cacc_platoon.theory.noise_interval import effective_interval
from cacc_platoon.theory.transfer import frequency_response, poles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cacc_platoon.model.control import Gains

    Float = NDArray[np.float64]

__all__ = ["ResponseBand", "packet_response_band", "response_band"]


class ResponseBand(NamedTuple):
    """``|H(j omega)|``, or the growth per hop, of one design under all its uncertainty.

    Attributes
    ----------
    omega : ndarray, shape (n,)
        Frequencies [rad/s].
    low, high : ndarray, shape (n,)
        Least and largest magnitude over I and the lags.
    nominal : ndarray, shape (n,)
        Magnitude at `k_effective` and the largest lag.
    k_effective : float
        Effective gain of the nominal curve.
    """

    omega: Float
    low: Float
    high: Float
    nominal: Float
    k_effective: float


def response_band(
    gains: Gains,
    rho: float,
    tau_max: float,
    *,
    k_effective: float | None = None,
    reception: float = 1.0,
) -> ResponseBand:
    """Compute `ResponseBand`; the nominal curve has ``E[w] = 1`` unless given otherwise.

    With a `reception` below one I reaches down to where that share of the packets arrives.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> band = response_band(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5)
    >>> bool((band.low <= band.nominal).all() and (band.nominal <= band.high).all())
    True
    """
    nominal = gains.k_a if k_effective is None else k_effective
    rates = np.abs(poles(gains, tau_max))
    omega = np.geomspace(0.03 * float(np.min(rates)), 10.0 * float(np.max(rates)), 600)
    low, high = effective_interval(gains.k_a, rho, reception=reception)
    curve = np.abs(frequency_response(gains, tau_max, nominal, omega))
    least, most = curve, curve
    for tau in tau_max * np.linspace(0.02, 1.0, 12):
        for k in np.linspace(low, high, 9):
            magnitude = np.abs(frequency_response(gains, float(tau), float(k), omega))
            least, most = np.minimum(least, magnitude), np.maximum(most, magnitude)
    return ResponseBand(omega, least, most, curve, nominal)


def packet_response_band(
    gains: Gains, rho: float, tau_max: float, packets: PacketTimes, *, reception: float = 1.0
) -> ResponseBand:
    """Growth per hop of the sampled loop with these packets, over I and 5 lags.

    Up to half a turn per V2V period: what is faster mixes with what is slower.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> rare = PacketTimes.of(0.01, 20, latency=0.0, held=1.0)
    >>> band = packet_response_band(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5, rare)
    >>> round(float(band.high.max()), 3)
    1.003
    """
    angle = packets.angles(gains, 200)
    low, high = effective_interval(gains.k_a, rho, reception=reception)
    lags, ends = tau_max * np.linspace(0.02, 1.0, 5), np.array([low, high, gains.k_a])
    hop = packets.hop(gains, lags[:, np.newaxis, np.newaxis], ends[:, np.newaxis], angle)
    growth = spectral_radius(hop)
    every = growth[:, :2].reshape(-1, angle.size)
    omega = angle / (packets.period * packets.interval)
    return ResponseBand(omega, every.min(axis=0), every.max(axis=0), growth[-1, 2], gains.k_a)
