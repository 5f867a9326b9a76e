"""The plant against the matrix exponential and against a numerical integration of its ODE."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from cacc_platoon.model import State, ThirdOrderPlant

taus = st.floats(0.02, 3.0)
steps = st.floats(1e-3, 0.5)
numbers = st.floats(-50.0, 50.0)


def zero_order_hold(tau: float, step: float) -> np.ndarray:
    """Return [A_T B_T] of x' = v, v' = a, a' = (u - a)/tau from one matrix exponential."""
    generator = np.zeros((4, 4))
    generator[0, 1] = generator[1, 2] = 1.0
    generator[2, 2:] = -1.0 / tau, 1.0 / tau
    return expm(generator * step)[:3]


@given(tau=taus, step=steps, state=st.tuples(numbers, numbers, numbers), command=numbers)
def test_one_step_is_the_matrix_exponential(tau, step, state, command):
    expected = zero_order_hold(tau, step) @ [*state, command]
    result = ThirdOrderPlant(tau, step).advance(State(*state), command)
    np.testing.assert_allclose(result, expected, rtol=1e-12, atol=1e-11)


@settings(max_examples=20)
@given(tau=st.floats(0.1, 1.0), commands=st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=5))
def test_steps_follow_the_differential_equation(tau, commands):
    step, state = 0.25, State(3.0, 25.0, -0.5)
    plant = ThirdOrderPlant(tau, step)
    for command in commands:

        def slope(_time, values, u=command):
            return [values[1], values[2], (u - values[2]) / tau]

        solution = solve_ivp(slope, (0.0, step), state, rtol=1e-10, atol=1e-12)
        state = plant.advance(state, command)
        np.testing.assert_allclose(state, solution.y[:, -1], rtol=1e-8, atol=1e-8)


@given(tau=taus, step=steps, velocity=numbers, command=numbers)
def test_two_half_steps_are_one_step(tau, step, velocity, command):
    start = State(0.0, velocity, 1.0)
    half = ThirdOrderPlant(tau, step / 2.0)
    whole = ThirdOrderPlant(tau, step).advance(start, command)
    halves = half.advance(half.advance(start, command), command)
    np.testing.assert_allclose(whole, halves, rtol=1e-12, atol=1e-11)


def test_acceleration_approaches_the_command_with_the_time_constant_tau():
    after = ThirdOrderPlant(tau=0.4, step=0.4).advance(State(0.0, 0.0, 0.0), 2.0)
    assert after.acceleration == pytest.approx(2.0 * (1.0 - np.exp(-1.0)), rel=1e-15)


@given(st.lists(st.tuples(taus, numbers, numbers, numbers, numbers), min_size=1, max_size=20))
def test_arrays_agree_with_floats_to_the_last_bit(vehicles):
    tau, position, velocity, acceleration, command = (
        np.array(c) for c in zip(*vehicles, strict=True)
    )
    together = ThirdOrderPlant(tau, 0.01).advance(State(position, velocity, acceleration), command)
    for index, (own_tau, *state, own_command) in enumerate(vehicles):
        alone = ThirdOrderPlant(own_tau, 0.01).advance(State(*state), own_command)
        assert tuple(alone) == tuple(part[index] for part in together)


def test_equilibrium_is_kept():
    state = State(0.0, 25.0, 0.0)
    plant = ThirdOrderPlant(0.5, 0.01)
    for _ in range(1000):
        state = plant.advance(state, 0.0)
    assert state.velocity == 25.0
    assert state.acceleration == 0.0
    assert state.position == pytest.approx(250.0, rel=1e-12)
