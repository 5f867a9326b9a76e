"""Two predecessors on real nodes: every link has its topics, digest and bag as in simulation."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag2 import Reader

from cacc_platoon.bags.digest import run_digest
from cacc_platoon.report import report_run
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import simulate
from cacc_platoon.testing import Platoon
from msg_adapters.topics import Graph

HERE = Path(__file__).parent
PAPER_A = HERE.parents[1] / "config" / "paper_a.yaml"
TWO = (
    *("run.duration=6", "platoon.followers=4", "leader.start=1"),
    *("platoon.predecessors=2", "controller.law=own_parts:TwoAhead"),
)

Start = Callable[..., Platoon]
Replay = Callable[..., dict[str, Any]]


@pytest.fixture(autouse=True)
def own_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(HERE))


@pytest.mark.parametrize(("predecessors", "loss", "hosts"), [(2, 0.0, 2), (3, 0.3, 1)])
def test_one_digest_for_nodes_and_simulation(
    platoon: Start, predecessors: int, loss: float, hosts: int | str
) -> None:
    settings = (*TWO, f"platoon.predecessors={predecessors}", f"v2v.loss={loss}")
    run = platoon(*settings, hosts=hosts, environment={"PYTHONPATH": str(HERE)})
    result = run.result()
    assert result.exit_code == 0, result.errors
    scenario = load_scenario(PAPER_A, settings)
    trajectory, graph = simulate(scenario), Graph.of(scenario)
    assert result.digest == run_digest(recording_of(trajectory), graph), result.message
    with Reader(result.folder.bag) as reader:  # a second reader
        counts = {connection.topic: connection.msgcount for connection in reader.connections}
    for number, topics in enumerate(graph.links.values()):
        arrivals = trajectory.arrivals
        sent = len(arrivals[number].source) if arrivals else scenario.samples
        assert counts[topics.accel.name] == sent
    assert counts.get("/platoon/vehicle_3/v2v/from_1/accel")


def test_report_and_replay_know_every_link(platoon: Start, replay: Replay) -> None:
    run = platoon(*TWO, "v2v.loss=0.3", hosts="per_node", environment={"PYTHONPATH": str(HERE)})
    assert run.result().exit_code == 0
    expected = run_digest(recording_of(simulate(run.scenario)), Graph.of(run.scenario))
    assert run.result().digest == expected, run.result().message
    report = report_run(run.folder.path, runs=0).report
    assert report.run.findings == ()
    links = [(link.sender, link.follower) for link in report.measured.reception]
    assert links == [tuple(link) for link in run.scenario.topology.links]
    assert all(0.2 < link.loss < 0.4 for link in report.measured.reception)
    assert report.measured.noise[2].samples > 100
    assert "<td>1 to 3</td>" in (report.folder / "report.html").read_text()
    trusted = ("--scenario", str(run.folder.path / "scenario.yaml"))
    for node in ("vehicle", "noise_relay"):
        assert replay(run, 3, node, *trusted)["identical"] is True
