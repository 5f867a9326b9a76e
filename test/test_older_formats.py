"""What older software wrote is still read; what newer software will write is refused in one line.

test/data/format_0 was written by the last software without versions: a run on nodes, a run that was
killed, and a scenario file with a name of then.
"""

import json
import shutil
from pathlib import Path

import pytest

from cacc_platoon.cli import main
from cacc_platoon.runs.info import EndStatus, InfoError, RunInfo
from cacc_platoon.runs.locate import locate
from cacc_platoon.runs.recorded_leader import with_recorded_leader
from cacc_platoon.runs.recorded_run import read_run
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario, load_scenario, scenario_version
from cacc_platoon.simulation import simulate

OLD = Path(__file__).parent / "data" / "format_0"
DIGEST = "2ab307fc085c81a3e4ffecea87567a952b770934aeb9b5874ebbae79f239c66a"
KILLED_DIGEST = "71188287a3c9b7195c605033cc2154ca2525e4cb4ee4ffc0556a1086369c81e7"
"""As the software that wrote the files recorded them, the second one in its report."""
HEADLINE = "# cacc_platoon scenario, format "


@pytest.fixture
def old_run(tmp_path):
    return shutil.copytree(OLD / "run", tmp_path / "run")


def refusal(capsys, *arguments):
    """Return the one line with which a command refuses its input."""
    assert main([*map(str, arguments)]) == 2
    out, error = capsys.readouterr()
    assert out == ""
    [line] = error.splitlines()
    return line


def read(folder: Path) -> RunInfo:
    """Return what a run.json that has to be there says."""
    info = RunInfo.read(folder)
    assert info
    return info


def test_the_data_is_of_format_0():
    assert "format" not in json.loads((OLD / "run" / "run.json").read_text())
    text = (OLD / "run" / "scenario.yaml").read_text()
    assert scenario_version(text, "scenario.yaml") == 0
    assert "cacc_platoon_format" not in (OLD / "run" / "bag" / "metadata.yaml").read_text()
    [index] = (OLD / "killed" / "parts").rglob("topics.json")
    assert isinstance(json.loads(index.read_text()), list)


def test_an_old_run_is_reported_with_the_same_digest(old_run, capsys):
    assert main(["report", str(old_run), "--json"]) == 0
    metrics = json.loads(capsys.readouterr().out)
    assert metrics["findings"] == []
    provenance = metrics["provenance"]
    assert (provenance["digest"], provenance["digest_recorded"]) == (DIGEST, DIGEST)
    assert (provenance["status"], provenance["seed"]) == ("finished", 7)
    assert provenance["recorded_with"]["cacc_platoon"] == "0.1.0"
    assert metrics["consistency"]["departures"] == []


def test_an_old_run_is_what_its_scenario_gives_today(old_run, tmp_path):
    scenario = old_run / "scenario.yaml"
    assert main(["simulate", str(scenario), "-o", str(tmp_path / "again"), "--runs", "0"]) == 0
    assert read(tmp_path / "again").digest == DIGEST


def test_an_old_run_json_keeps_what_it_says(old_run):
    info, then = read(old_run), json.loads((old_run / "run.json").read_text())
    assert info.status == EndStatus.FINISHED
    assert info.hosts[0].nodes[1] == "vehicle_0/leader"
    now = info.to_json()
    for host in now["hosts"]:
        assert (host.pop("machine"), host.pop("part")) == ("", "")
    assert {name: now[name] for name in then} == then
    assert now.keys() - then.keys() == {"format", "pid", "began", "clock_offsets", "run"}


def test_an_old_run_that_was_killed_is_finished(tmp_path):
    killed = shutil.copytree(OLD / "killed", tmp_path / "killed")
    run = read_run(*locate(killed))
    assert run.digest == KILLED_DIGEST
    assert run.findings[0].startswith("the run failed: its process was killed; this is what")
    info = read(killed)
    assert (info.status, info.digest) == (EndStatus.FAILED, KILLED_DIGEST)
    assert info.messages["/old/vehicle_2/accel"] == 7  # the last one was cut short


def test_an_old_run_leads_another(old_run):
    chained = with_recorded_leader(
        Scenario.from_values(
            {
                "platoon.initial_speed": 20.0,
                "platoon.first_follower": 3,
                "platoon.followers": 1,
                "platoon.namespace": "/old",
                "leader.profile": "bag",
                "leader.file": str(old_run),
                "run.step": 0.02,
                "run.duration": 0.2,
            }
        )
    )
    led = simulate(chained)
    assert (
        led.acceleration[:, 0] == read_run(*locate(old_run)).trajectory.acceleration[:, 2]
    ).all()


