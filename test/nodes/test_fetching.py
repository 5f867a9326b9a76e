"""Which parts are read where they are: what a host says of its folder proves nothing."""

from pathlib import Path

import pytest
import rclpy

from cacc_platoon.dds.domain import own_domain
from cacc_platoon.nodes.executor import create_executor
from cacc_platoon.runs.parts import PartWriter
from cacc_platoon.scenario import Scenario
from cacc_platoon.supervision.fetching import fetch_parts, is_here
from cacc_platoon.supervision.protocol import HostPhase, HostState
from cacc_platoon.supervision.run_state import Run, Stage


@pytest.mark.parametrize(
    ("where", "run", "named", "here"),
    [
        ("parts/host_east", "f00d", "parts", True),
        ("parts/host_east", "another", "parts", False),
        ("parts/host_east", "", "parts", False),
        ("parts/host_east", "f00d", "", False),
        ("elsewhere/host_east", "f00d", "parts", False),
        ("parts/../elsewhere/host_east", "f00d", "parts", False),
        ("parts/host_west", "f00d", "parts", False),
    ],
)
def test_a_part_is_here_below_the_named_folder_and_if_it_is_of_the_run(
    tmp_path: Path, where: str, run: str, named: str, here: bool
) -> None:
    for folder in ("parts", "elsewhere"):
        PartWriter(tmp_path / folder / "host_east", [], run).close()
    values = {
        "run.remote_hosts": ("east=1-2",),
        "record.parts": str(tmp_path / named) if named else "",
    }
    state = HostState("f00d", "east", 7, (), part=str(tmp_path / where))
    found = is_here(Scenario.from_values(values), Run("f00d", Stage.OVER, 0.0), state)
    assert found is here


def test_other_hosts_record_where_the_run_told_them_or_was_told() -> None:
    state = HostState("f00d", "0", 7, (), part="/run/parts/host_0")
    assert is_here(Scenario(), Run("f00d", Stage.OVER, 0.0), state)


def test_a_part_for_which_there_is_no_room_stays_where_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = Scenario.from_values({"run.remote_hosts": ("east=1-2",)})
    east = HostState("f00d", "east", 7, (), part="/there/host_east", phase=HostPhase.CLOSED)
    run = Run("f00d", Stage.OVER, 0.0, hosts={"east": east})
    (tmp_path / "parts").write_text("no folder")
    with own_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        rclpy.init(args=[])
        try:
            node, executor = rclpy.create_node("fetching"), create_executor()
            executor.add_node(node)
            left = fetch_parts(
                scenario,
                run,
                tmp_path / "parts",
                node,
                executor,
                observe=lambda done, total: None,
                given_up=lambda: False,
            )
            executor.shutdown()
            node.destroy_node()
        finally:
            rclpy.shutdown()
    assert left == {"east": "/there/host_east"}
