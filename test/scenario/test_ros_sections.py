"""Sections of a scenario file reach the nodes that `--params-file` would give them to."""

import itertools

import pytest
from rclpy.context import Context
from rclpy.node import Node

from cacc_platoon.scenario.file import format_scenario, load_scenario, parse_scenario

FOLLOWERS = 3
READERS = {"controller.k_v": "vehicle", "v2v.rho": "noise_relay"}
PATTERNS = [
    "/**",
    "/platoon/**",
    "/**/*",
    "/platoon/*/*",
    "/*/*/*",
    "/platoon/vehicle_2/*",
    "/platoon/vehicle_2/**",
    "/**/vehicle_2/*",
    "/**/platoon/**/vehicle_2/*",
    "/platoon/*/{reader}",
    "/**/{reader}",
    "/platoon/vehicle_2/{reader}",
    "platoon/vehicle_2/{reader}",
]


@pytest.fixture(scope="module", autouse=True)
def quiet_domain():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")
        yield


def ros_values(path, name: str) -> list[object]:
    """Return what the readers of a parameter get from ROS's own parser, by follower."""
    context = Context()
    context.init(args=["--ros-args", "--params-file", str(path)], domain_id=87)
    try:
        return [ros_value(context, READERS[name], i, name) for i in range(1, FOLLOWERS + 1)]
    finally:
        context.shutdown()


def ros_value(context: Context, reader: str, index: int, name: str) -> object:
    node = Node(
        reader,
        namespace=f"/platoon/vehicle_{index}",
        context=context,
        enable_rosout=False,
        start_parameter_services=False,
        automatically_declare_parameters_from_overrides=True,
    )
    try:
        return node.get_parameter(name).value
    finally:
        node.destroy_node()


def our_values(path, name: str) -> list[object]:
    followers = load_scenario(path).followers
    if name == "v2v.rho":
        return [follower.v2v.rho for follower in followers]
    return [follower.gains.k_v for follower in followers]


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("first", PATTERNS)
def test_any_two_sections_mean_what_they_mean_to_ros(tmp_path, first, name):
    """Two sections after a common one, in every order: the later one wins where both match."""
    path = tmp_path / "scenario.yaml"
    for second in PATTERNS:
        if first == second:
            continue
        text = f"/**/**:\n  ros__parameters: {{platoon.followers: {FOLLOWERS}, {name}: 1.5}}\n"
        for pattern, value in ((first, 2.5), (second, 3.5)):
            section = pattern.format(reader=READERS[name])
            text += f"{section}:\n  ros__parameters: {{{name}: {value}}}\n"
        path.write_text(text)
        assert our_values(path, name) == ros_values(path, name), text


def test_nested_and_dotted_names_mean_what_they_mean_to_ros(tmp_path):
    path = tmp_path / "scenario.yaml"
    for inner in ("controller: {k_v: 0.25}", "controller.k_v: 0.25"):
        path.write_text(
            f"/**:\n  ros__parameters:\n    platoon.followers: {FOLLOWERS}\n    {inner}\n"
            "/platoon:\n  vehicle_3:\n    vehicle:\n      ros__parameters:\n"
            "        controller: {k_v: 0.75}\n"
        )
        assert our_values(path, "controller.k_v") == [0.25, 0.25, 0.75]
        assert ros_values(path, "controller.k_v") == [0.25, 0.25, 0.75]


def test_a_written_scenario_is_read_by_ros(tmp_path):
    text = "/**:\n  ros__parameters: {platoon.followers: 3, controller: {k_p: 1.0e-05, k_v: 1}}\n"
    scenario = parse_scenario(text, "x.yaml", settings=["vehicle_2.controller.k_v=1e-7"])
    path = tmp_path / "scenario.yaml"
    path.write_text(format_scenario(scenario))
    assert ros_values(path, "controller.k_v") == [1.0, 1e-7, 1.0]


def test_sections_for_the_leader_and_the_supervisor_count(tmp_path):
    path = tmp_path / "scenario.yaml"
    leaders = ["/platoon/vehicle_0/leader", "/**/leader", "/platoon/*/leader"]
    supervisors = ["/platoon/supervisor", "/**/supervisor", "/platoon/*"]
    for leader, supervisor in itertools.product(leaders, supervisors):
        path.write_text(
            f"{leader}:\n  ros__parameters: {{leader.amplitude: 0.125}}\n"
            f"{supervisor}:\n  ros__parameters: {{run.seed: 5}}\n"
        )
        scenario = load_scenario(path)
        assert (scenario.leader.amplitude, scenario.run.seed) == (0.125, 5)
