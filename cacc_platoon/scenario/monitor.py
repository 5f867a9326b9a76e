"""The monitor that the parameters of a follower describe."""

from __future__ import annotations

import math
from collections.abc import Sequence

from cacc_platoon.model import Allowances, AssumptionMonitor, Sensing
from cacc_platoon.scenario.v2v_parameters import V2V


def assumption_monitor(stages: Sequence[V2V], sensing: Sensing, step: float) -> AssumptionMonitor:
    """Return the monitor of a link, from its first sample on.

    Parameters
    ----------
    stages : sequence of V2V
        The parameters of the link at the beginning, and after each change in the run: the widest
        errors are allowed for.
    sensing : Sensing
        How its receiver measures the sender.
    step : float
        Control period [s].
    """
    v2v = stages[0]
    sigmas = v2v.monitor_margin
    said = max(abs(one.bias) + sigmas * one.noise_std for one in stages)
    allowed = Allowances(
        v2v.rho,
        velocity=sigmas * math.sqrt(2.0) * sensing.range_rate_std,
        acceleration=said + 0.5 * v2v.quantum,
        jerk=v2v.monitor_jerk,
        saturation=v2v.saturation,
    )
    return AssumptionMonitor(allowed, step, round(v2v.monitor_window / step), sensing.delay)