def test_an_old_run_has_layouts(old_run, capsys):
    assert main(["layout", str(old_run), "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["layouts"]) == 4


def test_an_old_scenario_file_has_the_name_of_then():
    scenario = load_scenario(OLD / "by_hand.yaml")
    assert scenario.run.manual_nodes == ("vehicle_2/vehicle",)


def test_what_is_written_now_says_its_version(tmp_path, bags):
    run = bags.run(tmp_path / "run", bags.scenario()).path
    text = (run / "scenario.yaml").read_text()
    assert scenario_version(text, "scenario.yaml") == 1
    assert json.loads((run / "run.json").read_text())["format"] == 1
    assert "cacc_platoon_format: '1'" in (run / "bag" / "metadata.yaml").read_text()
    copies = [line for line in (run / "bag" / "bag.mcap").read_bytes().split(b"\n")]
    assert f"{HEADLINE}1".encode() in copies


@pytest.mark.parametrize(
    ("file", "says", "newer", "line"),
    [
        ("run.json", '"format": 1', '"format": 2', "run.json: format 2 of run.json is newer"),
        ("bag/metadata.yaml", "_format: '1'", "_format: '2'", "bag: format 2 of bag is newer"),
        ("bag/metadata.yaml", "_format: '1'", "_format: b", "bag: format = 'b' must be a whole"),
    ],
)
def test_newer_files_of_a_run_are_refused(run_folder, capsys, *, file, says, newer, line):
    path = run_folder / file
    text = path.read_text()
    assert text.count(says) == 1
    path.write_text(text.replace(says, newer))
    assert line in refusal(capsys, "report", run_folder)


def test_a_newer_scenario_in_a_bag_is_refused(bags, tmp_path, capsys, monkeypatch):
    scenario = bags.scenario()
    newer = format_scenario(scenario).replace(f"{HEADLINE}1", f"{HEADLINE}7")
    bag = tmp_path / "bag"
    with monkeypatch.context() as patch:
        patch.setitem(bags.bag.__globals__, "format_scenario", lambda _: newer)
        bags.bag(bag, scenario, bags.record(scenario))
    line = refusal(capsys, "report", bag)
    assert f"{bag}: /platoon/scenario: format 7 of cacc_platoon scenario is newer than 1" in line


def test_a_newer_scenario_file_is_refused_before_anything_starts(tmp_path, capsys):
    file = tmp_path / "newer.yaml"
    file.write_text(f"# Mine\n\n{HEADLINE}2\n/**: {{ros__parameters: {{platoon: {{n: 2}}}}}}\n")
    for verb in ("simulate", "run", "layout"):
        assert "newer.yaml: format 2 of cacc_platoon scenario is newer" in refusal(
            capsys, verb, file
        )


def test_a_newer_part_of_a_killed_run_is_refused(tmp_path, capsys):
    killed = shutil.copytree(OLD / "killed", tmp_path / "killed")
    index = killed / "parts" / "0" / "topics.json"
    index.write_text(json.dumps({"format": 2, "topics": []}))
    assert "topics.json: format 2 of topics.json of a part is newer" in refusal(
        capsys, "report", killed
    )


@pytest.mark.parametrize(
    ("text", "version"),
    [
        (f"{HEADLINE}1\n/**: {{}}\n", 1),
        (f"# Scenario a\n{HEADLINE}1\n", 1),
        (f"# Scenario a\r\n{HEADLINE}1\r\n/**: {{}}\r\n", 1),
        ("/**: {}\n", 0),
        ("", 0),
        (f"/**: {{}}\n{HEADLINE}9\n", 0),  # not in the head
        (f"a: '\n{HEADLINE}9\n'\n", 0),
        (f"#{HEADLINE}9\n", 0),
    ],
)
def test_the_version_of_a_scenario_is_a_comment_in_its_head(text, version):
    assert scenario_version(text, "my.yaml") == version


@pytest.mark.parametrize(
    "document",
    [
        [],
        "finished",
        {},
        {"status": "perhaps"},
        {"status": "finished", "hosts": [{"name": "0"}]},
        {"status": "finished", "hosts": [{"name": "0", "pid": "x", "nodes": []}]},
        {"status": "finished", "hosts": [{"name": "0", "pid": 1, "nodes": "vehicle"}]},
        {"status": "finished", "messages": [1]},
        {"status": "finished", "samples": "many"},
    ],
)
def test_a_damaged_run_json_is_named_and_the_bag_read_without_it(run_folder, document):
    with pytest.raises(InfoError):
        RunInfo.from_json(document)
    (run_folder / "run.json").write_text(json.dumps(document))
    run = read_run(run_folder / "bag", run_folder)
    assert run.info is None
    assert run.findings == ("run.json is damaged and left out",)
