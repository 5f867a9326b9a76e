"""A recorded vehicle as leader: what is read is what was recorded; what cannot lead is named."""

import dataclasses
import shutil
from typing import Any

import numpy as np
import pytest

from cacc_platoon.bags.decode import rows_in_stamp_order
from cacc_platoon.bags.read import read_bag
from cacc_platoon.bags.rows import TopicRows
from cacc_platoon.bags.write import write_bag
from cacc_platoon.cli.simulate import simulate_run
from cacc_platoon.errors import UserError
from cacc_platoon.runs.recorded_leader import with_recorded_leader
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario, load_scenario, parse_scenario
from cacc_platoon.simulation import simulate
from msg_adapters.topics import VehicleTopics

FRONT = {"platoon.followers": 3, "run.duration": 2.0, "leader.start": 0.3, "leader.amplitude": 2.0}


@pytest.fixture(scope="module")
def front(tmp_path_factory):
    path = tmp_path_factory.mktemp("chaining") / "front"
    simulate_run(Scenario.from_values(FRONT), path)
    return path


def chained(file, **more):
    values: dict[str, Any] = {
        "platoon.followers": 2,
        "run.duration": 2.0,
        "platoon.first_follower": 4,
    }
    values |= {"run.duration": 2.0, "leader.profile": "bag", "leader.file": str(file)}
    return Scenario.from_values(values | {name.replace("__", "."): v for name, v in more.items()})


def test_the_leader_moves_as_recorded(front):
    scenario = with_recorded_leader(chained(front))
    recorded = simulate(Scenario.from_values(FRONT))
    for k in (0, 1, 77, 200):
        state = scenario.leader_profile().at(k * 0.01)
        assert state == (
            recorded.position[k, 3],
            recorded.velocity[k, 3],
            recorded.acceleration[k, 3],
        )
    assert scenario.leader.vehicle == 3


@pytest.mark.parametrize("inside", ["", "bag"])
def test_a_run_and_a_bag_are_the_same(front, inside):
    one, other = (with_recorded_leader(chained(path)) for path in (front, front / inside))
    assert one.leader.digest == other.leader.digest != ""


def test_the_resolved_scenario_finds_its_leader_again(front, tmp_path):
    scenario = with_recorded_leader(chained(front))
    again = parse_scenario(format_scenario(scenario), "resolved", tmp_path)
    assert again == dataclasses.replace(scenario, name=again.name)
    assert with_recorded_leader(again).recorded_leader is not None


def test_a_relative_file_is_looked_for_beside_the_scenario(front, tmp_path):
    shutil.copytree(front, tmp_path / "front")
    file = tmp_path / "rear.yaml"
    text = format_scenario(chained("front")).replace(str(chained("front").leader.file), "front")
    file.write_text(text)
    assert "file: front" in text
    assert load_scenario(file).leader.file == str(tmp_path / "front")
    assert with_recorded_leader(load_scenario(file)).leader.vehicle == 3


def test_any_recorded_vehicle_may_lead_under_any_number(front):
    scenario = with_recorded_leader(chained(front, leader__vehicle=1, platoon__first_follower=1))
    assert (scenario.leader.vehicle, scenario.leader_index) == (1, 0)
    recorded = simulate(Scenario.from_values(FRONT))
    assert (simulate(scenario).acceleration[:, 0] == recorded.acceleration[:, 1]).all()


def test_another_profile_is_left_alone():
    scenario = Scenario.from_values({})
    assert with_recorded_leader(scenario) is scenario


def test_a_leader_that_was_not_read_is_no_leader(front):
    with pytest.raises(UserError, match="has not been read"):
        chained(front).leader_profile()


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"leader__vehicle": 9}, r"vehicles 0 to 3 of /platoon and not leader.vehicle = 9"),
        ({"run__step": 0.02}, r"recorded with run.step = 0.01 s and this run has 0.02 s"),
        ({"run__duration": 2.01}, r"ends at 2 s and run.duration = 2.01 s"),
        ({"platoon__initial_speed": 24.0}, r"begins at 25.0 m/s and platoon.initial_speed = 24.0"),
        ({"leader__digest": "0" * 64}, r"has changed: .*/vehicle_3 has the digest \w{12} and"),
    ],
)
def test_what_cannot_lead_is_refused_in_one_line(front, more, message):
    with pytest.raises(UserError, match=message) as refusal:
        with_recorded_leader(chained(front, **more))
    assert "\n" not in str(refusal.value)


def test_a_bag_that_is_gone_is_named_with_its_digest(front, tmp_path):
    shutil.copytree(front, tmp_path / "gone")
    scenario = with_recorded_leader(chained(tmp_path / "gone"))
    shutil.rmtree(tmp_path / "gone")
    again = parse_scenario(format_scenario(scenario), "rear")
    with pytest.raises(
        UserError, match=rf"is not there.*vehicle_3, digest {again.leader.digest[:12]}"
    ):
        with_recorded_leader(again)


def test_a_broken_bag_is_refused(tmp_path):
    (tmp_path / "bag").mkdir()
    with pytest.raises(UserError, match=r"holds no .mcap or .db3 file"):
        with_recorded_leader(chained(tmp_path))


def spoiled(front, path, topic, change):
    """Write the front's bag with one topic changed."""
    recording = {}
    for name, parts in read_bag(front / "bag").topics.items():
        rows = rows_in_stamp_order(parts)
        if name != "/platoon/scenario" and rows is not None:
            recording[name] = TopicRows(parts[0].type_name, rows)
    messages = change(recording[topic.name].messages.copy())
    recording[topic.name] = TopicRows(topic.kind.type_name, messages)
    write_bag(
        path / "bag",
        recording,
        step_ns=10_000_000,
        depth=100,
        scenario_topic="/platoon/scenario",
        scenario_text=format_scenario(Scenario.from_values(FRONT)),
        custom_data={},
    )
    return path


def with_value(topic, k, value):
    def change(messages):
        stamps, values = topic.codec.stamps(messages), topic.codec.values(messages)
        values[k] = value
        return topic.codec.encode_many(stamps, values)

    return change


LEADER = VehicleTopics("/platoon", 3)


@pytest.mark.parametrize(
    ("topic", "change", "message"),
    [
        (LEADER.accel, with_value(LEADER.accel, 0, 0.5), r"accelerate at 0.5 m/s\^2 at time 0"),
        (LEADER.twist, with_value(LEADER.twist, 9, np.nan), r"has a twist that is not finite"),
        (LEADER.pose, lambda rows: np.delete(rows, 50, axis=0), r"lacks sample 50 of .*/pose"),
        (LEADER.accel, lambda rows: rows[:0], r"has no .*/vehicle_3/accel"),
        (LEADER.accel, lambda rows: rows[:, :-8], r"messages of another frame"),
    ],
)
def test_a_recording_that_cannot_lead_is_refused(front, tmp_path, topic, change, message):
    with pytest.raises(UserError, match=message):
        with_recorded_leader(chained(spoiled(front, tmp_path, topic, change)))


def test_another_platoon_must_be_named(front):
    scenario = chained(front, platoon__namespace="/other")
    assert with_recorded_leader(scenario).leader.vehicle == 3  # the only one there is
    recording = recording_of(simulate(scenario := with_recorded_leader(scenario)))
    assert f"{scenario.platoon.namespace}/vehicle_5/pose" in recording
