"""events.jsonl of run folders, whole ones, damaged and hostile ones."""

import json
import os
import random

import pytest

from cacc_platoon.runs.events import (
    EVENTS_FILE,
    append_events,
    bag_events,
    event_line,
    settle_events,
)
from cacc_platoon.scenario.run_event import EventKind, RunEvent

HIT = RunEvent(EventKind.COLLISION, 7, "vehicle_1/vehicle")
START = RunEvent(EventKind.START, 0, "supervisor")


def test_what_is_told_is_read_back_in_order(tmp_path):
    append_events(tmp_path, [HIT], 0.01)
    append_events(tmp_path, [START], 0.01)
    assert bag_events(tmp_path, 8) == [(0, event_line(START, 0.01)), (7, event_line(HIT, 0.01))]
    assert bag_events(tmp_path, 7) == [(0, event_line(START, 0.01))]


@pytest.mark.parametrize(
    "line", ["", "{", "[]", "[" * 100_000, "7", '{"sample": "7"}', '{"sample": true}', "{}"]
)
def test_a_line_that_is_none_is_left_out(tmp_path, line):
    (tmp_path / EVENTS_FILE).write_text(f"{line}\n{json.dumps({'sample': 3})}\n")
    assert bag_events(tmp_path, 8) == [(3, '{"sample": 3}')]


def test_what_is_no_file_of_text_has_no_events(tmp_path):
    assert bag_events(tmp_path, 8) == []
    (tmp_path / EVENTS_FILE).write_bytes(b"\xff\xfe")
    assert bag_events(tmp_path, 8) == []
    (tmp_path / EVENTS_FILE).unlink()
    os.mkfifo(tmp_path / EVENTS_FILE)
    assert bag_events(tmp_path, 8) == []


def test_events_are_settled_in_one_order_however_they_came(tmp_path):
    """Front to rear within a sample, changes before what they cause, nothing beyond the end."""
    turns = [
        RunEvent(EventKind.RECEPTION, 7, f"vehicle_{index}/vehicle", "degrading")
        for index in (2, 10)
    ]
    change = RunEvent(EventKind.CHANGE, 7, "vehicle_3/noise_relay", "v2v.loss=1.0")
    end = RunEvent(EventKind.END, 7, "supervisor", "finished")
    beyond = RunEvent(EventKind.LIMIT, 8, "vehicle_1/vehicle", "acts")
    expected = [START, change, *turns, HIT, end]
    for _ in range(5):
        told = random.sample([*expected, beyond], 7)
        (tmp_path / EVENTS_FILE).unlink(missing_ok=True)
        append_events(tmp_path, told, 0.01)
        settle_events(tmp_path, 8)
        lines = (tmp_path / EVENTS_FILE).read_text().splitlines()
        assert lines == [event_line(event, 0.01) for event in expected]
        assert [line for _, line in bag_events(tmp_path, 8)] == lines


def test_what_is_no_event_is_left_at_the_end(tmp_path):
    append_events(tmp_path, [HIT, START], 0.01)
    with (tmp_path / EVENTS_FILE).open("a") as file:
        file.write("{half a li")
    settle_events(tmp_path, 8)
    lines = (tmp_path / EVENTS_FILE).read_text().splitlines()
    assert lines == [event_line(START, 0.01), event_line(HIT, 0.01), "{half a li"]
    (tmp_path / EVENTS_FILE).unlink()
    settle_events(tmp_path, 8)
    assert not (tmp_path / EVENTS_FILE).exists()
