"""When Cooperative Awareness Messages are sent, against the standard's words, worked out."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cacc_platoon.model import (
    CamRule,
    ComposedChannel,
    ConstantLatency,
    IndependentLoss,
    RandomLatency,
    TriggeredChannel,
)
from cacc_platoon.model.leader import SinePulse


def sent(rule, motion):
    return [k for k, state in enumerate(motion) if rule.sends(k, *state)]


def driving(speed, samples, step=0.01):
    return [(speed * step * k, speed) for k in range(samples)]


@pytest.mark.parametrize(
    ("speed", "check", "apart"),
    [(25.0, 10, 20), (25.0, 1, 17), (50.0, 10, 10), (35.0, 1, 12), (3.0, 10, 100), (0.0, 1, 100)],
)
def test_at_constant_speed(speed, check, apart):
    """4 m are passed at 25 m/s after 160 ms; more than 4 m at the first check after that."""
    assert sent(CamRule(0.01, check), driving(speed, 401)) == list(range(0, 401, apart))


def test_the_first_is_sent_at_the_first_check():
    assert sent(CamRule(0.01, 10, phase=7), driving(0.0, 120)) == [7, 107]


def test_never_sooner_than_after_a_tenth_of_a_second():
    wild = [(100.0 * k, 50.0 * k) for k in range(100)]
    assert sent(CamRule(0.01, 1), wild) == list(range(0, 100, 10))


def test_a_change_of_speed_sends():
    """0.5 m/s are not enough, more are; then three messages keep the shorter time."""
    step = [(0.0, 0.0)] * 130 + [(0.0, 0.5)] * 5 + [(0.0, 0.51)] * 500
    found = sent(CamRule(0.01, 1), step)
    assert found[:3] == [0, 100, 135]
    assert np.diff(found[2:]).tolist() == [35, 35, 35, 100, 100, 100]


def test_times_of_a_sine_are_between_a_tenth_and_a_second():
    profile = SinePulse(8.0, 2.0, 0.5, 1.0)
    motion = [profile.at(0.01 * k)[:2] for k in range(4000)]
    apart = np.diff(sent(CamRule(0.01, 10), motion))
    assert apart.min() >= 10
    assert apart.max() <= 100
    assert len(set(apart.tolist())) > 3


def test_what_happens_to_messages_goes_by_their_number_and_time():
    late = TriggeredChannel(CamRule(0.01, 10), ComposedChannel([ConstantLatency(3)]))
    arrived = {
        k: [packet.source for packet in packets]
        for k, state in enumerate(driving(25.0, 60))
        if (packets := late.deliver(k, *state))
    }
    assert arrived == {3: [0], 23: [20], 43: [40]}


@settings(deadline=None, max_examples=60)
@given(
    longest=st.integers(0, 80),
    loss=st.sampled_from([0.0, 0.3, 0.9]),
    seed=st.integers(0, 2**32),
    speed=st.sampled_from([0.0, 25.0, 50.0]),
)
def test_in_order_nobody_overtakes_and_nobody_waits_in_vain(longest, loss, seed, speed):
    """Each arrives at its own time or with the last of those before it, under any rule to send."""

    def arrived(in_order):
        chances = [1.0 / (longest + 1)] * (longest + 1)
        link = ComposedChannel([IndependentLoss(loss, seed, 1), RandomLatency(chances, seed, 1)])
        channel = TriggeredChannel(CamRule(0.01, 10), link, in_order=in_order)
        return [
            (packet.source, k)
            for k, state in enumerate(driving(speed, 1000))
            for packet in channel.deliver(k, *state)
        ]

    alone = sorted(arrived(in_order=False))
    expected, latest = [], 0
    for source, k in alone:
        latest = max(k, latest)
        expected.append((source, latest))
    found = arrived(in_order=True)
    assert found == [one for one in expected if one[1] < 1000][: len(found)]
    assert len(alone) - len(found) <= 1 + longest // 10


def test_the_next_check_is_the_first_sample_at_which_a_message_can_be_sent():
    """However the sender jumps about: nothing is sent before, and where it moves on, then."""
    for check, phase in ((10, 0), (10, 7), (1, 0), (3, 2)):
        rule, due = CamRule(0.01, check, phase), phase
        for k in range(400):
            sends = rule.sends(k, 100.0 * k, 0.0)
            assert sends == (k == due)
            if sends:
                due = rule.next_check(k)
                assert due >= k + 10
