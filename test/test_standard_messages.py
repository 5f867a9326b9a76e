"""examples/standard_messages: page, numbers, figure and scenario are what its command makes."""

import json
import shlex
import sys
from pathlib import Path

import pytest

from cacc_platoon.cli import main as platoon
from cacc_platoon.scenario.file import load_scenario

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "examples" / "standard_messages"
sys.path.insert(0, str(FOLDER))

import compute  # noqa: E402  (the folder of the example is no package)
import one_link  # noqa: E402
import show  # noqa: E402
import study  # noqa: E402

KEPT = json.loads((FOLDER / "study.json").read_text())
PAGE = (FOLDER / "README.md").read_text()
SHORT = compute.Size(followers=2, sine=11.0, brake=11.0, periods=(0.01, 0.2))


def rows_of(design):
    [found] = [one for one in KEPT["designs"] if one["name"] == design.name]
    return {row["channel"]: row for row in found["rows"]}


def test_the_page_has_the_tables_of_the_numbers():
    assert show.with_tables(PAGE, KEPT) == PAGE
    assert PAGE.count(show.BEGIN) == PAGE.count(show.END) == 1


@pytest.mark.parametrize("key", ["gap", "gap_mean", "theory", "theory_noisy", "hardest"])
def test_a_wrong_number_changes_the_page(key):
    wrong = json.loads(json.dumps(KEPT))
    wrong["designs"][0]["rows"][2][key] += 10.0
    assert show.with_tables(PAGE, wrong) != PAGE


def test_the_designs_are_those_that_are_chosen_today():
    today = [*compute.paper_designs(), *map(compute.our_design, (True, False))]
    for one, kept in zip(today, KEPT["designs"], strict=True):
        assert (one.name, one.origin) == (kept["name"], kept["origin"])
        assert one.gains._asdict() == pytest.approx(kept["gains"], abs=1e-6)


def test_the_command_that_the_page_shows_makes_our_design(tmp_path):
    kept = KEPT["designs"][2]
    _, *arguments = shlex.split(kept["origin"].strip("`"))
    assert platoon([*arguments, "--write", str(tmp_path / "mine.yaml")]) == 0
    gains = load_scenario(tmp_path / "mine.yaml").follower(1).gains
    assert gains._asdict() == pytest.approx(kept["gains"], abs=1e-6)


@pytest.mark.parametrize("name", ["CAM, 10 % lost", "blackout, fallback after 1.2 s"])
def test_numbers_of_case_a_are_those_of_today(name):
    case_a = compute.paper_designs()[0]
    [channel] = [one for one in compute.channels() if one.name == name]
    found, kept = compute.row(case_a, channel, compute.Size()), rows_of(case_a)[name]
    for key in ("theory", "theory_noisy", "gap", "gap_mean", "sine", "brake", "hardest"):
        if kept[key] is not None:
            assert found[key] == pytest.approx(kept[key], rel=1e-5), key
    assert found["nearest"] == pytest.approx(kept["nearest"], abs=2e-3)


def test_what_the_page_says_in_words():
    a, c, same, longer = KEPT["designs"]
    ideal, cam, lossy, hold, zero, late, soon = range(7)
    rows = [one["rows"] for one in (a, c, same, longer)]
    assert all(one[way]["sine"]["hop"] <= 1.0 for one in rows for way in (ideal, cam, lossy))
    assert all(one[ideal]["theory_noisy"] == 1.0 for one in rows)
    assert all(one[ideal]["brake"]["hop"] <= 1.0 for one in rows)
    assert [one[lossy]["brake"]["hop"] <= 1.0 for one in rows] == [False, False, False, True]
    assert all(one[way]["gap"] > 0.0 for one in rows for way in (ideal, cam, lossy, soon))
    assert all(one[cam]["theory"] == 1.0 < one[cam]["theory_noisy"] for one in rows[:2])
    assert rows[0][lossy]["theory"] == 1.0 < rows[1][lossy]["theory"]
    assert all(one[lossy]["theory_noisy"] == 1.0 for one in rows[2:])
    assert [one[hold]["gap"] > 0.0 for one in rows] == [False, False, False, True]
    assert [one[late]["gap"] > 0.0 for one in rows] == [False, False, True, True]
    assert all(one[zero]["gap"] == pytest.approx(one[hold]["gap"], abs=0.01) for one in rows)
    assert all(one[late]["gap"] > one[hold]["gap"] for one in rows)
    assert round(min(one[hold]["gap"] for one in rows)) == -14
    assert all(one[late]["gap"] > -1.0 for one in rows)
    assert rows[1][soon]["gap"] < 0.1
    assert a["gains"]["time_headway"] == same["gains"]["time_headway"]
    assert same["gains"]["k_p"] > a["gains"]["k_p"]
    assert same["gains"]["k_a"] < a["gains"]["k_a"]


def test_of_one_silent_link_the_page_has_the_numbers_of_today():
    found = one_link.rows()
    made = f"{one_link.BEGIN}\n{one_link.table(found)}\n{one_link.END}"
    assert PAGE.count(made) == PAGE.count(one_link.BEGIN) == 1
    gaps = {(one.motion, one.reception): one.gap for one in found}
    assert all(gaps[motion, "fallback"] > 0.5 for motion in one_link.MOTIONS)
    assert max(gaps["brake", "hold"], gaps["brake", "zero"]) < -10.0
    assert min(gap for (motion, _), gap in gaps.items() if motion == "sine") > 20.0
    errors = {(one.motion, one.reception): one.error for one in found}
    assert errors["sine", "fallback"] > max(errors["sine", "hold"], errors["sine", "zero"])


def test_the_command_puts_it_into_the_page(tmp_path, monkeypatch, capsys):
    page = tmp_path / "README.md"
    page.write_text(f"before\n{one_link.BEGIN}\nold\n{one_link.END}\nafter\n")
    row = one_link.Row("brake", "hold", -0.5, 3, 1.25)
    monkeypatch.setattr(one_link, "PAGE", page)
    monkeypatch.setattr(one_link, "rows", lambda: [row])
    assert one_link.main() == 0
    made = capsys.readouterr().out
    assert "| brake | hold | **-0.50 m** | 3 | 1.25 m |" in made
    assert page.read_text() == f"before\n{one_link.BEGIN}\n{made}{one_link.END}\nafter\n"


def test_the_scenario_is_the_one_that_was_simulated():
    assert load_scenario(FOLDER / "blackout.yaml") == compute.runnable(KEPT)


def test_the_figure_is_small_and_follows_from_the_numbers():
    kept = FOLDER / "study.svg"
    assert kept.stat().st_size < 200_000
    drawn = show.figure(KEPT)
    assert all(text in drawn for text in ("case A", "case C", "ours, headway of A", "collision"))


def test_the_command_makes_everything(tmp_path, capsys):
    (tmp_path / "README.md").write_text(f"before\n{show.BEGIN}\nold\n{show.END}\nafter\n")
    assert study.main(["-o", str(tmp_path), "--json"], SHORT, workers=1) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "study.json").read_text())
    page = (tmp_path / "README.md").read_text()
    assert page == f"before\n{show.BEGIN}\n{show.tables(printed)}\n{show.END}\nafter\n"
    assert {path.name for path in tmp_path.iterdir()} == {
        *("README.md", "blackout.yaml", "study.json", "study.svg")
    }


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert study.main(["-o", str(tmp_path / "file")], SHORT, workers=1) == 2
    assert capsys.readouterr().err.startswith("study: ")
