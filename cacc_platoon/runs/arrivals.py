"""What arrived over links that may lose or delay packets, read from a bag."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cacc_platoon.bags.decode import Floats, Signal, rows_in_order_of_recording
from cacc_platoon.bags.read import RawBag
from cacc_platoon.bags.rows import TopicRows
from cacc_platoon.model import Link
from cacc_platoon.runs.recording import with_deliveries
from cacc_platoon.runs.sample_grid import Fault, Grid
from cacc_platoon.simulation import Arrivals
from msg_adapters.topics import Graph, LinkTopics, Role

_NO_SIGNAL = Signal("", np.empty(0, np.int64), np.empty(0), 0)
_AT_ONCE = "packets count as delivered when they were sent"


def counted_rows(raw: RawBag, graph: Graph) -> dict[str, TopicRows]:
    """Return the messages of counted links with the samples at which they were delivered."""
    found: dict[str, TopicRows] = {}
    for topics in graph.counted_links.values():
        for topic in topics:
            parts = raw.topics.get(topic.name, [])
            rows = rows_in_order_of_recording(parts)
            if rows is not None and rows.shape[1] == topic.codec.size:
                found[topic.name] = TopicRows(parts[0].type_name, rows)
    return with_deliveries(found, graph)


def read_arrivals(
    raw: RawBag, graph: Graph, signals: Mapping[Role, Signal], grid: Grid, faults: list[Fault]
) -> dict[Link, Arrivals]:
    """Return what arrived over each link that counts.

    A link whose counts are not in the bag, or do not fit its messages, is taken for one that
    delivers at once what it does not lose, and named as a fault.
    """
    rows = counted_rows(raw, graph)
    found: dict[Link, Arrivals] = {}
    for link, topics in graph.counted_links.items():
        signal = signals.get(Role("received", link.receiver, link.sender), _NO_SIGNAL)
        stamps, values, delivered = signal.stamps, signal.values, signal.stamps
        received, counts = rows.get(topics.accel.name), rows.get(topics.complete.name)
        published = _published(counts, topics)
        if received is not None and received.delivered is not None:
            stamps = topics.accel.codec.stamps(received.messages)
            values = topics.accel.codec.values(received.messages)
            delivered = received.delivered
            if len(stamps) < published:
                what = f"lacks {published - len(stamps)} of {published} packets that were delivered"
                faults.append(Fault(topics.accel.name, what))
        elif counts is None:
            faults.append(Fault(topics.complete.name, f"is not in the bag: {_AT_ONCE}"))
        elif published:
            what = f"does not fit the messages that it counts: {_AT_ONCE}"
            faults.append(Fault(topics.complete.name, what))
        source, sample = ((at - grid.origin) // grid.step for at in (stamps, delivered))
        known = (source >= 0) & (sample < grid.samples) & np.isfinite(values)
        found[link] = Arrivals(source[known], sample[known], values[known])
    return found


def _published(counts: TopicRows | None, topics: LinkTopics) -> int:
    """Return how many messages a relay had published at the end, 0 where that is unknown."""
    if counts is None or not len(counts.messages):
        return 0
    last = topics.complete.codec.values(counts.messages)[-1]
    return int(last) if np.isfinite(last) else 0


def prompt_arrivals(received: Floats) -> Arrivals:
    """Return what arrived over a link that delivers every packet at once, (samples,)."""
    sample = np.flatnonzero(np.isfinite(received))
    return Arrivals(sample, sample, received[sample])
