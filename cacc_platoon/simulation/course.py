"""What followers go through in a run: states of their reception, and where limits act."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cacc_platoon.model import ReceptionState
from cacc_platoon.model.packets import Integers
from cacc_platoon.simulation.platoon import commands_of
from cacc_platoon.simulation.trajectory import Array, Trajectory


def reception_state(share: Array) -> Integers:
    """Return the `ReceptionState` at each sample, of the share of the control law, (samples,)."""
    rises = np.diff(share, prepend=1.0) > 0.0
    between = np.where(rises, int(ReceptionState.RECOVERING), int(ReceptionState.DEGRADING))
    found = np.where(share == 0.0, int(ReceptionState.FALLBACK), between)
    return np.where(share == 1.0, int(ReceptionState.NORMAL), found)


def limits_act(run: Trajectory) -> npt.NDArray[np.bool_]:
    """Return at which samples a follower cannot carry out its command, or stands, (samples, N).

    Commands of custom laws are not known, nor is what limits made of them.
    """
    followers = run.scenario.followers
    limited = np.array([bool(one.limits()) and not one.law_name for one in followers])
    stops = np.array([one.stops for one in followers])
    acts: npt.NDArray[np.bool_] = (
        stops & (run.velocity[:, 1:] == 0.0) & (run.acceleration[:, 1:] == 0.0)
    )
    if limited.any():
        commands = commands_of(run)
        acts |= limited & (commands.wanted != commands.carried_out)
    return acts
