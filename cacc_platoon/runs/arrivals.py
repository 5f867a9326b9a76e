"""What arrived over links that may lose or delay packets, read from a bag."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cacc_platoon.bags.decode import Floats, Signal, rows_in_order_of_recording
from cacc_platoon.bags.read import RawBag
from cacc_platoon.bags.rows import TopicRows
from cacc_platoon.runs.recording import with_deliveries
from cacc_platoon.runs.sample_grid import Fault, Grid
from cacc_platoon.simulation import Arrivals
from msg_adapters.topics import Graph, Role

_NONE = np.empty(0, np.int64)


def counted_rows(raw: RawBag, graph: Graph) -> dict[str, TopicRows]:
    """Return the messages of counted links with the samples at which they were delivered."""
    found: dict[str, TopicRows] = {}
    for index in graph.counted:
        for topic in (graph.vehicles[index].received, graph.vehicles[index].complete):
            parts = raw.topics.get(topic.name, [])
            rows = rows_in_order_of_recording(parts)
            if rows is not None and rows.shape[1] == topic.codec.size:
                found[topic.name] = TopicRows(parts[0].type_name, rows)
    return with_deliveries(found, graph)


def read_arrivals(
    raw: RawBag, graph: Graph, signals: Mapping[Role, Signal], grid: Grid, faults: list[Fault]
) -> dict[int, Arrivals]:
    """Return what arrived at each follower whose link counts, by its index.

    A link whose counts are not in the bag is taken for one that delivers at once what it does not
    lose, and named as a fault.
    """
    rows = counted_rows(raw, graph)
    found: dict[int, Arrivals] = {}
    for index in graph.counted:
        received = graph.vehicles[index].received
        record, signal = rows.get(received.name), signals.get(Role("received", index))
        if record is not None and record.delivered is not None:
            stamps = received.codec.stamps(record.messages)
            values, delivered = received.codec.values(record.messages), record.delivered
        elif graph.vehicles[index].complete.name in rows and not (signal and len(signal.stamps)):
            stamps, values, delivered = _NONE, _NONE.astype(np.float64), _NONE
        elif signal is not None:
            what = "is not in the bag: packets count as delivered when they were sent"
            faults.append(Fault(graph.vehicles[index].complete.name, what))
            stamps, values, delivered = signal.stamps, signal.values, signal.stamps
        else:
            continue
        source, sample = ((at - grid.origin) // grid.step for at in (stamps, delivered))
        known = (source >= 0) & (sample < grid.samples) & np.isfinite(values)
        found[index] = Arrivals(source[known], sample[known], values[known])
    return found


def prompt_arrivals(received: Floats) -> Arrivals:
    """Return what arrived over a link that delivers every packet at once, (samples,)."""
    sample = np.flatnonzero(np.isfinite(received))
    return Arrivals(sample, sample, received[sample])
