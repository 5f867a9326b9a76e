"""Leader profiles: speed is the integral of acceleration, and position the integral of speed."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from cacc_platoon.errors import UserError
from cacc_platoon.model import (
    LeaderProfile,
    PiecewiseConstantAcceleration,
    SinePulse,
    State,
    brake_profile,
    read_speed_profile,
    sample_profile,
    speed_profile,
    step_profile,
)

PAPER = SinePulse(velocity=25.0, amplitude=0.5, angular_frequency=0.1, start=10.0)
PROFILES: dict[str, tuple[LeaderProfile, list[float]]] = {
    "sine": (PAPER, [10.0, 10.0 + 20.0 * math.pi]),
    "late sine": (SinePulse(20.0, -2.0, 0.7, 3.0), [3.0, 3.0 + 2.0 * math.pi / 0.7]),
    "step": (step_profile(25.0, 1.5, 10.0, 5.0), [10.0, 15.0]),
    "step at once": (step_profile(25.0, -0.5, 0.0, 5.0), [0.0, 5.0]),
    "brake": (brake_profile(25.0, 3.0, 10.0, 4.0), [10.0, 17.0]),
    "constant": (PiecewiseConstantAcceleration(25.0, [], []), []),
    "table": (speed_profile([0.0, 5.0, 7.5, 30.0], [25.0, 20.0, 28.0, 10.0]), [5.0, 7.5, 30.0]),
}


def integral(function, until, breaks):
    """Integrate between breaks, where the integrand is smooth."""
    ends = [0.0, *(t for t in breaks if 0.0 < t < until), until]
    return sum(quad(function, a, b, limit=200)[0] for a, b in itertools.pairwise(ends))


@pytest.mark.parametrize("name", PROFILES)
@settings(max_examples=25)
@given(time=st.floats(0.0, 100.0))
def test_position_and_velocity_are_integrals(name, time):
    profile, breaks = PROFILES[name]
    start, now = profile.at(0.0), profile.at(time)
    speed = start.velocity + integral(lambda t: profile.at(t).acceleration, time, breaks)
    travel = integral(lambda t: profile.at(t).velocity, time, breaks)
    assert now.velocity == pytest.approx(speed, abs=1e-9)
    assert now.position == pytest.approx(travel, abs=1e-7)
    assert start.position == 0.0


def test_the_papers_pulse():
    # theory: a full sine gains 2 A/Omega = 10 m/s, gives it back, and travels 2 pi A/Omega^2 more
    end = 10.0 + 2.0 * math.pi / 0.1
    assert PAPER.at(10.0 + math.pi / 0.1).velocity == pytest.approx(35.0)
    assert PAPER.at(end).position == pytest.approx(25.0 * end + 314.1592653589793)
    assert PAPER.at(end)[1:] == (25.0, 0.0)
    assert PAPER.at(200.0).position - 25.0 * 200.0 == pytest.approx(314.1592653589793)
    assert PAPER.at(10.0 + 0.25 * math.tau / 0.1).acceleration == pytest.approx(0.5)


def test_nothing_happens_before_the_start():
    assert PAPER.at(10.0) == State(250.0, 25.0, 0.0)
    assert PAPER.at(3.0) == State(75.0, 25.0, 0.0)
    assert step_profile(25.0, 1.0, 10.0, 5.0).at(9.5) == State(237.5, 25.0, 0.0)


def test_braking_ends_at_the_final_speed():
    brake = brake_profile(25.0, 2.5, 10.0, 5.0)
    assert brake.at(12.0) == State(250.0 + 45.0, 20.0, -2.5)
    assert brake.at(100.0) == State(250.0 + 120.0 + 5.0 * 82.0, 5.0, 0.0)


def test_a_step_adds_acceleration_times_hold():
    step = step_profile(20.0, 0.5, 1.0, 4.0)
    assert step.at(3.0).acceleration == 0.5
    assert step.at(50.0) == State(20.0 + 84.0 + 22.0 * 45.0, 22.0, 0.0)


def test_a_speed_table_is_followed():
    profile = speed_profile([0.0, 10.0, 20.0], [25.0, 15.0, 30.0])
    assert [profile.at(t).velocity for t in (0.0, 5.0, 10.0, 15.0, 20.0, 99.0)] == [
        *(25.0, 20.0, 15.0, 22.5, 30.0, 30.0)
    ]


def test_samples_are_the_profile_at_whole_steps():
    samples = sample_profile(PAPER, 0.01, 2001)
    assert samples.shape == (3, 2001)
    assert samples[:, 1234].tolist() == list(PAPER.at(1234 * 0.01))
    assert np.all(np.diff(samples[0]) > 0.0)


def test_a_csv_file_with_and_without_a_heading(tmp_path):
    path = tmp_path / "speed.csv"
    path.write_text("time,speed\n# a remark\n0,25\n5, 20.5\n\n10,25\n")
    assert read_speed_profile(path) == ((0.0, 5.0, 10.0), (25.0, 20.5, 25.0))
    path.write_text("0,25\n5,20.5\n")
    assert read_speed_profile(path) == ((0.0, 5.0), (25.0, 20.5))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "two rows or more"),
        ("0,25\n", "two rows or more"),
        ("1,25\n2,25\n", "first at time 0 s"),
        ("0,25\n5,x\n", "row 2 (5,x) is not a time [s] and a speed [m/s]"),
        ("0,25\n5\n", "row 2 (5) is not a time"),
        ("0,25\n5,20,3\n", "row 2 (5,20,3) is not a time"),
        ("0,25\n5,nan\n", "row 2 (5,nan) is not finite"),
        ("0,25\n5,inf\n", "is not finite"),
        ("0,25\n5,20\n5,21\n", "row 3 (5,21) does not come after time 5 s"),
    ],
)
def test_a_bad_csv_file_is_refused_in_one_line(tmp_path, text, words):
    path = tmp_path / "speed.csv"
    path.write_text(text)
    with pytest.raises(UserError) as refusal:
        read_speed_profile(path)
    line = str(refusal.value)
    assert line.startswith(f"{path}: ")
    assert words in line
    assert "\n" not in line
