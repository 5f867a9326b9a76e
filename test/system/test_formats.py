"""Files of real nodes: what they write fits the schemas, what older ones wrote is replayed."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import rclpy
from jsonschema import Draft202012Validator
from rclpy.context import Context
from rclpy.node import Node
from std_msgs.msg import String

from cacc_platoon.dds.domain import own_domain
from cacc_platoon.nodes import qos
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario
from cacc_platoon.scenario.table import TABLE

ROOT = Path(__file__).parents[2]
OLD = ROOT / "test" / "data" / "format_0"
PATIENCE = 60.0


def valid(name: str, document: object) -> bool:
    schema = json.loads((ROOT / "docs" / "formats" / f"{name}.schema.json").read_text())
    assert [error.message for error in Draft202012Validator(schema).iter_errors(document)] == []
    return True


def command(*arguments: object) -> "subprocess.CompletedProcess[str]":
    line = [sys.executable, "-m", "cacc_platoon", *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, timeout=PATIENCE)


def test_what_a_run_on_nodes_writes_fits_the_schemas(platoon) -> None:
    settings = ("run.duration=3", "run.real_time_factor=1", "record.command=true")
    run = platoon("platoon.followers=2", *settings)
    received: dict[str, list[String]] = {"host_state": [], "status": []}
    for name, messages in received.items():
        run.subscribe(String, f"/platoon/{name}", messages.append, qos.latched())
    run.wait(lambda: all(received.values()), PATIENCE, "messages of hosts and supervisor")
    result = run.result()
    assert result.exit_code == 0, result.errors
    folder = run.folder.path
    document = json.loads((folder / "run.json").read_text())
    assert valid("run", document)
    assert document["hosts"]
    for name, messages in received.items():
        assert all(valid(name, json.loads(message.data)) for message in messages)
    done = command("report", folder, "--json")
    assert valid("metrics", json.loads(done.stdout)), done.stderr


@pytest.mark.usefixtures("nothing_left")
@pytest.mark.parametrize("node", ["vehicle", "noise_relay", "leader"])
def test_an_old_run_is_replayed_bit_for_bit(tmp_path: Path, node: str) -> None:
    run = shutil.copytree(OLD / "run", tmp_path / "run")
    vehicle = 0 if node == "leader" else 2
    done = command("replay", run, "--vehicle", vehicle, "--node", node, "--json")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert valid("replay", document)
    assert document["identical"]


def test_ros_reads_a_scenario_with_its_version(tmp_path: Path) -> None:
    """The comment is none of ROS's business: its own reader gives every parameter to a node."""
    scenario = Scenario.from_values({"platoon.followers": 3, "vehicle.tau": [0.5, 0.4, 0.3]})
    file = tmp_path / "scenario.yaml"
    file.write_text(format_scenario(scenario))
    assert "# cacc_platoon scenario, format 1\n" in file.read_text()
    context = Context()
    with own_domain() as domain:
        arguments = ["--ros-args", "--params-file", str(file)]
        rclpy.init(args=arguments, context=context, domain_id=domain)
        try:
            node = Node(
                "vehicle", context=context, automatically_declare_parameters_from_overrides=True
            )
            found = {name: p.value for name, p in node.get_parameters_by_prefix("").items()}
            node.destroy_node()
        finally:
            rclpy.try_shutdown(context=context)
    for name, value in scenario.values().items():
        if value not in ((), "") or name in found:
            assert TABLE[name].check(_plain(found[name]), "ros") == value, name


def _plain(value: Any) -> object:
    return value if isinstance(value, str | int | float | bool) else list(value)
