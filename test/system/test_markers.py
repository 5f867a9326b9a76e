"""The marker node beside a real run."""

from collections.abc import Callable
from itertools import pairwise

from visualization_msgs.msg import MarkerArray

from cacc_platoon.testing import Platoon


def test_every_vehicle_has_a_box_where_it_is(platoon: Callable[..., Platoon]) -> None:
    settings = ("run.duration=10", "platoon.followers=3", "run.real_time_factor=4")
    run = platoon(*settings, "run.manual_nodes=[vehicle_1/noise_relay]")
    seen: list[MarkerArray] = []
    run.subscribe(MarkerArray, "/platoon/markers", seen.append)
    run.start("markers")
    run.wait(lambda: run.publishers_of("/platoon/markers") == 1, 60, "the marker node")
    run.start("vehicle_1/noise_relay")
    run.wait(lambda: bool(seen) and len(seen[-1].markers) == 8, 60, "all markers")
    assert run.result().status == "finished"
    boxes = [marker for marker in seen[-1].markers if marker.ns == "vehicle"]
    assert sorted(marker.id for marker in boxes) == [0, 1, 2, 3]
    ahead = sorted(boxes, key=lambda marker: marker.id)
    gaps = [a.pose.position.x - b.pose.position.x for a, b in pairwise(ahead)]
    assert min(gaps) > 20.0
