"""platoon sweep as its users meet it: one table, whatever happened on the way."""

import csv
import json
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from cacc_platoon.cli import main
from cacc_platoon.scenario import Scenario
from cacc_platoon.sweep import evaluate
from cacc_platoon.sweep.rows import ROWS_FILE

PLAN = """
format: 1
settings: {run.duration: 15.0, platoon.followers: 3}
matrix:
  controller.time_headway: [0.7, 0.95]
  v2v.rho: [3.0, 5.0, 9.0]
seeds: [1, 2]
criteria: [min_gap > 20, string_stable]
"""
ROWS = 12


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    file = tmp_path_factory.mktemp("plans") / "mine.yaml"
    file.write_text(PLAN)
    return file


@pytest.fixture(scope="module")
def study(plan, tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "one"
    assert main(["sweep", str(plan), "-o", str(folder), "--workers", "1"]) == 0
    return folder


def command(plan, folder, *more):
    return [sys.executable, "-m", "cacc_platoon", "sweep", str(plan), "-o", str(folder), *more]


def table_of(folder):
    with (folder / "table.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_the_table_has_the_numbers_of_every_scenario(study):
    rows = table_of(study)
    assert len(rows) == ROWS
    for row in (rows[0], rows[7], rows[-1]):
        values = {"run.duration": 15.0, "platoon.followers": 3}
        values |= {name: float(row[name]) for name in ("controller.time_headway", "v2v.rho")}
        one = evaluate(Scenario.from_values({**values, "run.seed": int(row["run.seed"])}))
        assert float(row["max_abs_spacing_error[-1]"]) == one.last_peak
        assert float(row["expected.max_abs_spacing_error[0]"]) == one.mean_first_peak
        assert float(row["min_gap"]) == one.min_gap
        assert row["string_stable"] == str(one.string_stable).lower()
        assert row["passed"] == str(one.string_stable and one.min_gap > 20).lower()
    found = json.loads((study / "summary.json").read_text())
    assert (found["rows"], found["evaluated"], found["failed"]) == (ROWS, ROWS, 0)
    stable = sum(row["string_stable"] == "true" for row in rows)
    assert 0 < stable < ROWS
    assert found["criteria"][1] == {
        "text": "string_stable",
        "met": stable,
        "missed": [k for k, row in enumerate(rows) if row["string_stable"] == "false"],
    }
    drawn = {path.name.partition("_")[2] for path in (study / "figures").iterdir()}
    assert {"string_stable.svg", "min_gap.svg"} <= drawn


@pytest.mark.slow
def test_processes_that_are_killed_at_any_moment_change_nothing(plan, study, tmp_path):
    draw, folder, kills = random.Random(2), tmp_path / "study", 0
    for _ in range(20):
        process = subprocess.Popen(
            command(plan, folder), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            process.wait(draw.uniform(0.5, 5.0))
            break
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            kills += 1
    assert kills
    assert subprocess.run(command(plan, folder), capture_output=True, check=False).returncode == 0
    assert (folder / "table.csv").read_bytes() == (study / "table.csv").read_bytes()
    lines = (folder / ROWS_FILE).read_text().splitlines()
    assert sorted(json.loads(line)["row"] for line in lines) == [*range(ROWS)]


def workers_of(pid):
    """Return the processes that a process has started, and theirs."""
    own = [int(one) for one in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return own + [one for child in own for one in workers_of(child)]


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_however_it_ends_its_processes_end_too(plan, tmp_path, number):
    process = subprocess.Popen(
        command(plan, tmp_path / "study", "--set", "run.duration=400"),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60.0
    while len(workers := workers_of(process.pid)) < 4 and time.monotonic() < deadline:
        pass
    process.send_signal(number)
    _, said = process.communicate(timeout=60.0)
    assert process.returncode == (130 if number == signal.SIGINT else -9)
    if number == signal.SIGINT:
        assert said == "platoon: interrupted\n"
    assert "Traceback" not in said
    deadline = time.monotonic() + 30.0
    while living := [pid for pid in workers if Path(f"/proc/{pid}/exe").exists()]:
        assert time.monotonic() < deadline, living


def test_the_same_study_goes_on_and_another_one_is_refused(plan, study, tmp_path, capsys):
    before = (study / "table.csv").read_bytes()
    junit = tmp_path / "criteria.xml"
    arguments = ["sweep", str(plan), "-o", str(study)]
    assert main([*arguments, "--check", "--junit", str(junit), "--json"]) == 3
    out, err = capsys.readouterr()
    assert err == f"platoon: {study}: has {ROWS} of {ROWS} rows already\n"
    found = json.loads(out)
    assert found == json.loads((study / "summary.json").read_text())
    assert (study / "table.csv").read_bytes() == before
    suites = {one.get("name"): one for one in ET.parse(junit).getroot()}
    assert suites["string_stable"].get("tests") == str(ROWS)
    assert suites["string_stable"].get("failures") == str(ROWS - found["criteria"][1]["met"])
    assert main([*arguments, "--set", "run.duration=16"]) == 2
    assert "holds another study (its fingerprint" in capsys.readouterr().err
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thing").write_text("")
    assert main(["sweep", str(plan), "-o", str(tmp_path / "full")]) == 2
    assert "holds no study" in capsys.readouterr().err


def test_parquet_is_the_same_table(plan, study):
    parquet = pytest.importorskip("pyarrow.parquet")
    assert main(["sweep", str(plan), "-o", str(study), "--parquet"]) == 0
    found = parquet.read_table(study / "table.parquet").to_pylist()
    for one, row in zip(found, table_of(study), strict=True):
        assert one["min_gap"] == float(row["min_gap"])
        assert one["verdict.headline"] == row["verdict.headline"]
        assert str(one["string_stable"]).lower() == row["string_stable"]


def test_rows_can_be_listed_and_a_misspelt_name_is_told_before_anything(plan, tmp_path, capsys):
    assert main(["sweep", str(plan), "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "0 (controller.time_headway=0.7, v2v.rho=3, run.seed=1)"
    assert len(lines) == ROWS
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(PLAN.replace("min_gap > 20", "min_gaps > 20"))
    assert main(["sweep", str(wrong), "-o", str(tmp_path / "study")]) == 2
    assert capsys.readouterr().err == (
        "platoon: wrong: min_gaps: there is no min_gaps among min_gap, sure_min_gap, "
        "min_gap_per_follower and others.\n"
    )
    assert not (tmp_path / "study").exists()
    assert main(["sweep", str(plan), "--workers", "0"]) == 2
    assert "--workers 0 is below 1" in capsys.readouterr().err


@pytest.mark.parametrize(
    "text",
    [
        "settings: {run.step: 0.03, run.duration: 15.0, platoon.followers: 2}\nseeds: [1]\n",
        "settings: {run.duration: 15.0, run.timeline: [14 link_1 v2v.loss=1]}\nseeds: [1]\n",
        "settings: {run.duration: 15.0}\nmatrix: {run.step: [0.07, 0.1]}\n",
        "seeds: [1]\nsettings: {run.duration: 12.0}\ncriteria: ['first_collision.time > 5']\n",
        "seeds: [1]\nsettings: {run.duration: 12.0}\ncriteria: ['monitor[0].alarms < 1']\n",
    ],
)
def test_what_a_short_run_cannot_show_is_no_reason_to_refuse_a_plan(tmp_path, text):
    (tmp_path / "plan.yaml").write_text(text)
    assert main(["sweep", str(tmp_path / "plan.yaml"), "--list"]) == 0


def test_what_cannot_be_written_is_refused_first(plan, tmp_path, capsys):
    folder = tmp_path / "study"
    junit = str(tmp_path / "nowhere" / "x.xml")
    for more, words in (
        (["--junit", junit], "there is no folder"),
        (["--workers", "2", "--backend", "run"], "one after the other"),
        (["--set", "run.seed=7"], "run.seed varies, and is set to 7 for all rows"),
    ):
        assert main(["sweep", str(plan), "-o", str(folder), *more]) == 2
        assert words in capsys.readouterr().err
    assert not folder.exists()
    folder.mkdir()
    (folder / "sweep.json.new").write_text("")  # a process was killed there
    assert main(["sweep", str(plan), "-o", str(folder), "--set", "run.duration=11"]) == 0


def test_a_row_that_cannot_be_is_a_row_with_its_reason(tmp_path, capsys):
    file = tmp_path / "plan.yaml"
    file.write_text(
        "settings: {run.duration: 12.0, platoon.followers: 2}\n"
        "matrix: {leader.profile: [sine, csv]}\ncriteria: [min_gap > 1]\n"
    )
    assert main(["sweep", str(file), "-o", str(tmp_path / "study"), "--check"]) == 3
    out = capsys.readouterr().out
    assert "plan: 2 rows, 1 meet every criterion, 0 do not, 1 failed" in out
    assert "failed: row 1 (leader.profile=csv): " in out
    rows = table_of(tmp_path / "study")
    assert [row["passed"] for row in rows] == ["true", "false"]
    assert "leader" in rows[1]["failed"]
    assert rows[1]["min_gap"] == ""
