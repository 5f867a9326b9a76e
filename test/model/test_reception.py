"""Reception: sample by sample and in arrays alike, whatever is lost, late or overtaken."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cacc_platoon.model import Delivery, HoldReception, ZeroReception

SAMPLES = 40


@st.composite
def deliveries(draw):
    """Packets of some samples, each with a delay of its own, some lost."""
    arrives = draw(st.lists(st.booleans(), min_size=SAMPLES, max_size=SAMPLES))
    delays = draw(st.lists(st.integers(0, 5), min_size=SAMPLES, max_size=SAMPLES))
    packets = [(k, k + d) for k, (kept, d) in enumerate(zip(arrives, delays, strict=True)) if kept]
    packets.sort(key=lambda packet: packet[1])
    source, sample = (np.array([p[i] for p in packets], np.int64) for i in (0, 1))
    return Delivery(source, sample, np.ones(len(packets)))


@pytest.mark.parametrize("kind", [HoldReception, ZeroReception, partial(ZeroReception, 4)])
@given(delivery=deliveries())
def test_arrays_choose_what_a_receiver_uses(kind, delivery):
    values = 1.0 + delivery.source
    chosen, receiver = kind().chosen(delivery, SAMPLES), kind()
    for k in range(SAMPLES):
        rows = delivery.sample == k
        packets = zip(delivery.source[rows].tolist(), values[rows].tolist(), strict=True)
        assert receiver.use(packets) == (values[chosen[k]] if chosen[k] >= 0 else 0.0)


@given(delivery=deliveries())
def test_what_is_held_is_the_newest_that_has_arrived(delivery):
    for k, row in enumerate(HoldReception().chosen(delivery, SAMPLES)):
        arrived = delivery.source[delivery.sample <= k]
        assert (delivery.source[row] if row >= 0 else -1) == max(arrived, default=-1)


@given(delivery=deliveries(), interval=st.integers(1, 9))
def test_zero_is_used_once_the_next_packet_is_due(delivery, interval):
    chosen = ZeroReception(interval).chosen(delivery, SAMPLES)
    held = HoldReception().chosen(delivery, SAMPLES)
    for k, (row, last) in enumerate(zip(chosen, held, strict=True)):
        fresh = last >= 0 and k - delivery.sample[last] < interval
        assert row == (last if fresh else -1)


def test_nothing_ever_arrives():
    nothing = Delivery(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))
    for kind in (HoldReception, ZeroReception):
        assert kind().chosen(nothing, 3).tolist() == [-1] * 3
