"""A picture as lines of a terminal: everything that fits, and nothing that wraps."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cacc_platoon.live.picture import Picture, VehicleNow
from cacc_platoon.live.summary import summary_line
from cacc_platoon.live.table import COLUMNS, Mood, table_lines
from cacc_platoon.scenario.run_event import EventKind, RunEvent

EVENTS = (
    RunEvent(EventKind.START, 0, "supervisor"),
    RunEvent(EventKind.RECEPTION, 950, "vehicle_2/vehicle", "fallback"),
)


def vehicle(index: int, **more) -> VehicleNow:
    values = {
        "sample": 1000,
        "position": 100.0 - 30.0 * index,
        "velocity": 25.1234,
        "acceleration": -0.25,
        "gap": 28.75 if index else None,
        "spacing_error": 0.01234 if index else None,
        "received": -0.26 if index else None,
        "packet_age": 0.02 if index else None,
    }
    return VehicleNow(index, **{**values, **more})


def picture(count: int = 4, **more) -> Picture:
    values = {
        "phase": "running",
        "sample": 1000,
        "samples": 20_001,
        "step": 0.01,
        "factor": 27.94,
        "left": 6.8,
        "events": EVENTS,
        "vehicles": tuple(vehicle(index) for index in range(count)),
    }
    return Picture("/platoon", **{**values, **more})


def test_each_vehicle_has_a_row_with_what_is_known_of_it():
    lines = table_lines(picture(), 120, 24)
    assert lines[0] == (
        "/platoon  running  sample 1000 of 20000, 10.0 s  real-time factor 27.9  7 s left"
    )
    assert lines[1].split() == [
        *("vehicle", "gap", "speed", "error", "accel", "V2V", "age", "received", "position"),
    ]
    assert lines[2].split() == ["[m]", "[m/s]", "[m]", "[m/s^2]", "[s]", "[m/s^2]", "[m]"]
    assert lines[3].split() == ["0", "25.123", "-0.250", "100.00"]
    assert lines[5].split() == [
        *("2", "28.75", "25.123", "+0.0123", "-0.250", "received", "0.02", "-0.260", "40.00"),
    ]
    assert lines[7:] == [
        "    0.00 s  supervisor start",
        "    9.50 s  vehicle_2/vehicle reception fallback",
    ]


def test_vehicles_that_do_not_fit_are_counted():
    lines = table_lines(picture(100), 100, 24)
    assert len(lines) == 24
    assert [line for line in lines if "more" in line] == ["... and 82 more vehicles"]
    assert lines[-4].split()[0] == "17"


def test_all_vehicles_are_shown_where_they_just_fit():
    lines = table_lines(picture(19, events=()), 100, 22)
    assert lines[-1].split()[0] == "18"


def test_on_a_narrow_terminal_what_matters_less_is_left_out():
    names = table_lines(picture(), 40, 24)[1].split()
    assert names == ["vehicle", "gap", "speed", "error"]
    assert table_lines(picture(), 8, 24)[3].split() == ["0"]
    assert table_lines(picture(), 3, 24)[1] == "veh"


@given(
    st.integers(0, 60),
    st.integers(1, 200),
    st.integers(1, 60),
    st.text(max_size=80),
)
def test_nothing_is_wider_or_higher_than_the_terminal(count, width, height, text):
    events = (RunEvent(EventKind.FAULT, 5, text, text),)
    lines = table_lines(picture(count, events=events, message=text), width, height)
    assert 1 <= len(lines) <= height
    assert all(len(line) <= width and line.isprintable() for line in lines)


def test_letters_that_take_two_columns_are_counted_so():
    [line] = table_lines(picture(0, events=(), message="長" * 30), 21, 3)[1:]
    assert line == "長" * 10


def test_colours_change_nothing_else():
    shown = picture(4, vehicles=(vehicle(0), vehicle(1, reception="fallback", gap=-0.1)))
    plain = table_lines(shown, 100, 24)
    coloured = table_lines(shown, 100, 24, coloured=True)
    without = [re.sub(r"\x1b\[\d+m", "", line).rstrip() for line in coloured]
    assert without == plain
    assert Mood.ALARM.paint("   fallback") in coloured[4]
    assert Mood.ALARM.paint("   -0.10") in coloured[4]
    assert all("\x1b" not in line for line in plain)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({}, "received"),
        ({"reception": "fallback"}, "fallback"),
        ({"reception": "normal", "alarm": True}, "alarm"),
        ({"sample": 600}, "4 s behind"),
        ({"sample": None}, "not heard"),
        ({"received": None}, ""),
    ],
)
def test_the_state_is_the_most_urgent_thing(more, said):
    [column] = [column for column in COLUMNS if column.name == "V2V"]
    assert column.cell(vehicle(1, **more), picture()).text == said


def test_all_vehicles_of_one_sample_are_behind_nobody():
    """However much further the run is: at full speed pictures are seconds of it apart."""
    lines = table_lines(picture(sample=5000), 100, 24)
    assert not [line for line in lines if "behind" in line]


def test_before_anything_is_heard_that_is_said():
    assert table_lines(Picture("/platoon"), 80, 24) == ["/platoon  nothing heard yet"]


def test_silence_is_told():
    assert "silent for 7 s" in table_lines(picture(silence=7.2), 120, 24)[0]


def test_a_line_names_the_extremes():
    vehicles = (
        vehicle(0),
        vehicle(1, spacing_error=-1.5, gap=28.0),
        vehicle(2, spacing_error=1.0, reception="fallback", alarm=True),
    )
    assert summary_line(picture(vehicles=vehicles)) == (
        "/platoon, running, sample 1000 of 20000, 10.0 s, real-time factor 27.9, 7 s left, "
        "largest spacing error -1.500 m (vehicle 1), smallest gap 28.00 m (vehicle 1), "
        "fallback: 2, alarm: 2"
    )
