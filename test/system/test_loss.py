"""Lossy links on real nodes: the digest of the simulation, and a bag that holds what arrived."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from cacc_platoon.analysis import analyse
from cacc_platoon.bags.digest import run_digest
from cacc_platoon.cli import main
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario.channel_presets import channel_names, channel_settings
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import simulate
from cacc_platoon.simulation.monitoring import alarms
from cacc_platoon.testing import Platoon
from msg_adapters.topics import Graph, Topic, VehicleTopics

HERE = Path(__file__).parent
PAPER_A = HERE.parents[1] / "config" / "paper_a.yaml"
LOSSY = ("run.duration=8", "platoon.followers=4", "leader.start=1", "v2v.loss=0.3")
OWN = ("v2v.channel=own_parts:late", "controller.law=own_parts:Cautious")

ALL_PARTS = (
    *("v2v.period=0.05", "v2v.phase=random", "v2v.latency=0.013", "v2v.jitter=0.1"),
    *("v2v.burst_begin=0.1", "v2v.burst_end=0.3", "v2v.blackouts=[2, 3]"),
    *("v2v.bias=0.05", "v2v.noise_std=0.02", "v2v.quantum=0.1", "v2v.saturation=0.4"),
    'v2v.false_data=["1 2 factor=3", "4 5 replay=2.5", "6 7 frozen"]',
)

Start = Callable[..., Platoon]
Replay = Callable[..., dict[str, Any]]


def simulated_digest(*settings: str) -> str:
    scenario = load_scenario(PAPER_A, settings)
    return run_digest(recording_of(simulate(scenario)), Graph.of(scenario))


def of_followers(parts: Sequence[Sequence[str]]) -> list[str]:
    """Return the settings of a platoon in which follower i has the i-th of these, and no other."""
    own = [f"vehicle_{i}.{setting}" for i, part in enumerate(parts, 1) for setting in part]
    return [f"platoon.followers={len(parts)}", *own]


PACKETS = (
    (),
    ("v2v.reception=zero",),
    ("v2v.period=0.1", "v2v.phase=random"),
    ("v2v.latency=0.035", "v2v.loss=0"),
    ("v2v.burst_begin=0.3", "v2v.burst_end=0.3", "v2v.blackouts=[2, 3.5, 5, 5.5]"),
    ("v2v.bias=0.05", "v2v.noise_std=0.02", "v2v.quantum=0.1", "v2v.saturation=0.4"),
    ("v2v.jitter=0.05", "v2v.jitter_law=gamma", "v2v.in_order=true", "v2v.loss=0"),
    ALL_PARTS,
)


@pytest.mark.parametrize("hosts", [1, "per_node"])
def test_one_digest_where_packets_are_lost_rare_or_late(platoon: Start, hosts: int | str) -> None:
    settings = (*LOSSY, *of_followers(PACKETS))
    result = platoon(*settings, hosts=hosts).result()
    assert result.exit_code == 0, result.errors
    assert result.digest == simulated_digest(*settings), result.message


DARK = ("v2v.reception=fallback", "v2v.blackouts=[2, 4]", "v2v.fallback_after=0.4")
FALSE = ("v2v.monitor=fallback", 'v2v.false_data=["1.2 1.8 factor=-1"]')


@pytest.mark.parametrize("hosts", [1, 2, "per_node"])
def test_one_digest_for_every_channel_with_fallback(platoon: Start, hosts: int | str) -> None:
    names = channel_names()
    parts = [
        (*channel_settings(name), *DARK, *(FALSE if name == "attacked" else ())) for name in names
    ]
    settings = ("run.duration=8", "leader.start=1", "leader.profile=brake", *of_followers(parts))
    run = platoon(*settings, hosts=hosts)
    result = run.result()
    assert result.exit_code == 0, result.errors
    assert result.digest == simulated_digest(*settings), result.message
    report = analyse(result.folder.path, runs=0)
    assert report.run.findings == ()
    assert report.consistency.largest == report.recomputed.links.largest == 0.0
    for index in run.scenario.indices:
        states = recorded(run, VehicleTopics(run.scenario.platoon.namespace, index).reception)
        assert len(states) == run.scenario.samples
        assert {0.0, 1.0, 2.0} <= set(states)
    found = alarms(simulate(run.scenario))
    assert {names[index - 1] for index in found} == {"attacked"}
    for index, alarm in found.items():
        topic = VehicleTopics(run.scenario.platoon.namespace, index).monitor
        assert recorded(run, topic) == alarm.astype(float).tolist()
        assert alarm.any()


def recorded(run: Platoon, topic: Topic) -> list[float]:
    """Return x of the messages of a topic, by a second reader."""
    with Reader(run.result().folder.bag) as reader:
        wanted = [c for c in reader.connections if c.topic == topic.name]
        return [topic.codec.decode(data)[1] for _, _, data in reader.messages(wanted)]


RARE = ("v2v.period=0.05", "v2v.latency=0.03")


@pytest.mark.parametrize("packets", [(), RARE])
def test_the_bag_holds_what_arrived(
    platoon: Start, replay: Replay, packets: tuple[str, ...]
) -> None:
    run = platoon(*LOSSY, *packets, hosts=2)
    result = run.result()
    assert result.exit_code == 0, result.errors
    trajectory = simulate(run.scenario)
    assert trajectory.arrivals is not None
    for arrivals, vehicle in zip(
        trajectory.arrivals, list(Graph.of(run.scenario).vehicles.values())[1:], strict=True
    ):
        with Reader(result.folder.bag) as reader:  # a second reader
            wanted = [c for c in reader.connections if c.topic == vehicle.received.name]
            decode = vehicle.received.codec.decode
            messages = [(log, decode(data)[0]) for _, log, data in reader.messages(wanted)]
        step = run.scenario.step_ns
        assert [stamp // step for _, stamp in messages] == arrivals.source.tolist()
        assert [log // step for log, _ in messages] == arrivals.sample.tolist()
        [file] = result.folder.bag.glob("*.mcap")
        with file.open("rb") as stream:  # a third one, which knows publish times
            logged = make_reader(stream).iter_messages([vehicle.received.name])
            assert [message.publish_time for *_, message in logged] == [s for _, s in messages]
    report = analyse(result.folder.path, runs=0)
    assert report.run.findings == ()
    assert report.consistency.largest == 0.0
    assert report.verdict.void == ()
    for link in report.measured.reception:
        assert 0.1 < link.loss < 0.5
        assert 0.0 < link.age_max < (0.6 if packets else 0.2)
    node = "vehicle" if packets else "noise_relay"
    assert replay(run, 2, node)["identical"] is True


def test_a_channel_and_a_law_by_name_run_on_nodes(
    platoon: Start, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Late packets overtake others, and the digest has it; a replay runs no code of a bag's."""
    monkeypatch.syspath_prepend(str(HERE))
    settings = (*LOSSY, *OWN)
    run = platoon(*settings, hosts=2, environment={"PYTHONPATH": str(HERE)})
    result = run.result()
    assert result.exit_code == 0, result.errors
    assert result.digest == simulated_digest(*settings), result.message
    report = analyse(result.folder.path, runs=0)
    assert report.run.digest == result.digest
    assert [reason for reason in report.verdict.void if "own_parts" in reason] != []
    assert report.measured.reception[0].age_max >= 0.02
    assert main(["replay", str(run.folder.path), "--vehicle", "2"]) == 2
    assert "code that the replay would run" in capsys.readouterr().err


