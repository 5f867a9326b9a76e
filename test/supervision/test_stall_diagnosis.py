"""From how many samples each topic has to the node that stopped."""

import pytest

from cacc_platoon.model import Topology
from cacc_platoon.scenario import Scenario
from cacc_platoon.supervision.stall_diagnosis import (
    last_sample,
    stopped_first,
    stopped_together,
)
from msg_adapters.topics import Graph, VehicleTopics

SCENARIO = Scenario.from_values({"platoon.followers": 3, "run.duration": 1.0}, None, "test")


def counts_when(stopped: str, at: int, leader: int = 80) -> dict[str, int]:
    """Return how many samples each topic has when one node stops and everything comes to rest."""
    counts: dict[str, int] = {}
    done = leader
    for index in range(4):
        topics = VehicleTopics("/platoon", index)
        if index:
            received = at if stopped == f"vehicle_{index}/noise_relay" else done
            counts[topics.received.name] = received
            done = at if stopped == f"vehicle_{index}/vehicle" else min(done, received) + 1
        counts.update({t.name: done for t in (topics.pose, topics.twist, topics.accel)})
    assert counts.keys() == {
        topic.name for topic in Graph("/platoon", Topology(range(1, 4))).run_topics
    }
    return counts


@pytest.mark.parametrize("index", [1, 2, 3])
@pytest.mark.parametrize("kind", ["vehicle", "noise_relay"])
def test_the_node_that_stopped_is_named(kind: str, index: int) -> None:
    node = f"vehicle_{index}/{kind}"
    counts = counts_when(node, at=31)
    [line] = stopped_first(SCENARIO, counts)
    assert f"{node} stopped at sample 30" in line
    assert last_sample(SCENARIO, counts) == "the last complete sample is 30 (0.3 s)"


def test_what_is_in_transit_is_no_stop() -> None:
    counts = counts_when("nobody", at=0)
    assert stopped_first(SCENARIO, counts) == []
    assert last_sample(SCENARIO, counts) == "the last complete sample is 79 (0.79 s)"


def test_where_all_stopped_together_it_was_the_leader_or_who_records() -> None:
    [line] = stopped_together(SCENARIO, counts_when("nobody", at=0))
    assert (
        "vehicle_0/leader, the recorder of a host or the supervisor stopped, at sample 79" in line
    )
    assert stopped_together(SCENARIO, counts_when("nobody", at=0, leader=101)) == []


def test_an_empty_run_names_nobody() -> None:
    assert stopped_first(SCENARIO, {}) == []
    assert last_sample(SCENARIO, {}) == "the last complete sample is -1 (0 s)"
