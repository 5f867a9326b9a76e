"""Noise drawn once: every atom of the channel's law, one by one, and whole platoons of draws."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cacc_platoon.model import Gains
from cacc_platoon.model.noise import BitNoise
from cacc_platoon.scenario.v2v_parameters import V2V
from cacc_platoon.theory import DesignError, is_string_stable
from cacc_platoon.theory.chance_constrained import (
    amplifying_probability,
    chance_constrained_headway,
    factor_below,
)

A = Gains(0.95, 0.5, 0.63, 0.009)
BITS = V2V().bit_probabilities


def law(rho, chances):
    """Every factor that the channel may draw, and its probability."""
    values, weights = np.zeros(1), np.ones(1)
    for j, chance in enumerate(chances):
        values = np.concatenate((values, values + 0.5**j))
        weights = np.concatenate((weights * (1 - chance), weights * chance))
    return 1 - 1 / rho + values / rho, weights


@pytest.mark.parametrize(
    ("rho", "probability", "headway"),
    [
        (3.0, 1e-2, 1.033),
        (3.0, 1e-3, 1.0495),
        (3.0, 0.0, 1.1542),
        (5.0, 1e-2, 0.9355),
        (5.0, 0.0, 0.9460),
    ],
)
def test_headways_of_case_a(rho, probability, headway):
    found = chance_constrained_headway(A, rho, 0.5, BITS, probability)
    assert found == pytest.approx(headway, abs=1.5e-4)
    for share, enough in ((1.0 + 1e-6, True), (1.0 - 1e-6, False)):
        gains = A._replace(time_headway=found * share)
        assert (amplifying_probability(gains, rho, 0.5, BITS) <= probability) is enough


def test_probability_is_the_sum_over_all_atoms():
    """65536 of them, each asked the exact test."""
    gains = A._replace(time_headway=0.95)
    values, weights = law(3.0, BITS)
    h, _, k_v, k_p = gains
    k, load = 0.5 * values, k_v + h * k_p
    C = load**2 - 2 * k_p - k_v**2 + 2 * k * k_p
    stable = (C >= 0) & (1 - k**2 - load + np.sqrt(np.maximum(C, 0.0)) >= 0)
    expected = weights[~stable].sum()
    assert 0.09 < expected < 0.1
    assert amplifying_probability(gains, 3.0, 0.5, BITS) == pytest.approx(expected, rel=1e-9)
    several = amplifying_probability(gains, 3.0, 0.5, BITS, links=12)
    assert several == pytest.approx(1 - (1 - expected) ** 12, rel=1e-9)


def test_draws_of_the_channel_amplify_as_often():
    draws = np.concatenate([BitNoise(3.0, BITS, 7, link).factors(0, 400) for link in range(10)])
    seen = np.mean([not is_string_stable(A, 0.5, 0.5 * w) for w in draws])
    assert seen == pytest.approx(amplifying_probability(A, 3.0, 0.5, BITS), abs=0.02)


@given(
    st.lists(st.floats(0.0, 1.0), min_size=1, max_size=9),
    st.floats(1.1, 50.0),
    st.floats(-1.2, 1.2),
)
def test_factor_below_against_the_whole_law(chances, rho, place):
    values, weights = law(rho, chances)
    for limit in (1 + place / rho, *values[:: max(len(values) // 3, 1)]):
        expected = weights[values < limit - 1e-13].sum()
        assert factor_below(rho, chances, float(limit)) == pytest.approx(expected, abs=1e-12)


def test_ends():
    assert factor_below(math.inf, BITS, 1.0) == 0.0
    assert factor_below(math.inf, BITS, 1.001) == 1.0
    silent = Gains(1.1, 0.0, 0.9, 0.1)
    assert amplifying_probability(silent, 5.0, 0.5, BITS) == 0.0
    assert amplifying_probability(silent._replace(time_headway=0.4), 5.0, 0.5, BITS) == 1.0


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"probability": 1.0}, "probability = 1 is not from 0 to below 1"),
        ({"probability": -0.1}, "probability = -0.1"),
        ({"probability": 0.1, "links": 0}, "links = 0"),
        ({"probability": 0.0, "gains": A._replace(k_a=0.95)}, "Lower k_a or raise rho"),
        ({"probability": 0.1, "bits": ()}, "1 to 32 probabilities"),
        ({"probability": 0.1, "rho": 1.0}, "rho = 1"),
    ],
)
def test_what_has_no_answer(wrong, words):
    asked = {"gains": A, "rho": 5.0, "bits": BITS, **wrong}
    gains, rho, bits = asked.pop("gains"), asked.pop("rho"), asked.pop("bits")
    with pytest.raises(DesignError, match=words):
        chance_constrained_headway(gains, rho, 0.5, bits, **asked)
