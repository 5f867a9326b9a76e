"""The standing of the data is told beside the verdict: any single value that is changed is seen."""

import dataclasses
import json
import math
import re
import shutil

import numpy as np
import pytest

from cacc_platoon.analysis import DataState, analyse, check_consistency, check_leader, check_links
from cacc_platoon.analysis.consistency import TOLERANCE
from cacc_platoon.bags.digest import run_digest
from cacc_platoon.runs.folder import RunFolder
from cacc_platoon.runs.info import EndStatus, RunInfo
from cacc_platoon.simulation import Arrivals, simulate
from msg_adapters.topics import Graph

LAST = 300
SETTINGS = {
    "ideal": {},
    "lossy": {"v2v.loss": 0.3},
}


@pytest.fixture(scope="module", params=SETTINGS)
def recorded(request, bags):
    scenario = bags.scenario(SETTINGS[request.param])
    return scenario, bags.record(scenario)


def topics_of(scenario):
    return {topic.name: topic for topic in Graph.of(scenario).recorded}


def changed(bags, recording, topic, row, by):
    def change(values):
        values[row] += by
        return values

    return bags.rewritten(recording, topic, change)


def plant(bags, recorded, kind, where, by=1e-6):
    """Return the recording with one value of a topic changed, at the first, a middle, the last."""
    scenario, recording = recorded
    topic = topics_of(scenario)[f"/platoon/{kind}"]
    rows = len(recording[topic.name].messages)
    return changed(bags, recording, topic, {"first": 0, "middle": rows // 2, "last": -1}[where], by)


KINDS = [
    *(f"vehicle_{i}/{quantity}" for i in (0, 2, 3) for quantity in ("pose", "twist", "accel")),
    *(f"vehicle_{i}/v2v/accel" for i in (1, 3)),
]


@pytest.mark.slow
@pytest.mark.parametrize("where", ["first", "middle", "last"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_single_changed_value_is_seen_without_a_digest(bags, tmp_path, recorded, kind, where):
    """A millionth of a metre, of a metre per second, of a metre per second squared."""
    bag = bags.bag(tmp_path / "bag", recorded[0], plant(bags, recorded, kind, where))
    report = analyse(bag, runs=0)
    assert report.standing.state is DataState.UNLIKE
    assert not report.proven
    assert "no digest was written" in report.standing.line
    assert re.search(
        r"departs from the scenario's first at vehicle \d at [\d.]+ s by [\d.]+e-0\d",
        report.standing.line,
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_single_changed_value_is_seen_by_the_digest(bags, tmp_path, recorded, kind):
    """However small: the last bit."""
    scenario, recording = recorded
    digest = {"digest": run_digest(recording, Graph.of(scenario))}
    altered = plant(bags, recorded, kind, "middle", by=1e-13)
    report = analyse(bags.bag(tmp_path / "bag", scenario, altered, digest), runs=0)
    assert report.standing.state is DataState.ALTERED
    assert report.verdict.certified
    assert not report.proven
    assert report.headline == "STRING STABLE, DATA ALTERED"


@pytest.mark.parametrize("where", ["first", "middle"])
def test_a_changed_count_is_seen(bags, tmp_path, where):
    """A count that is one too large moves a delivery by one sample."""
    scenario = bags.scenario({"v2v.loss": 0.3})
    recorded = scenario, bags.record(scenario)
    altered = plant(bags, recorded, "vehicle_2/v2v/complete", where, by=1.0)
    report = analyse(bags.bag(tmp_path / "bag", scenario, altered), runs=0)
    assert not report.proven


@pytest.mark.slow
def test_a_whole_bag_without_digest_stands_by_its_scenario(bags, tmp_path, recorded):
    report = analyse(bags.bag(tmp_path / "bag", *recorded), runs=0)
    assert report.standing.state is DataState.INTACT
    assert "no digest was written, but leader, links and followers do what" in report.standing.line
    assert "changes below 1e-09" in report.standing.unchecked[0]
    assert report.proven
    assert report.headline == "STRING STABLE, DATA INTACT"
    assert {one.largest for one in report.recomputed} == {0.0}


def test_what_the_digest_covers_stands_by_it(whole_run):
    report = analyse(whole_run, runs=0)
    assert report.standing.state is DataState.INTACT
    assert report.standing.line == "complete, with the digest that was written when the run ended"
    assert report.standing.unchecked == ()


def test_each_check_sees_its_own_topics(scenario):
    """What one of them cannot see: a leader's last pose, say, enters no follower's step."""
    run = simulate(scenario)
    run.position[LAST, 0] += 1.0
    run.received[LAST, 1] += 0.1
    assert check_consistency(run).largest == 0.0
    assert check_leader(run).departures == ((0, 3.0, 1.0),)
    [(vehicle, time, difference)] = check_links(run).departures
    assert (vehicle, time) == (2, 3.0)
    assert difference == pytest.approx(0.1)


@pytest.mark.parametrize("harm", ["lost", "late", "invented"])
def test_a_packet_that_arrives_otherwise_than_is_due_is_a_departure(bags, harm):
    run = simulate(bags.scenario({"v2v.loss": 0.3}))
    assert run.arrivals
    first, link, *rest = run.arrivals
    source, at = link.source, link.sample.copy()
    if harm == "late":
        at[100] += 1
        other = link._replace(sample=at)
    elif harm == "lost":
        other = Arrivals(np.delete(source, 100), np.delete(at, 100), np.delete(link.value, 100))
    else:
        gap = int(np.setdiff1d(np.arange(LAST), source)[0])
        other = Arrivals(
            *(np.append(part, new) for part, new in zip(link, (gap, gap, 0.1), strict=True))
        )
    harmed = dataclasses.replace(run, arrivals=(first, other, *rest))
    [(vehicle, _, difference)] = check_links(harmed).departures
    assert (vehicle, difference) == (2, math.inf)


def test_rounding_is_no_departure(scenario):
    run = simulate(scenario)
    run.position[150] += 1e-3 * TOLERANCE
    run.received[150] += 1e-3 * TOLERANCE
    for check in (check_leader, check_links, check_consistency):
        found = check(run)
        assert 0.0 < found.largest < TOLERANCE or check is check_links
        assert found.departures == ()


@pytest.mark.parametrize(
    ("status", "state", "headline"),
    [
        ("failed", DataState.FAILED, "STRING STABLE, RUN FAILED"),
        ("interrupted", DataState.CUT, "STRING STABLE, DATA CUT SHORT"),
    ],
)
def test_a_run_that_did_not_finish(run_folder, status, state, headline):
    file = run_folder / "run.json"
    info = {**json.loads(file.read_text()), "status": status, "message": "SIGINT"}
    file.write_text(json.dumps(info))
    report = analyse(run_folder, runs=0)
    assert (report.standing.state, report.headline) == (state, headline)
    assert report.standing.line.endswith(": SIGINT")
    assert report.verdict.certified
    assert not report.proven


def test_the_bag_of_a_run_that_failed_says_so_by_itself(bags, tmp_path, scenario, recording):
    failed = RunFolder.create(tmp_path / "failed", scenario)
    info = RunInfo(EndStatus.FAILED, "vehicle_2 stopped")
    failed.finish(scenario, recording, info)
    shutil.move(failed.bag, tmp_path / "alone")
    report = analyse(tmp_path / "alone", runs=0)
    assert (report.standing.state, report.proven) == (DataState.FAILED, False)
    assert report.standing.line == "the run failed: vehicle_2 stopped"


def test_copies_of_the_scenario_that_differ_are_told(bags, tmp_path, scenario):
    folder = bags.run(tmp_path / "run", scenario).path
    text = (folder / "scenario.yaml").read_text()
    (folder / "scenario.yaml").write_text(text.replace("tau_max: 0.5", "tau_max: 0.3"))
    report = analyse(folder, runs=0)
    assert report.proven
    assert "scenario.yaml is not the scenario in the bag, which is judged" in report.run.findings
    (storage,) = (folder / "bag").glob("*.mcap")
    storage.write_bytes(storage.read_bytes().replace(b"tau_max: 0.5", b"tau_max: 0.3"))
    report = analyse(folder, runs=0)
    assert report.standing.state is DataState.ALTERED
    assert "not the one that metadata.yaml has" in report.standing.line


@pytest.mark.parametrize("custom", [{}, {"digest": "0" * 64}], ids=["without digest", "with"])
def test_a_run_that_was_cut(bags, tmp_path, scenario, recording, custom):
    """All topics end early, or one of them does."""
    for names in (recording, ["/platoon/vehicle_2/pose"]):
        cut = recording
        for name in names:
            cut = bags.edited(cut, name, lambda rows: rows[:250])
        bag = bags.bag(tmp_path / f"bag{len(names)}", scenario, cut, custom)
        report = analyse(bag, runs=0)
        whole = custom and len(names) == 1
        assert report.standing.state is (DataState.ALTERED if whole else DataState.CUT)
        assert not report.proven


def test_custom_code_and_the_motion_of_another_bag_cannot_be_checked(bags, tmp_path, scenario):
    own = {"v2v.channel": "nowhere:Channel", "controller.law": "nowhere:Law"}
    harmless = bags.scenario({"v2v.loss": 0.2})
    bag = bags.bag(tmp_path / "own", harmless.with_values(own), bags.record(harmless))
    report = analyse(bag, runs=0)
    assert report.standing.state is DataState.UNCHECKED
    assert "what the custom channel nowhere:Channel did" in report.standing.line
    assert "what the custom control law nowhere:Law did" in report.standing.line
    led = scenario.with_values(
        {"leader.profile": "bag", "leader.file": "gone", "leader.digest": "a"}
    )
    report = analyse(bags.bag(tmp_path / "led", led, bags.record(scenario)), runs=0)
    assert report.standing.state is DataState.UNCHECKED
    assert "the leader's motion, which is that of another bag" in report.standing.line
    assert report.headline == "STRING STABLE, DATA UNCHECKED"


def test_topics_for_viewers_are_named_as_unchecked(bags, tmp_path):
    shown = bags.scenario({"record.command": True, "record.spacing_error": True})
    report = analyse(bags.run(tmp_path / "run", shown).path, runs=0)
    assert report.proven
    assert report.standing.unchecked[0].startswith("command and spacing_error: recorded for")


def test_a_second_publisher_keeps_data_without_digest_from_standing(bags, tmp_path, recorded):
    scenario, recording = recorded
    topic = topics_of(scenario)["/platoon/vehicle_2/pose"]
    other = changed(bags, recording, topic, 150, 1.0)[topic.name].messages[150:151]
    mixed = bags.edited(recording, topic.name, lambda rows: np.insert(rows, 151, other, axis=0))
    report = analyse(bags.bag(tmp_path / "bag", scenario, mixed), runs=0)
    assert report.standing.state is DataState.UNCHECKED
    assert "the messages have faults" in report.standing.line
