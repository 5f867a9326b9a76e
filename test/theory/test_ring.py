"""Rings of vehicles against the roots of every motion of every ring."""

import math
import random

import numpy as np
import pytest

from cacc_platoon.model import Gains
from cacc_platoon.theory import (
    DesignError,
    certify,
    first_unstable_ring,
    frequency_response,
    is_internally_stable,
    is_string_stable,
    unstable_turns,
)

MOST = 120
B = Gains(0.65, 0.5, 0.63, 0.009)


def growth(gains, tau, k, turns):
    """Largest real part of the roots of ``D(s) = exp(j turn) N(s)`` per turn, by companions."""
    h, _, k_v, k_p = gains
    e = np.exp(1j * np.asarray(turns))
    companion = np.zeros((e.size, 3, 3), dtype=complex)
    companion[:, 0] = -np.stack((1 - k * e, k_v + h * k_p - k_v * e, k_p * (1 - e)), -1) / tau
    companion[:, 1, 0] = companion[:, 2, 1] = 1.0
    return np.linalg.eigvals(companion).real.max(axis=1)


def unstable_rings(gains, tau, k, most=MOST):
    """Every number of vehicles up to `most` whose ring has a growing motion."""
    pairs = [(n, m) for n in range(2, most + 1) for m in range(1, n // 2 + 1)]
    number, part = np.array(pairs).T
    unstable = growth(gains, tau, k, 2 * math.pi * part / number) > 1e-9
    return sorted(set(number[unstable].tolist()))


def designs(count, seed):
    draw = random.Random(seed)
    while count:
        gains = Gains(
            draw.uniform(0.1, 2), 0.0, 10 ** draw.uniform(-2, 0.7), 10 ** draw.uniform(-3, 1)
        )
        tau, k = draw.uniform(0.05, 1.0), draw.uniform(0.0, 1.0)
        if is_internally_stable(gains, tau):
            count -= 1
            yield gains, tau, k


@pytest.mark.slow
def test_the_first_unstable_ring_is_that_of_brute_force():
    kinds = set()
    for gains, tau, k in designs(60, seed=3):
        brute = unstable_rings(gains, tau, k)
        first = first_unstable_ring(gains, tau, k)
        assert (first if first is not None and first <= MOST else None) == next(iter(brute), None)
        turns = unstable_turns(gains, tau, k)
        assert (turns is None) == is_string_stable(gains, tau, k)
        if turns is not None:
            kinds.add(turns[0] > 0)
    assert kinds == {False, True}


def test_turns_are_where_the_hop_has_gain_one_and_growth_begins():
    found = 0
    for gains, tau, k in designs(60, seed=4):
        turns = unstable_turns(gains, tau, k)
        if turns is None:
            continue
        low, high = turns
        found += low > 0
        step = 1e-3 * (high - low)
        inside = np.array([max(low, 0.0) + step, 0.5 * (low + high), high - step])
        assert (growth(gains, tau, k, inside) > 0).all()
        if high < math.pi:  # else it meets its mirror image
            outside = [high + step, *([low - step] if low > 0 else [])]
            assert (growth(gains, tau, k, outside) < 0).all()
        omega = np.geomspace(1e-4, 30, 20001)
        H = frequency_response(gains, tau, k, omega)
        amplified = -np.unwrap(np.angle(H))[np.abs(H) > 1]
        assert amplified.max() == pytest.approx(high, abs=5e-3)
    assert found > 5


def test_case_b_is_unstable_from_75_vehicles_on_and_a_and_e_with_none():
    k = 0.524086844
    assert first_unstable_ring(B, 0.5, k) == 75
    assert unstable_rings(B, 0.5, k) == list(range(75, MOST + 1))
    for stable in (Gains(0.95, 0.5, 0.63, 0.009), Gains(0.75, 0.5, 0.8, 0.5)):
        assert first_unstable_ring(stable, 0.5, k) is None
        assert unstable_rings(stable, 0.5, k) == []


def test_larger_rings_may_be_stable_again():
    """A band of turns from 0.3649 to 0.5940 rad: 11 is in it as 1/11, 18 to 21 are not, 22 is."""
    gains = Gains(1.0, 0.0, 0.9, 2.5)
    low, high = unstable_turns(gains, 0.5, 0.9) or (0.0, 0.0)
    inside = [
        n
        for n in range(2, MOST + 1)
        if any(low < 2 * math.pi * m / n < high for m in range(1, n // 2 + 1))
    ]
    assert unstable_rings(gains, 0.5, 0.9) == inside
    assert inside[:8] == [11, 12, 13, 14, 15, 16, 17, 22]
    assert first_unstable_ring(gains, 0.5, 0.9) == 11


def test_either_end_of_the_interval_may_decide():
    """B is unstable at m k_a = 0.4 alone; the other design at M k_a = 0.6 alone."""
    assert certify(B, 5.0, 0.5).first_unstable_ring == 52 == unstable_rings(B, 0.5, 0.4)[0]
    assert first_unstable_ring(B, 0.5, 0.6) is None
    fast = Gains(0.95, 0.5, 0.9, 0.1)
    high = certify(fast, 5.0, 0.5, k_effective=0.6).first_unstable_ring
    assert first_unstable_ring(fast, 0.5, 0.4) is None
    assert certify(fast, 5.0, 0.5).first_unstable_ring == high == unstable_rings(fast, 0.5, 0.6)[0]


def test_a_vehicle_that_follows_itself_is_unstable_above_one():
    """``D - N = s (tau s^2 + (1 - k) s + h_w k_p)``."""
    assert first_unstable_ring(Gains(0.95, 0.5, 0.63, 0.009), 0.5, 1.1) == 1


@pytest.mark.parametrize(
    ("gains", "tau", "k", "words"),
    [
        (Gains(0.2, 0.5, 0.01, 5.0), 0.5, 0.5, "do not keep one vehicle stable"),
        (B, 0.0, 0.5, "tau = 0"),
        (B, 0.5, -0.1, "k_effective = -0.1 is outside 0 to 1"),
        (B, 0.5, math.nan, "k_effective = nan"),
    ],
)
def test_what_has_no_ring_is_refused(gains, tau, k, words):
    with pytest.raises(DesignError, match=words):
        first_unstable_ring(gains, tau, k)
