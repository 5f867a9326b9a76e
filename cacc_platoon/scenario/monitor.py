"""The monitor that the parameters of a follower describe."""

from __future__ import annotations

import math

from cacc_platoon.model import Allowances, AssumptionMonitor, Sensing
from cacc_platoon.scenario.v2v_parameters import V2V


def assumption_monitor(v2v: V2V, sensing: Sensing, step: float) -> AssumptionMonitor:
    """Return the monitor of a link, from its first sample on.

    Parameters
    ----------
    v2v : V2V
        The parameters of the link.
    sensing : Sensing
        How its receiver measures the sender.
    step : float
        Control period [s].
    """
    sigmas = v2v.monitor_margin
    allowed = Allowances(
        v2v.rho,
        velocity=sigmas * math.sqrt(2.0) * sensing.range_rate_std,
        acceleration=abs(v2v.bias) + sigmas * v2v.noise_std + 0.5 * v2v.quantum,
        jerk=v2v.monitor_jerk,
        saturation=v2v.saturation,
    )
    return AssumptionMonitor(allowed, step, round(v2v.monitor_window / step), sensing.delay)
