"""When vehicles took their samples by clocks, and with how old a pose, read from a bag."""

from __future__ import annotations

import numpy as np

from cacc_platoon.bags.decode import rows_in_order_of_recording
from cacc_platoon.bags.read import RawBag
from cacc_platoon.runs.sample_grid import Fault, Grid
from cacc_platoon.simulation.timing import Timing
from msg_adapters.topics import Graph

_ABSURD = 1e9  # control periods; only damaged bytes say more


def read_timing(raw: RawBag, graph: Graph, grid: Grid, faults: list[Fault]) -> Timing | None:
    """Return the timing of every follower's samples; None for a run in lockstep.

    Where it is not known a sample counts as one in time, with a pose of the same sample.
    """
    if not graph.clocked:
        return None
    shape = grid.samples, len(graph.topology.followers)
    age, lateness = np.zeros(shape, np.int64), np.full(shape, np.nan)
    for column, index in enumerate(graph.topology.followers):
        topic = graph.vehicles[index].timing
        rows = rows_in_order_of_recording(raw.topics.get(topic.name, []))
        if rows is None or rows.shape[1] != topic.codec.size:
            faults.append(Fault(topic.name, "is not in the bag: poses count as new"))
            continue
        stamps = topic.codec.stamps(rows) - grid.origin
        old, late = topic.codec.values(rows), topic.codec.values(rows, "y")
        sample = stamps // grid.step
        known = (stamps % grid.step == 0) & (sample >= 0) & (sample < grid.samples)
        known &= (old >= 0.0) & (old <= sample) & (np.floor(old) == old) & (np.abs(late) < _ABSURD)
        if not known.all() or len(np.unique(sample[known])) != grid.samples:
            what = "lacks samples, or has some twice or damaged: poses count as new there"
            faults.append(Fault(topic.name, what))
        age[sample[known], column] = old[known].astype(np.int64)
        lateness[sample[known], column] = late[known]
    return Timing(age, lateness)
