"""The least gap of a platoon over all brakings of its leader, as far as theory knows it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.theory import DesignError, worst_spacing
from cacc_platoon.theory.worst_braking import SHARES

if TYPE_CHECKING:
    from cacc_platoon.analysis.verdict import Verdict
    from cacc_platoon.scenario import Scenario

DECELERATION = 8.0
"""An emergency braking on a dry road [m/s^2]."""
_MOST_VEHICLES = 12


class WorstBraking(NamedTuple):
    """The least gap [m] over all brakings of up to a deceleration [m/s^2] from a speed [m/s].

    Attributes
    ----------
    gap, speed, deceleration : float
        In the mean system, the least of both ends of I and of the lags of `SHARES`; NaN where it
        cannot be computed.
    vehicles : int
        So many followers are looked at.
    """

    gap: float
    speed: float
    deceleration: float
    vehicles: int


def worst_braking(scenario: Scenario, verdict: Verdict) -> WorstBraking | None:
    """Compute it for equal followers of the certified law that move; None for others.

    None, too, where packets are rare or late, or parameters change in the course of the run.

    Examples
    --------
    >>> from cacc_platoon.analysis import judge
    >>> from cacc_platoon.scenario import Scenario
    >>> scenario = Scenario.from_values({"platoon.followers": 3})
    >>> found = worst_braking(scenario, judge(scenario))
    >>> round(found.gap, 1)
    4.8
    """
    certificate, speed = verdict.weakest.certificate, scenario.platoon.initial_speed
    unequal = scenario.changes or not verdict.equal_links
    other = verdict.another_law or verdict.weakest.rare_or_late or unequal
    if certificate is None or other or speed <= 0:
        return None
    vehicles = min(scenario.platoon.followers, _MOST_VEHICLES)
    try:
        with np.errstate(all="ignore"):
            gaps = worst_spacing(
                certificate.gains,
                [share * certificate.tau_max for share in SHARES for _ in certificate.interval],
                [*certificate.interval] * len(SHARES),
                standstill_distance=scenario.platoon.standstill_distance,
                speed=speed,
                deceleration=DECELERATION,
                vehicles=vehicles,
                steps=20.0,
            )
    except (DesignError, ArithmeticError, MemoryError, ValueError):
        return WorstBraking(math.nan, speed, DECELERATION, vehicles)
    gap = float(np.min(gaps - np.array(scenario.lengths[:vehicles])))
    return WorstBraking(gap, speed, DECELERATION, vehicles)
