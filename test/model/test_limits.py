"""Limits of actuators, and vehicles that stand, worked out on paper."""

import numpy as np
import pytest

from cacc_platoon.model import ISO_15622, Limits, State
from cacc_platoon.model.limits import UNLIMITED, Limit, standing

STEP = 0.01
CONSTANT = Limits(Limit(2.0, 2.0), Limit(6.0, 6.0), Limit(10.0, 10.0))


@pytest.mark.parametrize(
    ("velocity", "most", "least", "jerk"),
    [(0.0, 4.0, 5.0, 5.0), (5.0, 4.0, 5.0, 5.0), (12.5, 3.0, 4.25, 3.75), (20.0, 2.0, 3.5, 2.5)],
)
def test_iso_15622_by_speed(velocity, most, least, jerk):
    command = ISO_15622.command
    assert command(99.0, most, velocity, STEP) == pytest.approx(most)
    assert command(-99.0, -least, velocity, STEP) == pytest.approx(-least)
    assert command(99.0, 0.0, velocity, STEP) == pytest.approx(jerk * STEP)
    assert command(0.01, 0.0, velocity, STEP) == 0.01


def test_constant_limits():
    assert CONSTANT.command(1.0, 0.95, 30.0, STEP) == 1.0
    assert CONSTANT.command(1.0, 0.0, 30.0, STEP) == pytest.approx(0.1)
    assert CONSTANT.command(-9.0, -5.95, 30.0, STEP) == -6.0


def test_floats_and_arrays_agree_to_the_last_bit():
    rng = np.random.default_rng(1)
    wanted, before, velocity = (
        rng.uniform(-9, 9, 200),
        rng.uniform(-3, 3, 200),
        rng.uniform(0, 40, 200),
    )
    for limits in (ISO_15622, CONSTANT, UNLIMITED):
        together = limits.command(wanted, before, velocity, STEP)
        for k in range(200):
            one = limits.command(float(wanted[k]), float(before[k]), float(velocity[k]), STEP)
            assert one == together[k]
    np.testing.assert_array_equal(UNLIMITED.command(wanted, before, velocity, STEP), wanted)


def test_who_would_drive_backwards_stands():
    moving, back = State(1.0, 0.2, -1.0), State(0.9, -0.1, -1.0)
    assert standing(moving, State(1.1, 0.1, -1.0)) == State(1.1, 0.1, -1.0)
    assert standing(moving, back) == State(1.0, 0.0, 0.0)
    arrays = standing(*(State(*map(np.array, state)) for state in (moving, back)))
    assert [float(part) for part in arrays] == [1.0, 0.0, 0.0]
