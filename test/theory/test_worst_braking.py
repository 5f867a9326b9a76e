"""The worst gap over all brakings: closed form for the first follower, and brakings that try."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from cacc_platoon.model import Gains, State, ThirdOrderPlant
from cacc_platoon.theory import DesignError, poles, worst_spacing
from cacc_platoon.theory.impulse import inverse_laplace
from cacc_platoon.theory.worst_braking import spacing_response

A = Gains(0.95, 0.5, 0.63, 0.009)
D = Gains(0.95, 0.5, 0.75, 1.0)
E = Gains(0.75, 0.5, 0.8, 0.5)
HOW: dict[str, Any] = {"standstill_distance": 5.0, "speed": 25.0, "deceleration": 8.0}
STEP = 0.005


@pytest.mark.parametrize("gains", [A, D, E], ids="ADE")
@pytest.mark.parametrize("k", [0.4, 0.6])
def test_the_first_follower_in_closed_form(gains, k):
    """kappa_1 is the integral of (tau s^2 + (1 - k) s + h k_p)/D."""
    numerator = np.array([[0.5, 1.0 - k, gains.time_headway * gains.k_p]]) / 0.5
    t = np.arange(0.0, 60.0, 5e-4)
    slope = inverse_laplace(numerator, poles(gains, 0.5)[np.newaxis], t[np.newaxis])[0]
    kappa = np.concatenate(([0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * 5e-4)))
    largest = np.sort(np.maximum(kappa, gains.time_headway))[::-1]
    lost = 5e-4 * largest[: round(3.125 / 5e-4)].sum()
    expected = 5.0 + gains.time_headway * 25.0 - 8.0 * lost
    assert worst_spacing(gains, 0.5, k, **HOW)[0] == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize(
    ("gains", "tau", "k", "rear", "rest"),
    [
        (Gains(0.88, 0.318305009, 0.85, 0.003), 0.5, 0.8 * 0.318305009, 12, 3.8947),
        (E, 0.5, 0.4, 5, 4.9137),
        (Gains(1.519188904, 0.14053001, 0.180616484, 2.126212733), 0.8, 0.106192, 11, 4.2714),
    ],
    ids=["C", "E", "ringing"],
)
def test_no_braking_leads_below_what_is_said_of_followers_far_behind(gains, tau, k, rear, rest):
    """Of exact states every 5 ms (scipy.linalg.expm), and their largest 3.125 s."""
    system = np.zeros((3 * rear + 2,) * 2)
    h, _, k_v, k_p = gains
    system[0, 1] = 1.0
    state = np.zeros(len(system))
    state[[1, 4]] = 1.0, k / tau
    for x in range(2, len(system), 3):
        ahead = max(x - 3, 0)
        system[[x, x + 1], [x + 1, x + 2]] = 1.0
        system[x + 2, x : x + 3] = np.array([-k_p, -k_v - h * k_p, -1.0]) / tau
        system[x + 2, ahead : ahead + 2] = np.array([k_p, k_v]) / tau
        system[x + 2, ahead + 2] += k / tau if x > 2 else 0.0
    step = expm(system * STEP)
    last = len(system) - 3
    spacing = np.zeros(24_000)
    for sample in range(len(spacing)):
        spacing[sample] = state[max(last - 3, 0)] - state[last]
        state = step @ state
    exact = 5.0 + 25.0 * h - 8.0 * STEP * np.sort(spacing)[-round(3.125 / STEP) :].sum()
    assert exact == pytest.approx(rest, abs=2e-4)
    for steps in (10.0, 20.0):
        said = worst_spacing(gains, tau, k, **HOW, vehicles=rear, steps=steps)[-1]
        assert exact - 0.004 < said < exact + 1e-4


def smallest(gains, k, braking):
    """Smallest spacings of two followers whose leader brakes with 8 m/s^2 where `braking` says."""
    h, _, k_v, k_p = gains
    plant = ThirdOrderPlant(0.5, STEP)
    state = State(-(5.0 + h * 25.0) * np.arange(3.0), np.full(3, 25.0), np.zeros(3))
    least = np.full(2, np.inf)
    command = np.zeros(3)
    for brakes in braking:
        state.acceleration[0] = -8.0 * brakes
        least = np.minimum(least, state.position[:-1] - state.position[1:])
        error = state.position[1:] - state.position[:-1] + 5.0 + h * state.velocity[1:]
        command[1:] = k * state.acceleration[:-1]
        command[1:] -= k_v * (state.velocity[1:] - state.velocity[:-1]) + k_p * error
        x, v = state.position[0], state.velocity[0]
        state = plant.advance(state, command)
        state.position[0] = x + STEP * v - 4.0 * brakes * STEP**2
        state.velocity[0] = v - 8.0 * brakes * STEP
    return least


@pytest.mark.parametrize("gains", [A, E], ids="AE")
def test_the_worst_braking_attains_it_and_no_other_exceeds_it(gains):
    worst = worst_spacing(gains, 0.5, 0.4, **HOW, vehicles=2)
    step, kappa = spacing_response(gains, 0.5, 0.4, 2)
    times = np.arange(0.0, 12.0, STEP)
    for vehicle in (0, 1):
        answer = np.interp(times, step * np.arange(len(kappa)), kappa[:, vehicle, 0])
        chosen = np.zeros(times.size)
        chosen[np.argsort(answer)[-round(3.125 / STEP) :]] = 1.0
        reached = smallest(gains, 0.4, chosen[::-1])[vehicle]
        assert reached == pytest.approx(worst[vehicle], abs=0.02)
    rng = np.random.default_rng(2)
    tries = [np.arange(2000) < round(3.125 / STEP)]
    for _ in range(2):
        slots = rng.permutation(16)[:5]
        tries.append(np.isin(np.arange(2000) // 125, slots))
    for braking in tries:
        assert (smallest(gains, 0.4, braking.astype(float)) >= worst - 0.02).all()


def test_a_straight_stop_is_not_the_worst():
    """Of vehicle 2 behind E: braking twice brings it closer than braking once."""
    stop = np.arange(2000) < round(3.125 / STEP)
    straight = smallest(E, 0.4, stop.astype(float))[1]
    assert worst_spacing(E, 0.5, 0.4, **HOW, vehicles=2)[1] < straight - 0.01


def test_several_lags_and_gains_give_the_least_of_them():
    lags, k, how = [0.5, 0.5, 0.1], [0.4, 0.6, 0.4], {**HOW, "vehicles": 2, "steps": 15.0}
    alone = [worst_spacing(E, *pair, **how) for pair in zip(lags, k, strict=True)]
    found = worst_spacing(E, lags, k, **how)
    assert found == pytest.approx(np.min(alone, axis=0), abs=0.02)


def test_edges():
    assert worst_spacing(Gains(0.2, 0.5, 0.01, 5.0), 0.5, 0.4, **HOW)[0] == -math.inf
    hard = worst_spacing(D, 0.5, 0.4, **{**HOW, "deceleration": 80.0})[0]
    assert hard < worst_spacing(D, 0.5, 0.4, **HOW)[0]
    gentle = worst_spacing(D, 0.5, 0.4, **{**HOW, "deceleration": 0.01})[0]
    assert gentle == pytest.approx(5.0, abs=0.02)
    with pytest.raises(DesignError, match="deceleration = 0 m/s"):
        worst_spacing(D, 0.5, 0.4, **{**HOW, "deceleration": 0.0})
