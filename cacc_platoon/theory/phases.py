"""Packets at their own rate when each vehicle sends at a phase of its own.

They may be drawn, and then the mean hop mixes no frequencies; or follow each other, and then every
hop is the one of equal phases, turned (docs/theory.md, section 7 (V2V latency)).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.theory.errors import require_positive
from cacc_platoon.theory.lifted_hop import PacketTimes, mean_phase_size, spectral_radius
from cacc_platoon.theory.multirate import ANGLES, GROWS, HopGrowth, largest_peak, multirate_growth

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cacc_platoon.model.control import Gains

    Float = NDArray[np.float64]

__all__ = ["PhaseGrowth", "mean_phase_growth", "worst_phase_growth"]

_PHASES = 24


def mean_phase_growth(
    gains: Gains,
    tau: float,
    k_effective: float,
    period: float,
    interval: int,
    *,
    latency: float = 0.0,
    held: float = 1.0,
) -> HopGrowth:
    """`multirate_growth` in the mean over phases, when each vehicle sends at its own.

    Phases are independent and evenly distributed over the V2V period; the mean hop mixes no
    frequencies then. One platoon with phases that stay differs from it.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> found = mean_phase_growth(Gains(0.95, 0.5, 0.63, 0.009), 0.5, 0.6, 0.01, interval=20)
    >>> round(found.growth, 6)
    1.002463
    """
    require_positive("tau", tau, "s")
    packets = PacketTimes.of(period, interval, latency, held)
    growth, angle, _ = largest_peak(
        lambda angle, tau, k: mean_phase_size(packets.hop(gains, tau, k, angle)),
        packets.angles(gains, ANGLES),
        (np.array([[tau]]), np.array([[k_effective]])),
    )
    if not growth > GROWS:
        return HopGrowth(1.0, 0.0, tau, k_effective)
    return HopGrowth(growth, angle / (period * interval), tau, k_effective)


class PhaseGrowth(NamedTuple):
    """Growth when each vehicle sends a number of control periods after its predecessor.

    Attributes
    ----------
    growth : HopGrowth
        The largest over all such numbers.
    step : int
        At which number it is, 0 where all send at the same instants.
    """

    growth: HopGrowth
    step: int


def worst_phase_growth(
    gains: Gains,
    tau: float,
    k_effective: float,
    period: float,
    interval: int,
    *,
    latency: float = 0.0,
    held: float = 1.0,
) -> PhaseGrowth:
    """`multirate_growth`, largest over by how much later each vehicle sends than the one ahead.

    Parameters
    ----------
    gains, tau, k_effective, period, interval, latency, held
        As in `multirate_growth`.

    Returns
    -------
    PhaseGrowth
        By a search over angles for numbers of periods from 0 to below `interval`, of which at most
        25 are tried (numerical).

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> design = Gains(1.0276291, 0.5204794, 0.4646634, 0.3213722)
    >>> found = worst_phase_growth(design, 0.5, 0.6039706, 0.04, interval=14, latency=0.08)
    >>> round(found.growth.growth, 4), found.step
    (1.0116, 2)
    """
    found = multirate_growth(gains, tau, k_effective, period, interval, latency=latency, held=held)
    worst = PhaseGrowth(found, 0)
    if not math.isfinite(found.growth) or interval == 1:
        return worst
    packets = PacketTimes.of(period, interval, latency, held)
    pair = (np.array([[tau]]), np.array([[k_effective]]))
    for step in np.unique(np.linspace(1, interval - 1, _PHASES).round().astype(int)).tolist():

        def shifted(angle: Float, tau: Float, k: Float, step: int = step) -> Float:
            return spectral_radius(packets.shifted(packets.hop(gains, tau, k, angle), angle, step))

        growth, angle, _ = largest_peak(shifted, packets.angles(gains, ANGLES), pair)
        if growth > max(GROWS, worst.growth.growth):
            omega = angle / (period * interval)
            worst = PhaseGrowth(HopGrowth(growth, omega, tau, k_effective), step)
    return worst
