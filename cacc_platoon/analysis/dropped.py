"""Packets that a channel delivers as zero, where a lost packet counts as zero: they are lost."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from cacc_platoon.simulation import Trajectory


def delivered_as_zero(run: Trajectory) -> npt.NDArray[np.bool_]:
    """Return which accelerations that were sent arrived as zero and so are lost, (samples, L).

    A relay may hand on a zero in place of a packet that it loses. Where the scenario loses packets
    and counts them as zero, that is the loss that its certificate covers; a link that holds the
    last packet, or loses none, has no such packets. Where packets themselves may say zero, by
    rounding, errors or false data, a zero that arrived is a packet that arrived.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> from cacc_platoon.simulation import simulate
    >>> bool(delivered_as_zero(simulate(Scenario.from_values({"run.duration": 1.0}))).any())
    False
    """
    links = [
        f.v2v.loss > 0.0 and f.v2v.reception == "zero" and not (f.errs or f.v2v.false_data)
        for f in run.scenario.receivers
    ]
    zero = (run.arrived == 0.0) & (run.sent != 0.0) & links
    return np.asarray(zero, dtype=np.bool_)
