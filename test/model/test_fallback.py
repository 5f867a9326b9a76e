"""Falling back and coming back: states, blends without a jump, gains that need no V2V."""

import numpy as np
import pytest

from cacc_platoon.model import FallbackReception, ReceptionState
from cacc_platoon.model.fallback import gains_without_v2v


def run(reception, arrives):
    found = []
    for k, comes in enumerate(arrives):
        used = reception.use([(k, float(k))] if comes else [])
        found.append((used, reception.share, reception.state))
    return found


def test_states_follow_each_other():
    arrives = [1] * 5 + [0] * 12 + [1] * 12
    states = [state.name for *_, state in run(FallbackReception(4, 5, 3), arrives)]
    assert states == (
        ["NORMAL"] * 8 + ["DEGRADING"] * 4 + ["FALLBACK"] * 7 + ["RECOVERING"] * 4 + ["NORMAL"] * 6
    )


def test_a_silence_while_it_comes_back_turns_it_round():
    arrives = [1, 0, 0, 0, 0, 0, 1, 1, 1, 0, 0, 0, 0]
    shares = [share for _, share, _ in run(FallbackReception(2, 4, 1), arrives)]
    assert shares == [1.0, 1.0, 0.75, 0.5, 0.25, 0.0, 0.25, 0.5, 0.75, 1.0, 0.75, 0.5, 0.25]


def test_single_packets_in_a_silence_do_not_bring_it_back():
    arrives = [1] + ([0] * 9 + [1]) * 5
    states = [state for *_, state in run(FallbackReception(5, 4, 10), arrives)]
    assert ReceptionState.RECOVERING not in states
    assert states[-1] is ReceptionState.FALLBACK


def test_no_packet_ever():
    found = run(FallbackReception(3, 2, 1), [0] * 10)
    assert [share for _, share, _ in found] == [1.0, 1.0, 0.5] + [0.0] * 7
    assert all(used == 0.0 for used, *_ in found)


def test_on_random_silences_the_share_never_jumps_and_the_newest_counts():
    rng = np.random.default_rng(1)
    for _ in range(200):
        patience, blend, trust = rng.integers(1, 30, 3).tolist()
        arrives = np.repeat(rng.random(60) < 0.5, rng.integers(1, 40, 60))
        found = run(FallbackReception(patience, blend, trust), arrives)
        shares = np.array([share for _, share, _ in found])
        assert np.abs(np.diff(shares)).max() <= 1.0 / blend + 1e-12
        newest = np.maximum.accumulate(np.where(arrives, np.arange(len(arrives)), 0))
        assert [used for used, *_ in found] == newest.tolist()
        for (_, share, state), (_, _, before) in zip(found[1:], found, strict=False):
            assert (state is ReceptionState.NORMAL) == (share == 1.0)
            assert (state is ReceptionState.FALLBACK) == (share == 0.0)
            assert (int(before), int(state)) not in {(0, 3), (2, 1), (2, 0)} or blend == 1


@pytest.mark.parametrize("tau_max", [0.05, 0.5, 2.0])
def test_gains_without_v2v_are_on_the_edge_of_the_lag(tau_max):
    h, k_a, k_v, k_p = gains_without_v2v(tau_max, 2.2 * tau_max)
    assert (h, k_a) == (2.2 * tau_max, 0.0)
    assert k_v + k_p * h == pytest.approx(1.0 / (2.0 * tau_max))
    assert 2.0 * k_v * h + k_p * h**2 > 2.0  # C > 0 of the exact test
