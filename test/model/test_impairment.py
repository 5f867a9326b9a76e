"""Impairments: slices equal the whole, losses have their probability, late packets their delay."""

import hashlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cacc_platoon.model import (
    BitNoise,
    ComposedChannel,
    ConstantLatency,
    ConstantNoise,
    ContentNoise,
    IndependentLoss,
    SendTimes,
)
from cacc_platoon.model.channel import packets_by_sample
from cacc_platoon.model.keyed_random import BLOCK, keyed_uniform
from cacc_platoon.model.packets import EVERY_SAMPLE, Packet

N = 200_000


class AlternatingDelay:
    """Delays packet p by 0, 1, ..., longest samples in turn, so that packets overtake others."""

    prompt = False

    def __init__(self, longest_delay):
        self.longest_delay = longest_delay

    def apply(self, packets):
        delay = (packets.number * 7) % (self.longest_delay + 1)
        return packets._replace(delay=packets.delay + delay)


def channel(loss=0.3, delay=4, link=2, times=EVERY_SAMPLE):
    noise = ContentNoise(BitNoise(5.0, [0.5] * 16, seed=3, link=link))
    loses = IndependentLoss(loss, 3, link)
    return ComposedChannel([noise, loses, AlternatingDelay(delay), ConstantLatency(3)], times)


@settings(max_examples=40)
@given(st.integers(0, 3 * BLOCK), st.integers(1, 2 * BLOCK), st.sampled_from([(1, 0), (7, 5)]))
def test_a_slice_is_that_of_the_whole(start, length, times):
    one = channel(times=SendTimes(*times))
    whole, part = one.delivery(0, 5 * BLOCK), one.delivery(start, start + length)
    rows = (whole.sample >= start) & (whole.sample < start + length)
    for all_of_it, some in zip(whole[:3], part[:3], strict=True):
        np.testing.assert_array_equal(all_of_it[rows], some)


def test_a_perfect_channel_delivers_every_sample_at_once():
    delivery = ComposedChannel([ContentNoise(ConstantNoise(1.25))]).delivery(3, 6)
    assert [part.tolist() for part in delivery[:3]] == [[3, 4, 5], [3, 4, 5], [1.25] * 3]


def test_losses_have_their_probability_and_no_memory():
    p = 0.3
    delivery = ComposedChannel([IndependentLoss(p, seed=1, link=1)]).delivery(0, N)
    arrived = np.zeros(N, bool)
    arrived[delivery.source] = True
    spread = np.sqrt(p * (1 - p) / N)
    assert abs((1 - arrived.mean()) - p) < 4 * spread
    both = (~arrived[1:] & ~arrived[:-1]).mean()
    assert abs(both - p * p) < 4 * np.sqrt(p * p * (1 - p * p) / N) * 1.5


@pytest.mark.parametrize(("interval", "phase"), [(1, 0), (10, 0), (10, 9), (7, 3)])
def test_packets_are_sent_at_their_times_and_numbered(interval, phase):
    times = SendTimes(interval, phase)
    every = np.arange(0, 500)
    sent = every[every % interval == phase]
    np.testing.assert_array_equal(times.between(0, 500), sent)
    np.testing.assert_array_equal(times.between(123, 321), sent[(sent >= 123) & (sent < 321)])
    np.testing.assert_array_equal(times.number(sent), np.arange(len(sent)))
    kept = ComposedChannel([IndependentLoss(0.3, 1, 1)], times).delivery(0, 500).source
    numbers = ComposedChannel([IndependentLoss(0.3, 1, 1)]).delivery(0, len(sent)).source
    np.testing.assert_array_equal(times.number(kept), numbers)


@pytest.mark.parametrize(("loss", "arrive"), [(0.0, N), (1.0, 0)])
def test_the_ends_of_the_probability(loss, arrive):
    assert len(ComposedChannel([IndependentLoss(loss, 1, 1)]).delivery(0, N).source) == arrive


def test_links_and_purposes_are_independent():
    def lost(link, seed=1):
        kept = ComposedChannel([IndependentLoss(0.5, seed, link)]).delivery(0, N).source
        return np.isin(np.arange(N), kept, invert=True)

    for other in (lost(2), lost(1, seed=2)):
        assert abs((lost(1) & other).mean() - 0.25) < 4 * np.sqrt(0.25 * 0.75 / N)
    noise = BitNoise(5.0, [0.5], seed=1, link=1).factors(0, N) > 0.9
    assert abs((lost(1) & noise).mean() - 0.25) < 4 * np.sqrt(0.25 * 0.75 / N)


def test_the_stream_of_losses_is_recorded():
    """A change of an existing stream is a new STREAM_VERSION: recorded runs would differ."""
    draws = keyed_uniform(1, 1, 1)(0, 10_000)
    assert 0.0 <= np.min(draws) < 1e-3
    assert 1.0 - 1e-3 < np.max(draws) < 1.0
    assert hashlib.sha256(draws.tobytes()).hexdigest()[:16] == "f99e0a3816fb4162"


def test_late_packets_arrive_in_the_order_of_their_delivery():
    delivery = channel(loss=0.0).delivery(0, 50)
    assert (np.diff(delivery.sample) >= 0).all()
    assert ((delivery.sample - delivery.source) == (delivery.source * 7) % 5 + 3).all()
    assert (np.diff(delivery.source) < 0).any()


@pytest.mark.parametrize("samples", [1, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 5])
def test_sample_by_sample_is_the_whole(samples):
    whole = channel().delivery(0, samples)
    due: list[list[Packet]] = [[] for _ in range(samples)]
    for sample, packet in zip(whole.sample, whole.packets(), strict=True):
        due[sample].append(packet)
    assert list(packets_by_sample(channel(), samples)) == due


@pytest.mark.parametrize("hold", [1, 3])
def test_a_stream_of_several_blocks_is_the_channels(hold):
    length = 2 * BLOCK + BLOCK // 2
    noise = BitNoise(5.0, [0.5] * 16, seed=1, link=1, hold=hold)
    packets = list(packets_by_sample(ComposedChannel([ContentNoise(noise)]), length))
    factors = noise.factors(0, length).tolist()
    assert packets == [[Packet(k, k, 0.0, w)] for k, w in enumerate(factors)]
    assert len({str(packets[k : k + 100]) for k in (0, BLOCK, 2 * BLOCK)}) == 3
