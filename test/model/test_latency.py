"""Packets that take different times: the law of their delays, order, and slices."""

import hashlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from cacc_platoon.model import ComposedChannel, IndependentLoss, InOrder, RandomLatency, SendTimes
from cacc_platoon.model.keyed_random import BLOCK
from cacc_platoon.model.latency import gamma_delay, uniform_delay

N, STEP = 1_000_000, 0.01
LAWS = {
    "uniform": (uniform_delay(0.013, 0.05, STEP), stats.uniform(0.013, 0.05)),
    "gamma": (gamma_delay(0.013, 0.03, 3, STEP), stats.gamma(3, 0.013, 0.01)),
    "exponential": (gamma_delay(0.0, 0.02, 1, STEP), stats.gamma(1, 0.0, 0.02)),
}


def late(law="gamma", seed=1, link=1):
    return RandomLatency(LAWS[law][0], seed, link)


@pytest.mark.parametrize("law", LAWS)
def test_delays_have_their_law(law):
    chances, continuous = LAWS[law]
    assert sum(chances) == pytest.approx(1.0, abs=1e-12)
    steps = np.arange(len(chances) - 1)
    np.testing.assert_allclose(np.cumsum(chances)[:-1], continuous.cdf(steps * STEP), atol=1e-12)
    delivery = ComposedChannel([late(law)]).delivery(0, N)
    known = delivery.source < N - len(chances)
    delay = (delivery.sample - delivery.source)[known]
    assert len(delay) == N - len(chances)
    for samples, chance in enumerate(chances):
        spread = np.sqrt(chance * (1.0 - chance) / len(delay))
        assert abs((delay == samples).mean() - chance) < 4.0 * spread + 1e-9
    assert abs(delay.mean() - late(law).mean_delay) < 4.0 * delay.std() / np.sqrt(len(delay))


def test_delays_of_packets_links_and_seeds_are_independent():
    def delays(**of):
        delivery = ComposedChannel([late(**of)]).delivery(0, 200_000)
        found = np.zeros(200_000)
        found[delivery.source] = delivery.sample - delivery.source
        return found[:-50]

    one = delays()
    for other in (delays(seed=2), delays(link=2), np.roll(one, 1)):
        assert abs(np.corrcoef(one, other)[0, 1]) < 4.0 / np.sqrt(len(one))


@settings(max_examples=40)
@given(
    st.integers(0, 3 * BLOCK),
    st.integers(1, 2 * BLOCK),
    st.sampled_from([(1, 0), (7, 5)]),
    st.booleans(),
)
def test_a_slice_is_that_of_the_whole(start, length, times, in_order):
    parts = [IndependentLoss(0.3, 1, 1), late()]
    if in_order:
        parts.append(InOrder(late().longest_delay))
    one = ComposedChannel(parts, SendTimes(*times))
    whole, part = one.delivery(0, 5 * BLOCK), one.delivery(start, start + length)
    rows = (whole.sample >= start) & (whole.sample < start + length)
    np.testing.assert_array_equal(whole.source[rows], part.source)
    np.testing.assert_array_equal(whole.sample[rows], part.sample)


def test_in_order_nobody_overtakes_and_nobody_waits_in_vain():
    loss = IndependentLoss(0.3, 1, 1)
    free = ComposedChannel([loss, late()]).delivery(0, 50_000)
    assert (np.diff(free.source) < 0).any()
    queue = ComposedChannel([loss, late(), InOrder(late().longest_delay)]).delivery(0, 50_000)
    assert (np.diff(queue.source) > 0).all()
    at = dict(zip(free.source.tolist(), free.sample.tolist(), strict=True))
    for source, sample in zip(queue.source[:2000].tolist(), queue.sample.tolist(), strict=False):
        assert sample == max(at.get(earlier, -1) for earlier in range(source + 1))


def test_the_stream_of_delays_is_recorded():
    delivery = ComposedChannel([late()]).delivery(0, 10_000)
    assert hashlib.sha256(delivery.source.tobytes()).hexdigest()[:16] == "7c913750571860ec"
