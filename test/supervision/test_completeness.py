"""A run is finished only when every topic has every sample."""

import pytest

from cacc_platoon.bags.rows import TopicRows
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import simulate
from cacc_platoon.supervision.conductor import incomplete
from cacc_platoon.supervision.launcher import plan_hosts
from msg_adapters.topics import Graph

SCENARIO = Scenario.from_values({"run.duration": 1.0, "platoon.followers": 2}, None, "test")
NODES = SCENARIO.node_names


def test_a_whole_run_lacks_nothing() -> None:
    assert incomplete(SCENARIO, recording_of(simulate(SCENARIO))) == ""


@pytest.mark.parametrize("topic", [topic.name for topic in Graph.of(SCENARIO).recorded])
def test_one_missing_message_is_named(topic: str) -> None:
    recording = recording_of(simulate(SCENARIO))
    record = recording[topic]
    recording[topic] = TopicRows(record.type_name, record.messages[:-1])
    assert incomplete(SCENARIO, recording) == f"{topic}: only 100 of 101 samples were recorded"


def test_what_a_vehicle_publishes_when_asked_belongs_to_the_run() -> None:
    asked = {"record.command": True, "record.spacing_error": True}
    scenario = Scenario.from_values({"platoon.followers": 1, **asked}, None, "test")
    names = {topic.name for topic in Graph.of(scenario).recorded}
    assert {"/platoon/vehicle_1/command", "/platoon/vehicle_1/spacing_error"} < names


def test_no_host_is_planned_when_every_node_is_started_manually(tmp_path) -> None:
    scenario = Scenario.from_values(
        {"platoon.followers": 2, "run.manual_nodes": NODES}, None, "test"
    )
    assert plan_hosts(scenario, tmp_path, "run") == []
