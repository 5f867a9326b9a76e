"""The assumption monitor: silent on what keeps the assumption, and how soon on what does not."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cacc_platoon.model import (
    Allowances,
    AssumptionMonitor,
    FallbackReception,
    HoldReception,
    Lattice,
    MonitoredReception,
    ReceptionState,
    State,
    ThirdOrderPlant,
    factor_interval,
)

T = 0.01
JERK = 8.0
RHO = st.sampled_from([1.2, 2.0, 5.0, 50.0])


def driven(rng, samples, tau):
    """Return velocities and accelerations under random held commands, as vehicles have them."""
    plant = ThirdOrderPlant(tau, T)
    state, motion = State(0.0, 20.0, 0.0), []
    commands = np.repeat(rng.uniform(-8.0, 8.0, samples), rng.integers(1, 60, samples))
    for u in commands[:samples]:
        motion.append((state.velocity, state.acceleration))
        state = plant.advance(state, u)
    return np.array(motion).T


def jerky(rng, samples):
    """Return velocities and accelerations whose jerk is +-JERK at random."""
    turns = np.repeat(rng.choice([-JERK, JERK], samples), rng.integers(1, 30, samples))[:samples]
    acceleration = np.concatenate(([0.0], T * np.cumsum(turns)))[:-1]
    steps = T * acceleration + T**2 / 2.0 * turns
    return np.concatenate(([20.0], 20.0 + np.cumsum(steps)))[:-1], acceleration


def at_an_end(rng, rho, samples):
    """Return factors that stay at one end of the interval for a while, then at the other."""
    ends = np.repeat(rng.integers(0, 2, samples), rng.integers(1, 200, samples))[:samples]
    return np.array(factor_interval(rho))[ends]


def deliveries(rng, received, interval=1, loss=0.0, latest=0):
    """Return the packets delivered at each sample, some of them lost, late and overtaken."""
    delivered: list[list[tuple[int, float]]] = [[] for _ in received]
    for source in range(0, len(received), interval):
        k = source + int(rng.integers(0, latest + 1))
        if k < len(received) and rng.random() >= loss:
            delivered[k].append((source, float(received[source])))
    return delivered


def watch(monitor, velocity, delivered, delay=0):
    """Return alarms and excesses; the vehicle's own velocity oscillates meanwhile."""
    own = 20.0 + np.sin(0.05 * np.arange(len(velocity)))
    seen = []
    for k, packets in enumerate(delivered):
        then = max(k - delay, 0)
        measured = own[k] + (velocity[then] - own[then])
        seen.append((monitor.step(float(own[k]), float(measured), packets), monitor.excess))
    alarms, excess = zip(*seen, strict=True)
    return np.array(alarms), np.array(excess)


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32), rho=RHO, tau=st.floats(0.02, 1.0), window=st.integers(1, 400))
def test_no_alarm_whatever_w_within_the_interval_is(seed, rho, tau, window):
    """Without any allowance: between two samples of a held command acceleration is monotone."""
    rng = np.random.default_rng(seed)
    velocity, acceleration = driven(rng, 500, tau)
    received = at_an_end(rng, rho, 500) * acceleration
    monitor = AssumptionMonitor(Allowances(rho), T, window)
    alarms, _ = watch(monitor, velocity, deliveries(rng, received))
    assert not alarms.any()


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**32),
    rho=RHO,
    packets=st.tuples(st.integers(1, 100), st.floats(0.0, 0.9), st.integers(0, 30)),
    delay=st.integers(0, 20),
)
def test_nor_when_packets_are_rare_lost_late_wrong_and_seen_with_noise(seed, rho, packets, delay):
    rng = np.random.default_rng(seed)
    velocity, acceleration = jerky(rng, 800)
    said = Lattice(0.1).nearest(acceleration + rng.uniform(-0.2, 0.2, 800))
    received = at_an_end(rng, rho, 800) * said
    seen = velocity + rng.choice([-0.05, 0.05], 800)
    allowed = Allowances(rho, velocity=0.1, acceleration=0.25, jerk=JERK)
    monitor = AssumptionMonitor(allowed, T, 200, delay)
    delivered = deliveries(rng, received, *packets)
    alarms, _ = watch(monitor, seen, delivered, delay)
    assert not alarms.any()


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("what", ["velocity", "acceleration", "jerk"])
def test_every_allowance_is_needed_and_no_larger_than_that(what, sign):
    """The worst case of each, and a monitor that allows for 1 % less."""
    samples, interval = 200, 20
    velocity, acceleration = np.full(samples, 20.0), np.zeros(samples)
    if what == "velocity":
        allowed = Allowances(5.0, velocity=0.1)
        velocity[100:] += sign * 0.1
    elif what == "acceleration":
        allowed = Allowances(5.0, acceleration=0.25)
        velocity += sign * 0.25 * T * np.arange(samples)
    else:
        allowed = Allowances(5.0, jerk=JERK)
        half = interval * T / 2.0
        tent = half - np.abs(np.arange(samples) * T % (2.0 * half) - half)
        steps = np.convolve(sign * JERK * tent, [0.5, 0.5])[1:samples]
        velocity[1:] += T * np.cumsum(steps)
    found = []
    for share in (1.0, 0.99):
        less = Allowances(5.0, *(share * part for part in allowed[1:]))
        delivered = deliveries(np.random.default_rng(1), acceleration, interval)
        alarms, _ = watch(AssumptionMonitor(less, T, 200), velocity, delivered)
        found.append(bool(alarms.any()))
    assert found == [False, True]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("factor", [3.0, 1.6, 0.6, -1.0])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_false_factor_is_noticed_in_time(sign, factor, noise):
    """The excess grows at least as docs/theory.md, section 11 (Extensions), says."""
    rng = np.random.default_rng(4)
    low, high = factor_interval(5.0)
    acceleration = np.where(np.arange(1500) < 500, 1.0, 2.0) * sign
    velocity = 20.0 + np.concatenate(([0.0], T * np.cumsum(acceleration)))[:-1]
    received = at_an_end(rng, 5.0, 1500) * acceleration
    received[700:] *= factor
    allowed = Allowances(5.0, velocity=2.0 * noise, jerk=1.0)
    seen = velocity + rng.choice([-noise, noise], 1500)
    alarms, _ = watch(AssumptionMonitor(allowed, T, 400), seen, deliveries(rng, received))
    assert not alarms[:701].any()
    outside = factor * low / high - 1.0 if factor > 1.0 else 1.0 - factor * high / low
    growth = 2.0 * outside - 1.0 * T / 4.0
    assert growth > 0.1
    latest = 701 + math.ceil(4.0 * noise / growth / T) + 1
    assert 701 <= int(alarms.argmax()) <= latest
    assert alarms[latest:].all()


