"""The layouts in config/ open what a bag of the paper's platoon holds."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from ruamel.yaml import YAML

from cacc_platoon.scenario import Scenario
from msg_adapters.stamped import Kind
from msg_adapters.topics import Graph, PlatoonTopics, VehicleTopics

CONFIG = Path(__file__).parents[2] / "config"
FIELDS = {
    "geometry_msgs/msg/PoseStamped": "pose.position.x",
    "geometry_msgs/msg/TwistStamped": "twist.linear.x",
    "geometry_msgs/msg/AccelStamped": "accel.linear.x",
    "geometry_msgs/msg/Vector3Stamped": "vector.x",
}


@pytest.fixture(scope="module")
def paths():
    """Every number of a bag as `topic.field`, spacing_error included."""
    topics = Graph.of(Scenario()).run_topics
    topics += [VehicleTopics("/platoon", i).spacing_error for i in range(1, 13)]
    return {f"{topic.name}.{field(topic.kind)}" for topic in topics}


def field(kind: Kind) -> str:
    return FIELDS[kind.type_name]


def test_foxglove(paths):
    layout = json.loads((CONFIG / "foxglove_layout.json").read_text())
    panels = layout["configById"]
    shown = {path["value"] for panel in panels.values() for path in panel.get("paths", ())}
    assert shown <= paths
    assert len(shown) == 13 + 13 + 12 + 1
    assert panels["RawMessages!scenario"]["topicPath"] == PlatoonTopics("/platoon").scenario

    def leaves(node):
        return {node} if isinstance(node, str) else leaves(node["first"]) | leaves(node["second"])

    assert leaves(layout["layout"]) == set(panels)


def test_plotjuggler(paths):
    root = ElementTree.parse(CONFIG / "plotjuggler_layout.xml").getroot()
    snippets = {node.get("name"): node for node in root.iter("snippet")}
    sources = {
        source.text
        for node in snippets.values()
        for source in [*node.iterfind("linked_source"), *node.iterfind("additional_sources/*")]
    }
    curves = {curve.get("name") for curve in root.iter("curve")} - set(snippets)
    slashed = {re.sub(r"\.", "/", path) for path in paths}
    assert sources | curves <= slashed
    assert set(snippets) == {f"{name}_{i}" for name in ("delta", "gap") for i in range(1, 13)}
    defaults = Scenario()
    law = f"{defaults.platoon.standstill_distance} + {defaults.controller.time_headway}"
    assert law in str(snippets["delta_3"].findtext("function"))


def test_rviz():
    config = YAML(typ="safe").load((CONFIG / "platoon.rviz").read_text())
    manager = config["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == VehicleTopics("/platoon", 0).pose.frame_id
    poses = [
        display["Topic"]["Value"]
        for display in manager["Displays"]
        if display["Class"].endswith("/Pose")
    ]
    assert poses == [VehicleTopics("/platoon", i).pose.name for i in range(13)]
