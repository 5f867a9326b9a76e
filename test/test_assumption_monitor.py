"""examples/assumption_monitor: page and numbers are what its command makes."""

import json
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "examples" / "assumption_monitor"
sys.path.insert(0, str(FOLDER))

import measure  # noqa: E402  (the folder of the example is no package)

KEPT = json.loads((FOLDER / "measured.json").read_text())
PAGE = (FOLDER / "README.md").read_text()
SHORT = measure.Size(seeds=1, followers=2, duration=20.0, begins=2)


def row(**wanted):
    [found] = [
        one
        for part in ("false_alarms", "detection")
        for one in KEPT[part]
        if all(one.get(key) == value for key, value in wanted.items())
    ]
    return found


def test_the_page_has_the_tables_of_the_numbers():
    assert measure.with_tables(PAGE, KEPT) == PAGE
    assert PAGE.count(measure.BEGIN) == PAGE.count(measure.END) == 1
    assert KEPT["size"] == measure.Size()._asdict()


@pytest.mark.slow
def test_numbers_are_those_of_today():
    case = {"channel": "rho = 5", "sensor": "perfect", "attack": "replay=3"}
    assert measure.detection(measure.Size(), **case) == row(**case)


def test_what_the_page_says_in_words():
    usual = [one for one in KEPT["false_alarms"] if one["margin"] == measure.MARGIN]
    assert [one["alarms"] for one in usual] == [0] * 8
    less = [one["alarms"] for one in KEPT["false_alarms"][8:]]
    assert less[0] < less[1] < less[2]
    for attack in ("factor=3", "factor=1.5", "factor=-1"):
        assert row(channel="rho = 5", sensor="perfect", attack=attack)["moving"] <= 0.01
    for attack in ("factor=3", "factor=-1"):
        assert row(channel="rho = 5", sensor="0.1 m/s", attack=attack)["moving"] <= 0.5
    blind = row(channel="CAM, 10 % lost", attack="factor=1.5")
    assert blind["noticed"] == 0
    cruise = sum(lasts for lasts, acceleration in measure.CYCLE if not acceleration)
    assert f"cruises for {cruise:g} of {sum(lasts for lasts, _ in measure.CYCLE):g} s" in PAGE


@pytest.mark.slow
def test_the_command_makes_everything(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(measure, "QUIET", measure.QUIET[:1])
    monkeypatch.setattr(measure, "TIMED", measure.TIMED[:1])
    (tmp_path / "README.md").write_text(f"before\n{measure.BEGIN}\nold\n{measure.END}\nafter\n")
    assert measure.main(["-o", str(tmp_path)], SHORT) == 0
    printed = capsys.readouterr().out
    found = json.loads((tmp_path / "measured.json").read_text())
    assert printed == f"{measure.tables(found)}\n"
    page = (tmp_path / "README.md").read_text()
    assert page == f"before\n{measure.BEGIN}\n{printed}{measure.END}\nafter\n"
    assert len(found["detection"]) == len(measure.ATTACKS)


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert measure.main(["-o", str(tmp_path / "file")], SHORT) == 2
    assert capsys.readouterr().err.startswith("measure: ")
