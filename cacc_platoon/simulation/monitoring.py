"""What the monitors of a run said, worked out from what was received and measured."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cacc_platoon.simulation.bodies import measured_velocities
from cacc_platoon.simulation.trajectory import Trajectory


def alarms(run: Trajectory) -> dict[int, npt.NDArray[np.bool_]]:
    """Return, by index of the follower, at which samples the monitor of each that has one alarms.

    Nobody has one in the mean of all runs, where there is no packet.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> from cacc_platoon.simulation import simulate
    >>> tripled = {"v2v.monitor": "report", "v2v.false_data": ("15 20 factor=3",)}
    >>> run = simulate(Scenario.from_values({**tripled, "run.duration": 16.0}))
    >>> int(alarms(run)[1].argmax())
    1501
    """
    arrivals, scenario = run.arrivals, run.scenario
    if arrivals is None or not any(one.monitored for one in scenario.followers):
        return {}
    found = {}
    measured = measured_velocities(scenario, np.stack(run.motion))
    for one, seen, links in zip(
        scenario.followers, measured, scenario.topology.columns, strict=True
    ):
        if one.monitored:
            history = arrivals[links.start].of_bag(one, seen)
            assert history.alarm is not None
            found[one.index] = history.alarm
    return found
