"""Platoons grown piece by piece: 6 + 6 are 12, whatever the numbers begin with."""

from pathlib import Path

import numpy as np
import pytest

from cacc_platoon.analysis import analyse
from cacc_platoon.analysis.age import link_reception
from cacc_platoon.analysis.fallback import fallback_use
from cacc_platoon.bags.digest import topic_digest
from cacc_platoon.cli.simulate import simulate_run
from cacc_platoon.model import Topology
from cacc_platoon.report import metrics_document, summary
from cacc_platoon.runs.recorded_leader import with_recorded_leader
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.channel_presets import channel_settings
from cacc_platoon.scenario.file import load_scenario, parse_scenario
from cacc_platoon.scenario.parameter import ScenarioError
from cacc_platoon.simulation import monte_carlo, simulate
from cacc_platoon.supervision.host_plan import divide
from msg_adapters.topics import Graph

PAPER_A = Path(__file__).parents[2] / "config" / "paper_a.yaml"
SHORT = ("run.duration=15", "leader.start=1", "v2v.hold=0.02", "vehicle_9.controller.k_v=0.7")
REAR = ("platoon.followers=6", "platoon.first_follower=7", "leader.profile=bag")


@pytest.fixture(scope="module")
def rear(tmp_path_factory):
    """Vehicles 7 to 12 behind the recorded vehicle 6."""
    path = tmp_path_factory.mktemp("chaining")
    front = load_scenario(PAPER_A, [*SHORT[:-1], "platoon.followers=6"])
    simulate_run(front, path / "front")
    return with_recorded_leader(
        load_scenario(PAPER_A, [*SHORT, *REAR, f"leader.file={path}/front"])
    )


def test_six_and_six_are_twelve(rear):
    whole = recording_of(simulate(load_scenario(PAPER_A, SHORT)))
    grown = recording_of(simulate(rear))
    assert set(grown) == {
        topic.name for topic in Graph("/platoon", Topology(range(7, 13))).run_topics
    }
    assert len(grown) == 7 * 3 + 6
    for name, record in grown.items():
        assert topic_digest(record) == topic_digest(whole[name]), name


@pytest.mark.parametrize("channel", ["cam_lossy", "gilbert_tamu", "attacked"])
def test_two_and_two_are_four_where_packets_are_lost_late_or_false(channel, tmp_path):
    """Packets follow the motion of the recorded leader too, and fallbacks go on as in the whole."""
    dark = ("v2v.reception=fallback", "v2v.fallback_after=0.4", "v2v.blackouts=[3, 5]")
    settings = (*SHORT[:2], *channel_settings(channel), *dark)
    simulate_run(load_scenario(PAPER_A, [*settings, "platoon.followers=2"]), tmp_path / "front")
    behind = ("platoon.followers=2", "platoon.first_follower=3", "leader.profile=bag")
    file = f"leader.file={tmp_path}/front"
    rear = with_recorded_leader(load_scenario(PAPER_A, [*settings, *behind, file]))
    whole = simulate(load_scenario(PAPER_A, [*settings, "platoon.followers=4"]))
    grown = simulate(rear)
    np.testing.assert_array_equal(np.stack(grown.motion), np.stack(whole.motion)[:, :, 2:])
    assert link_reception(grown) == link_reception(whole)[2:]
    assert fallback_use(grown) == fallback_use(whole)[2:]
    assert fallback_use(grown)[0].turns > 0


def test_columns_are_those_of_the_whole(rear):
    whole, grown = simulate(load_scenario(PAPER_A, SHORT)), simulate(rear)
    assert (grown.spacing_error == whole.spacing_error[:, 6:]).all()


def test_noise_is_keyed_by_the_number_in_the_whole(rear):
    ensemble = monte_carlo(rear, 3)
    assert ensemble.max_abs_spacing_error[0] == pytest.approx(
        np.abs(simulate(rear).spacing_error).max(axis=0), rel=1e-12
    )


def test_the_report_names_the_right_vehicles_and_needs_no_other_bag(rear, tmp_path):
    path = tmp_path / "rear"
    simulate_run(rear, path)
    moved = Path(rear.leader.file).rename(tmp_path / "gone")
    try:
        report = analyse(path, runs=0)
    finally:
        moved.rename(rear.leader.file)
    assert [link.follower for link in report.measured.noise] == list(range(7, 13))
    assert [one.follower for one in report.verdict.followers] == list(range(7, 13))
    assert report.consistency.largest == 0.0
    assert report.run.findings == ()
    assert (report.expectation.position[:, 0] == report.run.trajectory.position[:, 0]).all()
    assert "        12   " in summary(report, metrics_document(report))


def test_hosts_and_nodes_have_the_numbers_of_the_whole(rear):
    names = [str(node) for group in divide(rear, cores=2) for node in group]
    assert names == rear.node_names
    assert (names[0], names[-1]) == ("vehicle_6/leader", "vehicle_12/noise_relay")


def test_values_belong_to_the_numbers_of_the_whole():
    values = {"platoon.followers": 2, "platoon.first_follower": 7, "vehicle.tau": [0.3, 0.4]}
    scenario = Scenario.from_values(values, {8: {"controller.k_v": 0.7}})
    assert [follower.index for follower in scenario.followers] == [7, 8]
    assert [follower.tau for follower in scenario.followers] == [0.3, 0.4]
    assert [follower.gains.k_v for follower in scenario.followers] == [0.63, 0.7]


def test_sections_are_for_the_numbers_of_the_whole():
    text = """
        /**: {ros__parameters: {platoon: {followers: 2, first_follower: 7}}}
        /platoon/vehicle_6/leader: {ros__parameters: {leader: {amplitude: 0.25}}}
        /platoon/*/vehicle: {ros__parameters: {controller: {k_v: 0.7}}}
    """
    scenario = parse_scenario(text, "scenario.yaml")
    assert scenario.leader.amplitude == 0.25
    assert sorted(scenario.overrides) == [7, 8]
    with pytest.raises(ScenarioError, match="section /platoon/vehicle_0/leader is for no node"):
        parse_scenario(text.replace("vehicle_6", "vehicle_0"), "scenario.yaml")


@pytest.mark.parametrize(
    ("values", "overrides", "message"),
    [
        ({"platoon.first_follower": 0}, {}, "platoon.first_follower = 0 must be >= 1 and <= 500"),
        ({"platoon.first_follower": 490}, {}, "vehicle_501 the last of 12 followers, beyond 500"),
        ({"platoon.first_follower": 7}, {6: {"vehicle.tau": 0.4}}, "followers 7 to 18"),
        ({"leader.profile": "bag"}, {}, "leader.file = '' must name a file when profile is bag"),
    ],
)
def test_numbers_that_cannot_be_are_refused(values, overrides, message):
    with pytest.raises(ScenarioError, match=message):
        Scenario.from_values(values, overrides)
