"""Run folders of anybody: what run.json and the index of a part may say, and what becomes of it."""

import json
import math
from typing import Any

import numpy as np
import pytest

from cacc_platoon.bags.raw import BagError
from cacc_platoon.errors import UserError
from cacc_platoon.runs.info import InfoError, RunInfo
from cacc_platoon.runs.locate import locate
from cacc_platoon.runs.parts import read_parts
from cacc_platoon.runs.recorded_run import read_run

DEEP = "[" * 100_000
STRANGE: tuple[Any, ...] = (True, -1, 2**64, math.inf, math.nan, [], {}, [[]], {"a": []})
ENTRY: dict[str, Any] = {
    "name": "/platoon/vehicle_0/pose",
    "type": "x",
    "size": 8,
    "file": "0000.cdr",
}


@pytest.mark.parametrize("key", ["samples", "wall_time", "seed", "hosts", "messages", "status"])
@pytest.mark.parametrize("value", STRANGE, ids=repr)
def test_values_of_other_types_are_damage(key, value):
    document = {**RunInfo().to_json(), key: value}
    if value == RunInfo().to_json()[key]:
        return
    if key == "wall_time" and value == 2**64:
        document[key] = 1e300
    with pytest.raises(InfoError):
        RunInfo.from_json(document)


@pytest.mark.parametrize("text", [DEEP, "", "null", "1" * 5000, '{"a":' * 9999, " " * 9_000_000])
def test_a_damaged_run_json_is_left_out(run_folder, text):
    (run_folder / "run.json").write_text(text)
    run = read_run(*locate(run_folder))
    assert run.info is None
    assert "run.json is damaged and left out" in run.findings


def test_texts_of_run_json_can_be_shown(run_folder):
    document = json.loads((run_folder / "run.json").read_text())
    document |= {"status": "failed", "message": "\x1b[2J\nfirst\nsecond" + "x" * 10**6}
    document["versions"] = {"numpy": "\ud800"}
    (run_folder / "run.json").write_text(json.dumps(document))
    run = read_run(*locate(run_folder))
    assert run.info
    assert run.info.versions == {"numpy": "\\ud800"}
    assert all(line.isprintable() and len(line) < 3000 for line in run.findings)


@pytest.mark.parametrize(
    "document",
    [
        *(DEEP, "", "\xff", "3", '{"format": 1}', "[1]", "[null]"),
        *([{**ENTRY, "file": file}] for file in ("../x.cdr", "/etc/passwd", "a\0", "x" * 999, 3)),
        *([{**ENTRY, "size": size}] for size in (0, -1, 2**70, 1e308, "8", True)),
        [{**ENTRY, "name": 3}],
    ],
    ids=repr,
)
def test_a_damaged_index_of_a_part_is_one_line(run_folder, tmp_path, document):
    part = run_folder / "parts" / "host_0"
    part.mkdir(parents=True)
    text = document if isinstance(document, str) else json.dumps(document)
    (part / "topics.json").write_text(text, "latin-1")
    (part / "0000.cdr").write_bytes(bytes(16))
    (run_folder / "bag").rename(tmp_path / "elsewhere")
    with pytest.raises(UserError, match=r"topics\.json: is damaged .* Restore it, or remove"):
        read_parts([part])
    with pytest.raises(UserError, match=r"topics\.json: is damaged"):
        locate(run_folder)


def test_a_sound_index_is_read(tmp_path):
    (tmp_path / "topics.json").write_text(json.dumps([ENTRY]))
    np.arange(16, dtype=np.uint8).tofile(tmp_path / "0000.cdr")
    assert read_parts([tmp_path])[ENTRY["name"]].messages.shape == (2, 8)


def test_names_of_topics_that_ros_cannot_have_make_no_platoon(bags, tmp_path, scenario, recording):
    renamed = {name.replace("/platoon", "/\x1b[2J"): rows for name, rows in recording.items()}
    bag = bags.foreign(tmp_path / "bag", scenario, renamed, with_scenario=False)
    with pytest.raises(BagError, match="holds no platoon") as error:
        read_run(bag, scenario=scenario)
    assert str(error.value).isprintable()
