"""A recorded vehicle again, on a real node: by `platoon replay`, and by a player from outside."""

import contextlib
import json
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import Reader

from cacc_platoon.cli.simulate import simulate_run
from cacc_platoon.dds.domain import own_domain
from cacc_platoon.model import State
from cacc_platoon.runs.parts import read_parts
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import Trajectory, simulate
from msg_adapters.topics import VehicleTopics

PAPER_A = Path(__file__).parents[2] / "config" / "paper_a.yaml"
PLAYER = Path(__file__).with_name("bag_player.py")
SHORT = ("run.duration=6", "leader.start=0.5", "leader.amplitude=2", "platoon.followers=3")
DEEP = (*SHORT, "run.duration=3", "run.window=1000")
PATIENCE = 60.0

pytestmark = pytest.mark.usefixtures("nothing_left")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("replay") / "run"
    simulate_run(load_scenario(PAPER_A, SHORT), path)
    return path


@pytest.fixture(scope="module")
def trajectory() -> Trajectory:
    return simulate(load_scenario(PAPER_A, SHORT))


def replay(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "cacc_platoon", "replay", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)


def own_lines(errors: str) -> list[str]:
    """Return the lines of platoon itself; Fast DDS prints errors of other processes there too."""
    assert "Traceback" not in errors
    return [line for line in errors.splitlines() if line.startswith("platoon: ")]