def test_a_factor_within_what_noise_can_do_is_never_noticed():
    """With w = 1 a factor of 1.2 keeps the assumption itself."""
    velocity, acceleration = driven(np.random.default_rng(2), 2000, 0.3)
    for factor in (0.8, 1.2):
        delivered = deliveries(np.random.default_rng(2), factor * acceleration)
        alarms, _ = watch(AssumptionMonitor(Allowances(5.0), T, 200), velocity, delivered)
        assert not alarms.any()
    delivered = deliveries(np.random.default_rng(2), 1.25 * acceleration)
    alarms, _ = watch(AssumptionMonitor(Allowances(5.0), T, 200), velocity, delivered)
    assert alarms.any()


def test_without_acceleration_nothing_is_noticed():
    delivered = deliveries(np.random.default_rng(3), 3.0 * np.zeros(500))
    alarms, _ = watch(AssumptionMonitor(Allowances(5.0), T, 100), np.full(500, 20.0), delivered)
    assert not alarms.any()


def test_a_late_sensor_says_the_same_later():
    rng = np.random.default_rng(5)
    velocity, acceleration = driven(rng, 1000, 0.3)
    received = np.where(np.arange(1000) < 400, acceleration, 3.0 * acceleration)
    delivered = deliveries(rng, received)
    at_once, first = watch(AssumptionMonitor(Allowances(5.0), T, 100), velocity, delivered)
    late, then = watch(AssumptionMonitor(Allowances(5.0), T, 100, 17), velocity, delivered, 17)
    assert at_once.any()
    assert (late[17:] == at_once[:-17]).all()
    assert then[17:] == pytest.approx(first[:-17], abs=1e-12)