WORLD = (
    *("v2v.reception=fallback", "v2v.blackouts=[2, 4]", "v2v.fallback_after=0.4"),
    *("sensing.range_std=0.05", "sensing.delay=0.03", "vehicle.limits=iso15622"),
    *("vehicle.stops=true", "record.command=true", "run.hosts=2", "v2v.monitor=fallback"),
)


def test_nodes_with_sensors_limits_and_a_fallback_are_replayed(
    platoon: Start, replay: Replay
) -> None:
    run = platoon(*LOSSY, *channel_settings("cam_lossy"), *WORLD)
    result = run.result()
    assert result.exit_code == 0, result.errors
    assert result.digest == run_digest(recording_of(simulate(run.scenario)), Graph.of(run.scenario))
    for node in ("vehicle", "noise_relay"):
        assert replay(run, 2, node)["identical"] is True
    softer = replay(run, 2, "vehicle", "--set", "controller.k_v=0.5")
    assert softer["replayed"]["max_abs_spacing_error"] > 0.0


def test_a_killed_relay_is_named_and_the_bag_is_readable(platoon: Start) -> None:
    relay = {"vehicle_2/noise_relay": ""}
    run = platoon("run.duration=60", *LOSSY[1:], "run.stall_timeout=2", manual_nodes=relay)
    run.start("vehicle_2/noise_relay")
    run.wait_sample(200)
    run.kill("vehicle_2/noise_relay")
    result = run.result()
    assert result.exit_code == 1
    assert "vehicle_2/noise_relay" in result.message
    report = analyse(result.folder.path, runs=0)
    assert len(report.run.trajectory.time) > 200
    assert np.isfinite(report.run.trajectory.received[:200]).all()


def test_a_reception_of_ones_own(platoon: Start, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(HERE))
    own = (*LOSSY, "v2v.receiver=own_parts:Forgetting")
    result = platoon(*own, hosts=2, environment={"PYTHONPATH": str(HERE)}).result()
    assert result.exit_code == 0, result.errors
    assert result.digest == simulated_digest(*own), result.message
    assert result.digest != simulated_digest(*LOSSY)
    report = analyse(result.folder.path, runs=0)
    assert any("v2v.receiver = own_parts:Forgetting" in reason for reason in report.verdict.void)
