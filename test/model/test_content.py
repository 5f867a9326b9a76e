"""What packets say: errors, rounding and false data, one by one and in slices."""

import hashlib
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cacc_platoon.model import (
    AdditiveNoise,
    BitNoise,
    ComposedChannel,
    ContentNoise,
    FalseData,
    Forgery,
    Impairment,
    Lattice,
    SendTimes,
)
from cacc_platoon.model.channel import packets_by_sample
from cacc_platoon.model.keyed_random import BLOCK, ERROR, LARGEST_NORMAL, keyed_normal

N = 1_000_000
FALSE = [
    Forgery(100, 200, factor=-2.0),
    Forgery(300, 450, older=120),
    Forgery(500, 700, frozen=True),
]
RARE = SendTimes(7, 3)


def channel(times=RARE):
    parts: list[Impairment] = [
        ContentNoise(BitNoise(5.0, [0.5] * 16, seed=3, link=2)),
        AdditiveNoise(0.1, -0.05, seed=3, link=2),
        FalseData(FALSE),
    ]
    return ComposedChannel(parts, times, Lattice(0.1, 1.0))


@settings(max_examples=40)
@given(st.integers(0, 3 * BLOCK), st.integers(1, 2 * BLOCK), st.sampled_from([(1, 0), (7, 5)]))
def test_a_slice_is_that_of_the_whole(start, length, times):
    one, sent = channel(SendTimes(*times)), np.sin(np.arange(5 * BLOCK))
    whole, part = one.delivery(0, 5 * BLOCK), one.delivery(start, start + length)
    rows = (whole.sample >= start) & (whole.sample < start + length)
    np.testing.assert_array_equal(whole.values(sent)[rows], part.values(sent))
    np.testing.assert_array_equal(whole.carried[rows], part.carried)


def test_one_by_one_they_say_what_they_say_in_arrays():
    sent = np.sin(np.arange(2000) / 50.0)
    whole = channel().delivery(0, 2000)
    one_by_one = [
        packet.value(float(sent[packet.content]))
        for now in packets_by_sample(channel(), 2000)
        for packet in now
    ]
    assert one_by_one == whole.values(sent).tolist()


def test_errors_are_normal_up_to_their_tails():
    drawn = keyed_normal(1, 1, ERROR)(0, N)
    assert abs(drawn.mean()) < 4.0 / math.sqrt(N)
    assert abs(drawn.var() - 1.0) < 4.0 * math.sqrt(2.0 / N)
    assert np.abs(drawn).max() < LARGEST_NORMAL
    for limit in (-2.0, -1.0, 0.0, 0.5, 1.5, 2.5):
        normal = 0.5 * math.erfc(-limit / math.sqrt(2.0))
        assert abs((drawn < limit).mean() - normal) < 0.003
    other = keyed_normal(1, 2, ERROR)(0, N)
    assert abs(np.corrcoef(drawn, other)[0, 1]) < 4.0 / math.sqrt(N)
    assert abs(np.corrcoef(drawn[:-1], drawn[1:])[0, 1]) < 4.0 / math.sqrt(N)


def test_the_stream_of_errors_is_recorded():
    draws = keyed_normal(1, 1, ERROR)(0, 10_000)
    assert hashlib.sha256(draws.tobytes()).hexdigest()[:16] == "389aa52d6c428887"


def test_bias_and_noise_are_added_to_what_is_sent():
    one = ComposedChannel([AdditiveNoise(0.2, 0.5, seed=1, link=1)]).delivery(0, N)
    said = one.values(np.ones(N))
    assert abs(said.mean() - 1.5) < 4.0 * 0.2 / math.sqrt(N)
    assert abs(said.std() - 0.2) < 4.0 * 0.2 / math.sqrt(2.0 * N)


def test_a_lattice_holds_what_can_be_said():
    sent = np.linspace(-20.0, 20.0, 100_001)
    said = Lattice(0.1, 16.0).nearest(sent)
    inside = np.abs(sent) <= 16.0
    assert np.abs(said - sent)[inside].max() <= 0.05 + 1e-12
    np.testing.assert_allclose(said / 0.1, np.rint(said / 0.1), atol=1e-9)
    assert np.abs(said).max() == 16.0
    assert not np.signbit(said[said == 0.0]).any()
    np.testing.assert_array_equal(Lattice(0.0, 3.0).nearest(sent), np.clip(sent, -3.0, 3.0))


def test_false_data_carry_what_they_should():
    sent = np.arange(1000.0)
    said = ComposedChannel([FalseData(FALSE)]).delivery(0, 1000).values(sent)
    np.testing.assert_array_equal(said[100:200], -2.0 * sent[100:200])
    np.testing.assert_array_equal(said[300:450], sent[180:330])
    np.testing.assert_array_equal(said[500:700], np.full(200, 500.0))
    true = np.r_[0:100, 200:300, 450:500, 700:1000]
    np.testing.assert_array_equal(said[true], sent[true])


@pytest.mark.parametrize("older", [5, 50])
def test_what_was_before_the_run_is_its_first_sample(older):
    one = ComposedChannel([FalseData([Forgery(0, 20, older=older)])]).delivery(0, 20)
    np.testing.assert_array_equal(one.carried, np.maximum(np.arange(20) - older, 0))
