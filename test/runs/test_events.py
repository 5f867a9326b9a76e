"""events.jsonl of run folders, whole ones, damaged and hostile ones."""

import json
import os

import pytest

from cacc_platoon.runs.events import EVENTS_FILE, append_events, bag_events, event_line
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
