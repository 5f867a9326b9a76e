"""The n-bit channel: its lattice, its moments, its independence and its keyed, versioned stream."""

import hashlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cacc_platoon.model import (
    BitNoise,
    ConstantNoise,
    expected_factor,
    factor_variance,
)
from cacc_platoon.model.keyed_random import BLOCK, STREAM_VERSION
from cacc_platoon.scenario.v2v_parameters import PAPER_BITS

DRAWS = 400_000


def paper_noise(seed: int = 1, link: int = 1, hold: int = 1) -> BitNoise:
    return BitNoise(5.0, PAPER_BITS, seed, link, hold)


@pytest.fixture(scope="module")
def draws() -> np.ndarray:
    return paper_noise().factors(0, DRAWS)


def test_every_factor_lies_on_the_lattice(draws):
    # paper, section III-A: w = (1 - 1/rho) + (1/rho) sum_{j=0}^{15} z_j 2^-j, rho = 5
    code = (draws - 0.8) * 5.0 * 2.0**15
    np.testing.assert_allclose(code, np.rint(code), atol=1e-6)
    assert draws.min() >= 0.8
    assert draws.max() <= 1.199993896484375


@pytest.mark.parametrize(("chance", "factor"), [(1e-12, 0.8), (1.0 - 1e-12, 1.199993896484375)])
def test_the_ends_of_the_range_are_reached(chance, factor):
    factors = BitNoise(5.0, [chance] * 16, seed=1, link=1).factors(0, 1000)
    assert np.unique(factors).tolist() == pytest.approx([factor], rel=1e-15)


def test_mean_and_variance_of_theory():
    # exact values for rho 5 and the paper's 16 probabilities
    assert expected_factor(5.0, PAPER_BITS) == pytest.approx(1.048173687744, abs=1e-12)
    assert factor_variance(5.0, PAPER_BITS) == pytest.approx(0.009215195660, abs=1e-12)


def test_mean_and_variance_of_the_draws(draws):
    mean, variance = expected_factor(5.0, PAPER_BITS), factor_variance(5.0, PAPER_BITS)
    assert abs(draws.mean() - mean) < 4.0 * np.sqrt(variance / DRAWS)
    fourth = np.mean((draws - mean) ** 4)
    spread = np.mean((draws - mean) ** 2) - variance
    assert abs(spread) < 4.0 * np.sqrt((fourth - variance**2) / DRAWS)


def test_every_bit_has_its_own_probability_and_no_other_bits_value(draws):
    code = np.rint((draws - 0.8) * 5.0 * 2.0**15).astype(np.int64)
    bits = (code[:, np.newaxis] >> np.arange(15, -1, -1)) & 1
    chances = np.array(PAPER_BITS)
    errors = np.sqrt(chances * (1.0 - chances) / DRAWS)
    assert np.all(np.abs(bits.mean(axis=0) - chances) < 4.0 * errors)
    correlation = np.corrcoef(bits.T) - np.eye(16)
    assert np.abs(correlation).max() < 5.0 / np.sqrt(DRAWS)


def test_links_seeds_and_samples_are_independent(draws):
    others = [
        paper_noise(link=2).factors(0, DRAWS),
        paper_noise(seed=2).factors(0, DRAWS),
        paper_noise(seed=2, link=2).factors(0, DRAWS),
        np.roll(draws, 1),
        np.roll(draws, BLOCK),
    ]
    correlation = np.corrcoef([draws, *others]) - np.eye(6)
    assert np.abs(correlation).max() < 4.5 / np.sqrt(DRAWS)


@settings(max_examples=50)
@given(
    bounds=st.tuples(st.integers(0, 3 * BLOCK), st.integers(0, 3 * BLOCK)).map(sorted),
    hold=st.sampled_from([1, 2, 3, 7, 100]),
    link=st.integers(1, 500),
)
def test_any_slice_is_the_slice_of_the_whole(bounds, hold, link):
    start, stop = bounds
    channel = paper_noise(link=link, hold=hold)
    part = channel.factors(start, stop)
    assert part.shape == (stop - start,)
    assert part.tobytes() == channel.factors(0, 3 * BLOCK)[start:stop].tobytes()


@pytest.mark.parametrize("hold", [2, 5, 100])
def test_a_held_draw_is_the_draw_repeated(hold):
    held = paper_noise(hold=hold).factors(0, 1000 * hold)
    assert held.tobytes() == np.repeat(paper_noise().factors(0, 1000), hold).tobytes()


def test_an_empty_range_has_no_factors():
    assert paper_noise().factors(5, 5).size == 0
    assert paper_noise(hold=3).factors(BLOCK, BLOCK).size == 0


def test_the_stream_is_the_one_of_its_version():
    # Recorded when version 1 was made. Another value breaks every stored digest: should the
    # change be wanted, raise STREAM_VERSION and record the new sum.
    factors = BitNoise(5.0, PAPER_BITS, seed=1, link=2).factors(0, 3 * BLOCK)
    assert STREAM_VERSION == 1
    assert hashlib.sha256(factors.astype("<f8").tobytes()).hexdigest() == (
        "4b8fc549ed12848e866b7fecca817d97cf24d3d9d96913af20c50b3e96241d25"
    )


def test_bit_counts_from_one_to_the_largest():
    for bits in (1, 2, 17, 32):
        factors = BitNoise(2.0, [0.5] * bits, seed=3, link=1).factors(0, 20_000)
        assert np.min(factors) >= 0.5
        assert np.max(factors) <= 0.5 + 0.5 * (2.0 - 2.0 ** (1 - bits))
        mean, variance = expected_factor(2.0, [0.5] * bits), factor_variance(2.0, [0.5] * bits)
        assert abs(factors.mean() - mean) < 4.0 * np.sqrt(variance / factors.size)


def test_a_constant_channel_is_constant():
    assert ConstantNoise(1.25).factors(3, 6).tolist() == [1.25] * 3