def flipped(run: Path, copy: Path, topic: str, sample: int) -> Path:
    """Copy a run and flip the last mantissa bit of the first number of one message."""
    shutil.copytree(run, copy)
    with Reader(run / "bag") as reader:
        wanted = [c for c in reader.connections if c.topic == topic]
        message = [bytes(data) for _, _, data in reader.messages(connections=wanted)][sample]
    (file,) = (copy / "bag").glob("*.mcap")
    content = bytearray(file.read_bytes())
    assert content.count(message) == 1
    (frame,) = struct.unpack_from("<I", message, 12)
    content[content.find(message) + 4 + -(-(12 + frame) // 8) * 8] ^= 1
    file.write_bytes(content)
    return copy


@pytest.mark.parametrize(
    ("arguments", "messages"),
    [
        (("--vehicle", 3), 3 * 601),
        (("--vehicle", 2, "--node", "noise_relay"), 601),
        (("--vehicle", 0), 3 * 601),
    ],
)
def test_a_node_says_the_same_again(
    recorded: Path, arguments: tuple[object, ...], messages: int
) -> None:
    result = replay(recorded, *arguments)
    assert result.returncode == 0, result.stderr
    assert result.stdout == f"{messages} messages identical\n"
    assert own_lines(result.stderr) == []


@pytest.mark.parametrize(("topic", "node"), [("twist", "vehicle"), ("v2v/accel", "noise_relay")])
def test_one_flipped_bit_is_found(recorded: Path, tmp_path: Path, topic: str, node: str) -> None:
    name = f"/platoon/vehicle_2/{topic}"
    copy = flipped(recorded, tmp_path / "copy", name, 345)
    result = replay(copy, "--vehicle", 2, "--node", node)
    assert result.returncode == 1, result.stderr
    assert result.stdout.startswith(f"{name} differs first at sample 345 (3.45 s): recorded ")
    values = re.search(r"recorded (\S+) \S+, replayed (\S+) ", result.stdout)
    assert values, result.stdout
    before, after = map(float, values.groups())
    assert 0.0 < abs(before - after) <= 2 * np.spacing(abs(after))
    assert "the bag was altered after the run" in result.stdout
    assert result.stdout.count("\n") == 1


def test_a_vehicle_of_an_altered_run_is_no_good_news_alone(recorded: Path, tmp_path: Path) -> None:
    """The message that was altered is another vehicle's."""
    copy = flipped(recorded, tmp_path / "copy", "/platoon/vehicle_3/accel", 345)
    result = replay(copy, "--vehicle", 2)
    assert result.returncode == 0, result.stderr
    same, data = result.stdout.splitlines()
    assert same == f"{3 * 601} messages identical"
    assert data.startswith("DATA ALTERED: the messages do not have the digest that was written")


def test_other_parameters_are_seen(recorded: Path, tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.yaml"
    text = (recorded / "scenario.yaml").read_text()
    scenario.write_text(text.replace("k_v: 0.63", "k_v: 0.64"))
    result = replay(recorded, "--vehicle", 2, "--scenario", scenario)
    assert result.returncode == 1
    assert result.stdout.startswith("/platoon/vehicle_2/")
    assert "other parameters" in result.stdout


def test_what_if_is_what_the_simulation_says(recorded: Path, tmp_path: Path) -> None:
    setting = "controller.k_v=0.8"
    result = replay(recorded, "--vehicle", 2, "--set", setting, "--json", "-o", tmp_path / "answer")
    assert result.returncode == 0, result.stderr
    answer = json.loads(result.stdout)
    other = simulate(load_scenario(PAPER_A, [*SHORT, f"vehicle_2.{setting}"]))
    assert answer["replayed"] == {
        "max_abs_spacing_error": float(np.abs(other.spacing_error[:, 1]).max()),
        "min_gap": float(np.min(other.gap[:, 1])),
        "max_abs_acceleration": float(np.abs(other.acceleration[:, 2]).max()),
    }
    assert answer["replayed"] != answer["recorded"]
    assert json.loads((tmp_path / "answer" / "replay.json").read_text()) == answer
    assert (tmp_path / "answer" / "spacing_error.svg").read_text().startswith("<svg")


def test_what_if_begins_in_the_recorded_state(recorded: Path, trajectory: Trajectory) -> None:
    """A plain loop over plant and law, given the recorded inputs, from the recorded state."""
    setting = "controller.time_headway=0.8"
    result = replay(recorded, "--vehicle", 3, "--set", setting, "--json")
    follower = load_scenario(PAPER_A, [*SHORT, f"vehicle_3.{setting}"]).follower(3)
    plant, law = follower.plant(0.01), follower.spacing_policy()
    ahead = zip(trajectory.position[:, 2], trajectory.velocity[:, 2], strict=True)
    state = State(trajectory.position[0, 3], trajectory.velocity[0, 3], 0.0)
    gaps, errors = [], []
    for (position, velocity), received in zip(ahead, trajectory.received[:, 2], strict=True):
        gaps.append(position - state.position)
        errors.append(abs(law.spacing_error(state.position, state.velocity, position)))
        command = law.command(state.position, state.velocity, position, velocity, received)
        state = plant.advance(state, command)
    answer = json.loads(result.stdout)["replayed"]
    assert (answer["min_gap"], answer["max_abs_spacing_error"]) == (min(gaps), max(errors))


def test_a_bag_that_was_cut_short_is_replayed_as_far_as_it_goes(
    recorded: Path, tmp_path: Path
) -> None:
    (file,) = (recorded / "bag").glob("*.mcap")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    result = replay(cut, "--vehicle", 2, "--json")
    assert result.returncode == 0, result.stderr
    answer = json.loads(result.stdout)
    assert answer["identical"]
    assert 200 < answer["samples"] < 400
    assert "ends at sample" in answer["notes"][0]


def test_a_node_that_fails_is_named(recorded: Path, tmp_path: Path) -> None:
    """Gains beyond all bounds let the node's command overflow."""
    result = replay(recorded, "--vehicle", 1, "--set", "controller.k_p=1e300")
    assert (result.returncode, result.stdout) == (1, "")
    (line,) = own_lines(result.stderr)
    assert "vehicle_1: command at" in line


def processes_with(mark: str) -> dict[int, int]:
    """Return the processes that have a mark in their environment, with their parents."""
    found = {}
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if mark.encode() in (process / "environ").read_bytes().split(b"\0"):
                fields = (process / "stat").read_text().rpartition(")")[2].split()
                found[int(process.name)] = int(fields[1])
    return found


def thread_count(pid: int) -> int:
    """Return how many threads a process has."""
    return len([*Path(f"/proc/{pid}/task").iterdir()])


def test_a_node_that_hangs_is_named_and_ended(tmp_path: Path) -> None:
    settings = (*SHORT, "run.duration=1", "run.start_timeout=2")
    run = simulate_run(load_scenario(PAPER_A, settings), tmp_path / "run")
    command = [sys.executable, "-m", "cacc_platoon", "replay", str(run.path), "--vehicle", "1"]
    mark = f"REPLAY_TEST={tmp_path}"
    environment = {**os.environ, **dict([mark.split("=")])}
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + PATIENCE
    node: list[int] = []
    while not node:  # the node's process is the child of a child: of the server that forks
        assert time.monotonic() < deadline
        parents = processes_with(mark)
        servers = [pid for pid, parent in parents.items() if parent == process.pid]
        children = [pid for pid, parent in parents.items() if parent in servers]
        node = [pid for pid in children if thread_count(pid) > 1]  # it has begun
    os.kill(node[0], signal.SIGSTOP)
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1
    (line,) = own_lines(errors)
    assert line.startswith("platoon: vehicle_1/vehicle has not appeared for 2 s")
    while processes_with(mark):
        assert time.monotonic() < deadline


@pytest.mark.parametrize("pace", ["1", "inf", "by-topic"])
def test_a_bag_played_from_outside_gives_the_recorded_bits(tmp_path: Path, pace: str) -> None:
    """As docs/replay.md describes for `ros2 bag play`; the node has no supervisor."""
    scenario = load_scenario(PAPER_A, DEEP)
    run = simulate_run(scenario, tmp_path / "run")
    own, ahead = VehicleTopics("/platoon", 2), VehicleTopics("/platoon", 1)
    topics = [topic.name for topic in (own.received, ahead.twist, ahead.pose)]
    code = (
        "import sys; from cacc_platoon.supervision.entry_points import vehicle; sys.exit(vehicle())"
    )
    with own_domain() as domain:
        environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        node = subprocess.Popen(
            [
                *(sys.executable, "-c", code, "--ros-args", "-r", "__ns:=/platoon/vehicle_2"),
                *("--params-file", str(run.path / "scenario.yaml")),
                *("-p", f"record:={tmp_path / 'again'}"),
            ],
            env=environment,
        )
        try:
            player = [sys.executable, str(PLAYER), str(run.bag), pace, *topics]
            subprocess.run(player, env=environment, check=True, timeout=PATIENCE)
            part = tmp_path / "again" / "vehicle_2_vehicle"
            wait_for_samples(node, part, scenario.samples)
        finally:
            node.send_signal(signal.SIGINT)
            node.wait(PATIENCE)
    expected = recording_of(simulate(scenario))
    for topic in (own.pose, own.twist, own.accel):
        found = read_parts([part])[topic.name].messages
        assert np.array_equal(found, expected[topic.name].messages), topic.name


def wait_for_samples(node: subprocess.Popen[bytes], part: Path, samples: int) -> None:
    """Wait until a node that runs has recorded so many samples of everything."""
    deadline = time.monotonic() + PATIENCE
    while min(len(record.messages) for record in read_parts([part]).values()) < samples:
        with pytest.raises(subprocess.TimeoutExpired):
            node.wait(timeout=0.1)
        assert time.monotonic() < deadline