def test_an_alarm_ends_a_window_after_what_caused_it_and_with_the_packets():
    velocity = np.full(1000, 20.0)
    received = np.zeros(1000)
    received[300:350] = 2.0
    delivered = deliveries(np.random.default_rng(6), received)
    alarms, _ = watch(AssumptionMonitor(Allowances(5.0), T, 100), velocity, delivered)
    assert np.flatnonzero(alarms).tolist() == list(range(301, 449))
    silent = [packets if k < 340 else [] for k, packets in enumerate(delivered)]
    alarms, excess = watch(AssumptionMonitor(Allowances(5.0), T, 100), velocity, silent)
    assert np.flatnonzero(alarms).tolist() == list(range(301, 440))
    assert (excess[440:] == 0.0).all()


def test_a_cut_value_may_stand_for_more_but_not_for_less():
    velocity = 20.0 + 5.0 * T * np.arange(300)
    for factor in factor_interval(5.0):
        for sign in (1.0, -1.0):
            cut = deliveries(np.random.default_rng(7), np.full(300, sign * 2.0 * factor))
            allowed = Allowances(5.0, saturation=2.0)
            for motion, contradicts in ((sign * velocity, False), (0.0 * velocity, True)):
                alarms, _ = watch(AssumptionMonitor(allowed, T, 100), motion, cut)
                assert alarms[-1] == contradicts
            alarms, _ = watch(AssumptionMonitor(Allowances(5.0), T, 100), sign * velocity, cut)
            assert alarms[-1]


def test_what_is_not_finite_blinds_it_for_a_window_at_most():
    velocity = np.full(900, 20.0)
    received = np.zeros(900)
    received[[50, 60, 70]] = math.nan, math.inf, -math.inf
    received[400:] = 1.0
    velocity[80] = math.nan
    delivered = deliveries(np.random.default_rng(8), received)
    alarms, _ = watch(AssumptionMonitor(Allowances(5.0), T, 100), velocity, delivered)
    assert not alarms[:401].any()
    assert alarms[401:].all()


def watched(acts):
    monitor = AssumptionMonitor(Allowances(5.0), T, 5)
    return MonitoredReception(FallbackReception(100, 4, 3), monitor, acts)


@pytest.mark.parametrize("acts", [True, False])
def test_an_alarm_counts_as_silence_where_it_acts(acts):
    reception, shares, alarms = watched(acts), [], []
    for k in range(30):
        reception.measure(20.0, 20.0)
        reception.use([(k, 1.0 if 10 <= k < 12 else 0.0)])
        alarms.append(reception.monitor.alarm)
        shares.append(reception.share)
    assert np.flatnonzero(alarms).tolist() == list(range(11, 16))
    falling = [0.75, 0.5, 0.25, 0.0, 0.0] + [0.0] * 2 + [0.25, 0.5, 0.75] + [1.0] * 9
    assert shares == ([1.0] * 11 + falling if acts else [1.0] * 30)
    assert reception.state == ReceptionState.NORMAL


def test_another_reception_is_left_alone():
    reception = MonitoredReception(HoldReception(), AssumptionMonitor(Allowances(5.0), T, 5), True)
    reception.measure(20.0, 20.0)
    assert reception.use([(0, 1.5)]) == 1.5
    reception.measure(20.0, 20.0)
    assert reception.use([]) == 1.5
    assert (reception.share, reception.state) == (1.0, 0)
