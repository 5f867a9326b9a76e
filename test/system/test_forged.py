"""Messages that others forge on the topics of a running platoon: none gets into a good bag."""

import contextlib
import dataclasses
import json
import random
import shutil
import string
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, Vector3Stamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool, Int64, String

from cacc_platoon.bags.decode import rows_in_order_of_recording
from cacc_platoon.bags.digest import run_digest
from cacc_platoon.bags.read import read_bag
from cacc_platoon.nodes import qos
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.simulation import simulate
from cacc_platoon.supervision.protocol import (
    VERSION,
    HostPhase,
    HostState,
    ProtocolError,
    RunPhase,
    RunStatus,
)
from cacc_platoon.testing import Platoon
from cacc_platoon.testing import Result
from msg_adapters.topics import Graph, VehicleTopics

SMALL = ("run.duration=60", "platoon.followers=3", "run.real_time_factor=10")
"""Six seconds of wall time, slow enough to interfere."""
SHORT = ("run.duration=20", "platoon.followers=3", "run.real_time_factor=10")
STATE, STATUS = "/platoon/host_state", "/platoon/status"
COMPLETE = VehicleTopics("/platoon", 2).complete
NAMELESS = "_NODE_NAME_UNKNOWN_"
DOUBT = "everything from sample "

Start = Callable[..., Platoon]


def digest(run: Platoon) -> str:
    """Return the digest that nothing but the scenario decides."""
    return run_digest(recording_of(simulate(run.scenario)), Graph.of(run.scenario))


def assert_failed(result: Result, *words: str) -> None:
    """The run has failed in good order, and its one line says all words.

    The graph of a busy machine may be late with a publisher, or with its name: then it is not
    among those that are named, or is called what rclpy calls it.
    """
    late = " publishers: " not in result.message or NAMELESS in result.message
    assert (result.exit_code, result.status) == (1, "failed"), result.message
    assert "Traceback" not in result.errors
    for log in result.folder.logs.glob("*"):
        assert "Traceback" not in log.read_text()
    for word in words:
        assert word in result.message or (word == "/observer" and late)
    own = [line for line in result.errors.splitlines() if line.startswith("platoon: ")]
    assert len(own) == 2, result.errors


def assert_good_before(run: Platoon, result: Result, samples: int) -> None:
    """What the bag holds of the first samples is what it has to hold, to the last bit."""
    raw, expected = read_bag(result.folder.bag), recording_of(simulate(run.scenario))
    for vehicle in Graph.of(run.scenario).vehicles.values():
        for topic in vehicle.motion:
            found = rows_in_order_of_recording(raw.topics[topic.name])
            assert found is not None
            assert len(found) >= samples
            assert np.array_equal(found[:samples], expected[topic.name].messages[:samples])


def heard_states(run: Platoon) -> dict[str, HostState]:
    """Return the last word of every host, as anybody in the domain can hear it."""
    heard: dict[str, HostState] = {}

    def take(message: String) -> None:
        with contextlib.suppress(ProtocolError):
            state = HostState.from_json(message.data)
            heard[state.host] = state

    profile = qos.latched()
    profile.depth = 10
    run.subscribe(String, STATE, take, profile)
    run.wait(lambda: {"0", "1"} <= heard.keys(), 20.0, "the states of both hosts")
    return heard


@pytest.mark.parametrize(
    "change",
    [
        {"phase": HostPhase.CLOSED},
        {"host": "evil", "nodes": ("vehicle_9/vehicle",)},
    ],
    ids=["part", "host"],
)
def test_records_of_somebody_else_do_not_get_into_the_bag(
    platoon: Start, tmp_path: Path, change: dict[str, Any]
) -> None:
    run = platoon(*SMALL, hosts=2)
    run.wait_sample(100)
    state = heard_states(run)["0"]
    evil = tmp_path / "evil"
    shutil.copytree(state.part, evil)
    for file in evil.glob("*.cdr"):
        file.write_bytes(bytes(len(file.read_bytes())))
    forged = dataclasses.replace(state, **{"part": str(evil), **change})
    run.send(String(data=forged.to_json()), STATE)
    result = run.result()
    assert_failed(result, "/observer")  # whether its message or its endpoint is seen first
    assert_good_before(run, result, 100)


