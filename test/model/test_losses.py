"""Losses in bursts and in blackouts: their law, and that any slice is that of the whole."""

import hashlib
from itertools import groupby

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cacc_platoon.model import Blackouts, BurstLoss, ComposedChannel, SendTimes
from cacc_platoon.model.keyed_random import BLOCK

N = 1_000_000
PROBABILITIES = st.sampled_from([(0.3, 0.3), (0.001, 0.002), (0.9, 0.8), (0.5, 0.5), (1.0, 1.0)])


def bursts(begin=0.3, end=0.3, good=0.0, bad=0.95, *, seed=1, link=1):
    return BurstLoss(begin, end, good, bad, seed=seed, link=link)


@settings(max_examples=60)
@given(PROBABILITIES, st.integers(0, 4 * BLOCK), st.integers(1, BLOCK))
def test_a_slice_is_that_of_the_whole(probabilities, start, length):
    one = bursts(*probabilities)
    whole = one.is_bad(0, 5 * BLOCK + 1)
    np.testing.assert_array_equal(one.is_bad(start, start + length), whole[start : start + length])


@pytest.mark.slow
@pytest.mark.parametrize(("begin", "end"), [(0.3, 0.3), (0.02, 0.2), (0.8, 0.7)])
def test_good_and_bad_times_are_a_markov_chain(begin, end):
    bad = bursts(begin, end).is_bad(0, N)
    for now, probability in ((False, begin), (True, 1.0 - end)):
        after = bad[1:][bad[:-1] == now]
        spread = np.sqrt(probability * (1.0 - probability) / len(after))
        assert abs(after.mean() - probability) < 4.0 * spread
    lasting = np.array([len(list(run)) for is_bad, run in groupby(bad) if is_bad])[1:-1]
    spread = np.sqrt((1.0 - end) / end**2 / len(lasting))
    assert abs(lasting.mean() - 1.0 / end) < 4.0 * spread + 1e-12
    longer = (lasting > 1).mean()
    assert abs(longer - (1.0 - end)) < 4.0 * np.sqrt(end * (1.0 - end) / len(lasting))


@pytest.mark.parametrize(("good", "bad"), [(0.0, 0.95), (0.05, 0.6)])
def test_losses_have_the_share_and_the_variance_that_are_said(good, bad):
    one = bursts(0.1, 0.2, good, bad)
    kept = ComposedChannel([one]).delivery(0, N).source
    lost = np.ones(N)
    lost[kept] = 0.0
    assert abs(lost.mean() - one.mean_loss) < 4.0 * np.sqrt(one.loss_variance / N)
    sums = lost.reshape(-1, 400).sum(axis=1)
    assert np.var(sums) / 400.0 == pytest.approx(one.loss_variance, rel=0.2)


def test_it_begins_in_its_stationary_law():
    first = [bursts(0.01, 0.03, link=link).is_bad(0, 1)[0] for link in range(1, 2001)]
    assert abs(np.mean(first) - 0.25) < 4.0 * np.sqrt(0.25 * 0.75 / 2000)


def test_links_and_seeds_are_independent():
    one = bursts().is_bad(0, N)
    for other in (bursts(link=2).is_bad(0, N), bursts(seed=2).is_bad(0, N)):
        assert abs((one & other).mean() - 0.25) < 0.006


def test_the_stream_is_recorded():
    """A change of an existing stream is a new STREAM_VERSION: recorded runs would differ."""
    bad = bursts().is_bad(0, 10_000)
    assert hashlib.sha256(bad.tobytes()).hexdigest()[:16] == "4f9a51f57d91c855"


def test_packets_are_counted_as_they_are_sent():
    often = ComposedChannel([bursts()]).delivery(0, 500).source
    rarely = ComposedChannel([bursts()], SendTimes(10, 3)).delivery(0, 5000).source
    np.testing.assert_array_equal(rarely, 10 * often + 3)


def test_nothing_comes_in_a_blackout_whenever_it_would_arrive():
    dark = Blackouts([(100, 200), (300, 301)])
    sent = ComposedChannel([dark], SendTimes(7)).delivery(0, 500).source
    expected = [k for k in range(0, 500, 7) if not (100 <= k < 200 or k == 300)]
    assert sent.tolist() == expected
