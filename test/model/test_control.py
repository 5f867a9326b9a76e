"""The constant time headway law, u_i = k_a w a_{i-1} - k_v (v_i - v_{i-1}) - k_p delta_i."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cacc_platoon.model import ConstantTimeHeadway, Gains

numbers = st.floats(-100.0, 100.0)
gains = st.builds(
    Gains, st.floats(0.1, 3.0), st.floats(0.0, 2.0), st.floats(0.0, 2.0), st.floats(1e-4, 1.0)
)
motions = st.tuples(numbers, numbers, numbers, numbers, numbers)


def test_a_command_worked_out_manually():
    law = ConstantTimeHeadway(Gains(1.0, 0.5, 0.25, 0.125), standstill_distance=5.0)
    # delta = -30 - 0 + 5 + 1 * 27 = 2; u = 0.5 * 3 - 0.25 * (27 - 25) - 0.125 * 2
    assert law.spacing_error(-30.0, 27.0, 0.0) == 2.0
    assert law.command(-30.0, 27.0, 0.0, 25.0, 3.0) == 0.75


@given(gains=gains, distance=st.floats(0.0, 20.0), speed=st.floats(0.0, 50.0))
def test_no_command_in_equilibrium(gains, distance, speed):
    law = ConstantTimeHeadway(gains, distance)
    position = 100.0 - distance - gains.time_headway * speed
    assert law.spacing_error(position, speed, 100.0) == pytest.approx(0.0, abs=1e-12)
    assert law.command(position, speed, 100.0, speed, 0.0) == pytest.approx(0.0, abs=1e-12)


@given(gains=gains, motion=motions)
def test_each_gain_acts_on_its_own_error(gains, motion):
    position, velocity, ahead, ahead_velocity, received = motion
    law = ConstantTimeHeadway(gains, 5.0)
    headway, k_a, k_v, k_p = gains
    delta = position - ahead + 5.0 + headway * velocity
    expected = k_a * received + k_v * (ahead_velocity - velocity) - k_p * delta
    assert law.command(*motion) == pytest.approx(expected, rel=1e-12, abs=1e-9)


@given(st.lists(st.tuples(gains, motions), min_size=1, max_size=20))
def test_arrays_agree_with_floats_to_the_last_bit(vehicles):
    columns = np.array([own for own, _ in vehicles]).T
    motion = np.array([motion for _, motion in vehicles]).T
    together = ConstantTimeHeadway(Gains(*columns), 5.0).command(*motion)
    alone = [ConstantTimeHeadway(own, 5.0).command(*values) for own, values in vehicles]
    assert together.tolist() == alone


def test_too_close_is_positive():
    law = ConstantTimeHeadway(Gains(0.95, 0.5, 0.63, 0.009), 5.0)
    assert law.spacing_error(position=-20.0, velocity=25.0, predecessor_position=0.0) > 0.0
    assert law.command(-20.0, 25.0, 0.0, 25.0, 0.0) < 0.0
