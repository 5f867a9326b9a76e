"""One scenario and seed, one digest: whatever the processes, the load or the order."""

import hashlib
import random
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

from cacc_platoon.bags.digest import run_digest, topic_digest
from cacc_platoon.model import Topology
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import simulate
from cacc_platoon.testing import Platoon
from msg_adapters.topics import Graph

PAPER_A = Path(__file__).parents[2] / "config" / "paper_a.yaml"
SHORT = ("run.duration=10", "leader.start=1")
SMALL = (*SHORT, "platoon.followers=3")
LISTENER = Path(__file__).with_name("listener.py")

Start = Callable[..., Platoon]


def simulated_digest(scenario: Scenario) -> str:
    recording = recording_of(simulate(scenario))
    return run_digest(recording, Graph.of(scenario))


def bag_digests(bag: Path) -> dict[str, str]:
    """Hash every vehicle's topics as they stand in the bag."""
    hashes: dict[str, hashlib._Hash] = defaultdict(hashlib.sha256)
    with Reader(bag) as reader:
        for connection, _, data in reader.messages():
            if "vehicle_" in connection.topic:
                hashes[connection.topic].update(data)
    return {name: value.hexdigest() for name, value in hashes.items()}


@pytest.fixture(scope="module")
def expected() -> str:
    return simulated_digest(load_scenario(PAPER_A, SMALL))


@pytest.mark.parametrize("hosts", [1, 2, "per_node"])
def test_number_of_processes_does_not_matter(platoon: Start, hosts: object) -> None:
    result = platoon(*SHORT, hosts=hosts).result()
    assert result.exit_code == 0, result.errors
    expected = simulated_digest(load_scenario(PAPER_A, SHORT))
    assert result.digest == expected, result.message
    assert result.info
    assert len(result.info.hosts) == (25 if hosts == "per_node" else hosts)
    topics = {topic.name for topic in Graph("/platoon", Topology(range(1, 13))).run_topics}
    assert result.info.messages == dict.fromkeys(topics, 1001)


def test_load_does_not_matter(platoon: Start, expected: str) -> None:
    busy = "import hashlib\nwhile True: hashlib.sha256(b'x' * 100_000).digest()"
    burners = [subprocess.Popen([sys.executable, "-c", busy]) for _ in range(4)]
    try:
        result = platoon(*SMALL).result()
        assert all(burner.poll() is None for burner in burners)
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()
    assert (result.status, result.digest) == ("finished", expected), result.message


def test_frozen_nodes_are_waited_for(platoon: Start, expected: str) -> None:
    run = platoon(*SMALL, "run.real_time_factor=2", hosts="per_node")
    nodes = ("vehicle_0/leader", "vehicle_2/vehicle", "vehicle_2/noise_relay", "vehicle_3/vehicle")
    for sample, node in zip((100, 250, 400, 550), nodes, strict=True):
        run.wait_sample(sample)
        run.freeze(node, seconds=1.0)
    result = run.result()
    assert (result.status, result.digest) == ("finished", expected), result.message


def test_a_frozen_supervisor_is_waited_for(platoon: Start, expected: str) -> None:
    """However long: it cannot take its own absence for a stall of the others."""
    run = platoon(*SMALL, "run.real_time_factor=2", "run.stall_timeout=1.5", hosts=2)
    run.wait_sample(100)
    run.freeze("supervisor", seconds=3.0)
    result = run.result()
    assert (result.status, result.digest) == ("finished", expected), result.message


def test_garbage_on_the_heap_does_not_matter(platoon: Start, expected: str) -> None:
    result = platoon(*SMALL, environment={"MALLOC_PERTURB_": "165"}).result()
    assert result.digest == expected, result.message


def test_the_pace_does_not_matter(platoon: Start) -> None:
    settings = ("run.duration=4", "run.real_time_factor=2", "platoon.followers=3")
    result = platoon(*settings).result()
    assert result.digest == simulated_digest(load_scenario(PAPER_A, settings)), result.message
    assert result.info
    assert result.info.real_time_factor == pytest.approx(2.0, rel=0.1)


def test_nodes_started_manually_in_any_order(platoon: Start) -> None:
    settings = ("run.duration=5", "platoon.followers=2")
    run = platoon(*settings, "run.spawn=false")
    nodes = list(run.scenario.node_names)
    random.Random(5).shuffle(nodes)
    for node in nodes:
        run.start(node)
        run.wait_node(node)
    result = run.result()
    assert result.exit_code == 0, result.errors
    assert result.digest == simulated_digest(load_scenario(PAPER_A, settings)), result.message


def test_manual_nodes_may_record_themselves(platoon: Start, tmp_path: Path) -> None:
    settings = ("run.duration=5", "platoon.followers=2")
    run = platoon(*settings, "run.spawn=false", f"record.parts={tmp_path / 'parts'}")
    for node in run.scenario.node_names:
        run.start(node, parameters=[f"record:={tmp_path / 'parts'}"])
    result = run.result()
    assert result.digest == simulated_digest(load_scenario(PAPER_A, settings)), result.message
    assert result.info
    assert {host.name for host in result.info.hosts} == {
        node.replace("/", "_") for node in run.scenario.node_names
    }


def test_what_is_asked_for_is_recorded_of_manual_nodes_too(platoon: Start) -> None:
    settings = ("run.duration=3", "platoon.followers=2", "record.command=true")
    run = platoon(*settings, "run.manual_nodes=[vehicle_2/vehicle]")
    run.start("vehicle_2/vehicle")
    result = run.result()
    assert result.info
    assert result.info.messages["/platoon/vehicle_1/command"] == 301
    assert result.info.messages["/platoon/vehicle_2/command"] == 301


def test_another_seed_gives_another_run(platoon: Start) -> None:
    settings = ("run.duration=3", "leader.start=1", "platoon.followers=2")
    found = platoon(*settings, "run.seed=2").result().digest
    assert found == simulated_digest(load_scenario(PAPER_A, [*settings, "run.seed=2"]))
    assert found != simulated_digest(load_scenario(PAPER_A, settings))


def test_a_gain_of_one_vehicle_changes_what_is_downstream(platoon: Start) -> None:
    common = load_scenario(PAPER_A, SMALL)
    changed = platoon(*SMALL, "vehicle_2.controller.k_v=0.7").result()
    assert changed.status == "finished", changed.message
    reference = {
        name: topic_digest(record) for name, record in recording_of(simulate(common)).items()
    }
    for name, found in bag_digests(changed.folder.bag).items():
        index = int(name.split("vehicle_")[1].split("/")[0])
        upstream = index < 2 or (index == 2 and "v2v" in name)
        assert (found == reference[name]) == upstream, name


def test_an_outside_subscriber_sees_the_same_bits(platoon: Start, tmp_path: Path) -> None:
    settings = (
        *("run.duration=6", "platoon.followers=3"),
        "run.manual_nodes=[vehicle_1/noise_relay]",
    )
    run = platoon(*settings, "run.real_time_factor=2", hosts=2)
    ready, digest = tmp_path / "ready", tmp_path / "digest"
    command = [sys.executable, str(LISTENER), "3", "601", str(ready), str(digest)]
    with subprocess.Popen(command, env=run.environment()) as listener:
        try:
            run.wait(ready.exists, 60, "the listener")
            run.start("vehicle_1/noise_relay")
            result = run.result()
            listener.wait(timeout=60)
        finally:
            listener.kill()
    assert result.digest == simulated_digest(load_scenario(PAPER_A, settings)), result.message
    assert digest.read_text() == result.digest