def texts(seed: int, genuine: str) -> list[str]:
    """Return texts that no host and no supervisor of ours sends; the same for the same seed."""
    draw = random.Random(seed)
    fields = json.loads(genuine)
    values: list[Any] = [
        *(None, True, -1, 10**400, 1e308, float("nan"), float("-inf"), [], {}, [[]], {"a": [1]}),
        *("", "\ud800", "\0", "a b", "x/../y", "é" * 200, "x" * 20_000, "a\n\x1b[2J", "__", "a__b"),
    ]
    found = [
        *("", "{}", "null", "[" * 100_000, '{"format":' * 100_000, '{"run":"x","state":"up"}'),
        *("9" * 5000, '"\\ud800"', "\x00", "NaN", json.dumps({"format": VERSION})),
    ]
    for _ in range(60):
        changed = {**fields, draw.choice([*fields]): draw.choice(values)}
        if draw.random() < 0.3:
            changed.pop(draw.choice([*changed]))
        found.append(json.dumps(changed))
    for _ in range(30):
        cut = list(genuine)
        for _ in range(draw.randint(1, 20)):
            cut[draw.randrange(len(cut))] = draw.choice(string.printable)
        found.append("".join(cut)[: draw.randint(1, len(cut))])
    draw.shuffle(found)
    return found


