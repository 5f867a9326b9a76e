"""What arrived over links that may lose or delay packets, read from a bag."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cacc_platoon.bags.decode import Floats, Signal, rows_in_order_of_recording
from cacc_platoon.bags.raw import Integers
from cacc_platoon.bags.read import RawBag
from cacc_platoon.bags.rows import TopicRows
from cacc_platoon.model import Link
from cacc_platoon.runs.recording import samples_more, with_deliveries
from cacc_platoon.runs.sample_grid import Fault, Grid
from cacc_platoon.simulation import Arrivals
from msg_adapters.topics import Graph, LinkTopics, Role, Topic

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
        delivered = _delivered(signal, rows, topics, grid, faults)
        source, sample = ((at - grid.origin) // grid.step for at in (signal.stamps, delivered))
        known = (source >= 0) & (sample < grid.samples) & np.isfinite(signal.values)
        found[link] = Arrivals(source[known], sample[known], signal.values[known])
    return found


def _delivered(
    signal: Signal,
    rows: Mapping[str, TopicRows],
    topics: LinkTopics,
    grid: Grid,
    faults: list[Fault],
) -> Integers:
    """Return the stamps at which the messages of a link were delivered, and name what is wrong."""
    counts, received = rows.get(topics.complete.name), rows.get(topics.accel.name)

    def fault(topic: Topic, what: str) -> None:
        faults.append(Fault(topic.name, what))

    if counts is None:
        fault(topics.complete, f"is not in the bag: {_AT_ONCE}")
        return signal.stamps
    stamps = topics.complete.codec.stamps(counts.messages)
    last = topics.complete.codec.values(counts.messages)[-1]
    if received is None and not len(signal.stamps) and last == 0:
        return signal.stamps  # everything was lost
    known = None if received is None else received.delivered
    if known is None or (signal.stamps[len(known) :] <= stamps[-1]).any():
        fault(topics.complete, f"does not fit the messages that it counts: {_AT_ONCE}")
        return signal.stamps
    if len(known) < last:
        what = f"lacks {last - len(known):.0f} of {last:.0f} packets that were delivered"
        fault(topics.accel, what)
    more = samples_more(topics.complete, counts.messages[-1:])[0]
    end = (int(stamps[-1]) - grid.origin) // grid.step + int(more)
    if end < grid.samples - 1:
        fault(topics.complete, f"ends at {grid.say(end)}: from there on {_AT_ONCE}")
    return np.concatenate((known, signal.stamps[len(known) :]))


def prompt_arrivals(received: Floats) -> Arrivals:
    """Return what arrived over a link that delivers every packet at once, (samples,)."""
    sample = np.flatnonzero(np.isfinite(received))
    return Arrivals(sample, sample, received[sample])
