"""Names, types and frames of the graph, as the table of the README has them."""

from cacc_platoon.model import Topology
from cacc_platoon.scenario import Scenario
from msg_adapters.topics import Graph, VehicleTopics, queue_depth


def test_a_vehicles_topics():
    topics = VehicleTopics("/a/b", 3)
    rows = [
        (topic.name, topic.kind.type_name.rpartition("/")[2], topic.frame_id)
        for topic in (
            *(topics.pose, topics.twist, topics.accel, topics.received),
            *(topics.complete, topics.command, topics.spacing_error),
        )
    ]
    assert rows == [
        ("/a/b/vehicle_3/pose", "PoseStamped", "map"),
        ("/a/b/vehicle_3/twist", "TwistStamped", "vehicle_3/base_link"),
        ("/a/b/vehicle_3/accel", "AccelStamped", "vehicle_3/base_link"),
        ("/a/b/vehicle_3/v2v/accel", "AccelStamped", "vehicle_2/base_link"),
        ("/a/b/vehicle_3/v2v/complete", "Vector3Stamped", "vehicle_3/base_link"),
        ("/a/b/vehicle_3/command", "AccelStamped", "vehicle_3/base_link"),
        ("/a/b/vehicle_3/spacing_error", "Vector3Stamped", "vehicle_3/base_link"),
    ]


def test_fifty_one_messages_a_sample_for_twelve_followers():
    assert len(Graph("/platoon", Topology(range(1, 13))).run_topics) == 51


def test_queues_are_deeper_than_the_window():
    for window in (1, 64, 1000):
        assert queue_depth(Scenario.from_values({"run.window": window})) > window + 12


def test_by_clocks_a_minute_fits_into_a_queue():
    values = {"run.sync": "wall", "run.duration": 200.0}
    assert queue_depth(Scenario.from_values(values)) == 6000
    assert queue_depth(Scenario.from_values({**values, "run.real_time_factor": 2.0})) == 12000
    assert queue_depth(Scenario.from_values({**values, "run.duration": 10.0})) == 1001