def encodable(text: str) -> bool:
    """Whether a text can be sent at all."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return "\0" not in text


@pytest.mark.parametrize(("topic", "seed"), [(STATE, 1), (STATUS, 2)])
def test_no_text_ends_a_run_in_any_other_way_than_by_name(
    platoon: Start, topic: str, seed: int
) -> None:
    """Sent all at once, so that supervisor and hosts take many of them before the run has ended."""
    run = platoon(*SMALL, hosts=2)
    run.wait_sample(100)
    state = heard_states(run)["1"]
    status = RunStatus(state.run, RunPhase.RUNNING, 5, 6001)
    genuine = (state if topic == STATE else status).to_json()
    run.send([String(data=text) for text in texts(seed, genuine) if encodable(text)], topic)
    result = run.result()
    assert_failed(result, "publisher", "/observer")
    assert result.info is not None
    assert_good_before(run, result, 100)


def test_hosts_that_are_told_that_the_run_is_over_say_so(platoon: Start) -> None:
    run = platoon(*SMALL, hosts=2)
    run.wait_sample(100)
    state = heard_states(run)["0"]
    run.send(String(data=RunStatus(state.run, RunPhase.FINISHED, 6000, 6001).to_json()), STATUS)
    result = run.result()
    assert_failed(result, "publisher", "/observer")
    assert_good_before(run, result, 100)


@pytest.mark.parametrize(
    ("message_type", "topic"),
    [
        (String, STATE),
        (String, STATUS),
        (Int64, "/platoon/horizon"),
        (Int64, "/platoon/host_0/recorded"),
        (Vector3Stamped, COMPLETE.name),
    ],
)
def test_a_publisher_that_has_sent_nothing_yet_is_seen(
    platoon: Start, message_type: type, topic: str
) -> None:
    run = platoon(*SMALL, "run.duration=300", "v2v.loss=0.1", hosts=2)  # the graph may be late
    run.wait_sample(50)
    run.advertise(message_type, topic, qos.latched())
    assert_failed(run.result(), topic, " publishers: ", "/observer", "Another platoon or publisher")


def test_a_publisher_that_nobody_can_hear_is_a_warning(platoon: Start) -> None:
    run = platoon(*SHORT, hosts=2)
    run.wait_sample(50)
    poses = VehicleTopics("/platoon", 1).pose.name
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    run.advertise(Bool, "/platoon/vehicle_2/twist", 1)
    run.advertise(PoseStamped, poses, best_effort)
    run.advertise(String, STATE, 1)
    result = run.result()
    assert (result.status, result.digest) == ("finished", digest(run)), result.message
    for topic in ("/platoon/vehicle_2/twist", poses, STATE):
        assert result.errors.count(f"warning: {topic}: /observer publishes") == 1, result.errors


@pytest.mark.parametrize("ahead", [1, 1000])
def test_a_flood_of_counts_is_named_with_its_topic(platoon: Start, ahead: int) -> None:
    run = platoon(*SMALL, "v2v.loss=0.1", hosts=2)
    run.wait_sample(100)
    publish = run.publisher(COMPLETE)
    step = run.scenario.step_ns
    for k in range(3000):
        publish((100 + ahead + k) * step, 1.0 + k)
    result = run.result()
    assert_failed(result, "v2v/complete", "publisher", "/observer")
    doubtful = result.message.partition(DOUBT)[2]
    assert_good_before(run, result, int(doubtful.split()[0]) if doubtful else 100)


def test_counts_that_are_due_make_the_samples_from_there_on_doubtful(platoon: Start) -> None:
    """One forged count in time is taken for the relay's; that of the relay gives it away."""
    run = platoon(*SMALL, "v2v.loss=0.5", hosts=2)
    run.wait_sample(100)
    counts: list[tuple[int, float]] = []
    run.subscribe(
        Vector3Stamped,
        COMPLETE.name,
        lambda m: counts.append((m.header.stamp.sec * 10**9 + m.header.stamp.nanosec, m.vector.x)),
        qos.stream(run.scenario),
    )
    run.wait(lambda: len(counts) > 5, 10.0, "counts")
    publish = run.publisher(COMPLETE)
    stamp, count = counts[-1]
    for k in range(1, 3):
        publish(stamp + k * run.scenario.step_ns, count)
    for k in range(3, 2000):
        publish(stamp + k * run.scenario.step_ns, count + k - 2)
    result = run.result()
    assert_failed(result, "v2v/complete", "publisher")
    doubtful = result.message.partition(DOUBT)[2]
    good = int(doubtful.split()[0]) if doubtful else 100
    assert_good_before(run, result, good)


def test_a_packet_of_another_publisher_is_found_out_at_the_latest_at_the_end(
    platoon: Start,
) -> None:
    """It comes and is gone between two looks at the graph, with a stamp that may be."""
    later = "vehicle_2/vehicle"
    settings = ("run.duration=2", "platoon.followers=2", "v2v.loss=0.3")
    run = platoon(*settings, hosts=1, manual_nodes={later: ()})
    publish = run.publisher(VehicleTopics("/platoon", 1).received)
    publish(0, 0.5)
    run.start(later)
    result = run.result()
    assert result.exit_code == 1
    assert result.status == "failed"


@pytest.mark.parametrize("node", ["vehicle_2/vehicle"])
def test_a_part_that_the_supervisor_was_not_told_of_is_named(
    platoon: Start, tmp_path: Path, node: str
) -> None:
    run = platoon(*SMALL, f"run.manual_nodes=[{node}]")
    parts = tmp_path / "parts"
    run.start(node, parameters=[f"record:={parts}"])
    result = run.result()
    assert_failed(
        result,
        f"host vehicle_2_vehicle: records in {parts / 'vehicle_2_vehicle'}, unknown to the run",
        f"-p record.parts:={parts}",
    )


def test_a_node_that_is_started_manually_although_the_run_starts_it_is_named(
    platoon: Start,
) -> None:
    run = platoon(*SMALL, "run.start_timeout=20", hosts=1)
    run.start("vehicle_2/vehicle")
    result = run.result()
    assert_failed(result, "vehicle_2", "publisher")
