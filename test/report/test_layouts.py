"""Layouts show exactly what a platoon publishes, for any prefix, indices and number of vehicles."""

import json
import re
import xml.dom.minidom
from pathlib import Path

import pytest
import yaml  # PyYAML, not the library that writes the layouts
from rosbags.typesys import Stores, get_typestore

from cacc_platoon.errors import UserError
from cacc_platoon.report.layouts import VIEWERS, View, write_layouts
from cacc_platoon.report.layouts.plots import MOST_CURVES
from cacc_platoon.scenario import Scenario

ROS = get_typestore(Stores.ROS2_JAZZY)
TYPES = {
    "pose": "geometry_msgs/msg/PoseStamped",
    "twist": "geometry_msgs/msg/TwistStamped",
    "accel": "geometry_msgs/msg/AccelStamped",
    "v2v/accel": "geometry_msgs/msg/AccelStamped",
    "command": "geometry_msgs/msg/AccelStamped",
    "spacing_error": "geometry_msgs/msg/Vector3Stamped",
}
PLATOONS = {
    "the paper's": {},
    "one follower": {"platoon.followers": 1},
    "fifty": {"platoon.followers": 50},
    "another prefix": {"platoon.namespace": "/lab/green", "platoon.followers": 4},
    "chained": {"platoon.first_follower": 9, "platoon.followers": 4},
    "all recorded": {"record.command": True, "record.spacing_error": True},
}


@pytest.fixture(params=PLATOONS.values(), ids=PLATOONS.keys())
def scenario(request):
    return Scenario.from_values(request.param)


@pytest.fixture
def files(scenario, tmp_path):
    layouts = write_layouts(View.of_scenario(scenario), tmp_path)
    return {layout.viewer: layout.file for layout in layouts}


def published(scenario):
    """Return the topics that the README's graph names, with their types."""
    prefix, platoon = scenario.platoon.namespace, scenario.platoon
    leader = platoon.first_follower - 1
    names = {f"{prefix}/vehicle_{leader}/{name}" for name in ("pose", "twist", "accel")}
    own = ["pose", "twist", "accel", "v2v/accel"]
    own += ["command"] if scenario.record.command else []
    own += ["spacing_error"] if scenario.record.spacing_error else []
    for index in range(leader + 1, leader + 1 + platoon.followers):
        names |= {f"{prefix}/vehicle_{index}/{name}" for name in own}
    return {name: TYPES[re.sub(r".*/vehicle_\d+/", "", name)] for name in names}


def numbers(scenario, separator):
    """Return every float of these topics as `topic<separator>field`."""
    return {
        (topic, separator.join(path))
        for topic, kind in published(scenario).items()
        for path in floats(kind)
    }


def floats(kind):
    """Yield the path of each float64 of a message type, as ROS defines it."""
    for name, (node, detail) in ROS.get_msgdef(kind).fields:
        if node.name == "NAME":
            yield from ((name, *rest) for rest in floats(detail))
        elif detail[0] == "float64":
            yield (name,)


def vehicles(scenario):
    first = scenario.platoon.first_follower
    return range(first - 1, first + scenario.platoon.followers)


def expected_curves(scenario):
    """Return what must be shown: along the road only, of every vehicle that publishes it."""
    fields = {
        "twist": "twist.linear.x",
        "accel": "accel.linear.x",
        "command": "accel.linear.x",
        "spacing_error": "vector.x",
    }
    prefix, first = scenario.platoon.namespace, scenario.platoon.first_follower
    curves = {
        (topic, fields[topic.rpartition("/")[2]])
        for topic in published(scenario)
        if topic.rpartition("/")[2] in fields and "/v2v/" not in topic
    }
    return curves | {(f"{prefix}/vehicle_{first}/v2v/accel", "accel.linear.x")}


def test_foxglove(scenario, files):
    layout = json.loads(files["Foxglove"].read_text())
    panels = layout["configById"]
    series = [path for panel in panels.values() for path in panel.get("paths", ())]
    shown = {split_foxglove(path["value"]) for path in series}
    assert shown == expected_curves(scenario)
    assert shown <= numbers(scenario, ".")
    assert all(path["timestampMethod"] == "headerStamp" for path in series)
    for name, panel in panels.items():
        if name.startswith("Plot!"):
            assert sum(path["enabled"] for path in panel["paths"]) <= MOST_CURVES
            assert panel["paths"][0]["enabled"]
            assert panel["paths"][-1]["enabled"]
    prefix = scenario.platoon.namespace
    poses = [f"{prefix}/vehicle_{i}/pose" for i in vehicles(scenario)]
    assert list(panels["3D!platoon"]["topics"]) == [*poses, f"{prefix}/markers"]
    assert panels["RawMessages!scenario"]["topicPath"] == f"{prefix}/scenario"
    assert sorted(leaves(layout["layout"])) == sorted(panels)


def split_foxglove(path):
    """Split a message path where the topic's last `/` part ends."""
    topic, _, field = path.partition(".")
    return topic, field


def leaves(node):
    return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]


def test_plotjuggler_3(scenario, files):
    document = xml.dom.minidom.parse(str(files["PlotJuggler 3"]))
    snippets = {s.getAttribute("name"): s for s in document.getElementsByTagName("snippet")}
    curves = [c.getAttribute("name") for c in document.getElementsByTagName("curve")]
    known = {f"{topic}/{field}" for topic, field in numbers(scenario, "/")}
    assert set(curves) <= known | set(snippets)
    assert set(snippets) <= set(curves)
    for snippet in snippets.values():
        [linked] = snippet.getElementsByTagName("linked_source")
        others = snippet.getElementsByTagName("additional_sources")[0]
        sources = [
            linked,
            *(node for node in others.childNodes if node.nodeType == node.ELEMENT_NODE),
        ]
        assert {source.firstChild.data for source in sources} <= known
    followers = list(vehicles(scenario))[1:]
    drawn = {f"gap_{i}" for i in (followers[0], followers[-1])}
    if scenario.record.spacing_error:
        assert not any(name.startswith("delta") for name in snippets)
    else:
        drawn |= {f"delta_{i}" for i in (followers[0], followers[-1])}
    assert drawn <= set(snippets)
    if len(followers) <= MOST_CURVES:
        expected = {f"{t}/{f.replace('.', '/')}" for t, f in expected_curves(scenario)}
        assert set(curves) - set(snippets) == expected
    check_docks(document)


def test_plotjuggler_4(scenario, files):
    document = xml.dom.minidom.parse(str(files["PlotJuggler 4"]))
    root = document.documentElement
    assert (root.tagName, root.getAttribute("pj4_version")) == ("root", "4")
    assert root.getAttribute("binding") == "generic"
    curves = document.getElementsByTagName("curve")
    shown = {(c.getAttribute("topic"), c.getAttribute("field")) for c in curves}
    assert shown == {(t, f.replace(".", "/")) for t, f in expected_curves(scenario)}
    assert shown <= numbers(scenario, "/")
    for plot in document.getElementsByTagName("plot"):
        visible = [c.getAttribute("visible") for c in plot.getElementsByTagName("curve")]
        assert visible.count("true") <= MOST_CURVES
    check_docks(document)
    ids = [e.getAttribute("id") for e in document.getElementsByTagName("*") if e.hasAttribute("id")]
    assert len(set(ids)) == len(ids)


def check_docks(document):
    """Check what the reader of PlotJuggler 4 demands; that of 3 demands less."""

    def elements(node):
        return [child for child in node.childNodes if child.nodeType == child.ELEMENT_NODE]

    for tab in document.getElementsByTagName("Tab"):
        [container] = elements(tab)
        assert tab.getAttribute("containers") == "1"
        [splitter] = elements(container)
        areas = elements(splitter)
        assert splitter.getAttribute("orientation") in "-|"
        assert int(splitter.getAttribute("count")) == len(areas) > 0
        sizes = [float(size) for size in splitter.getAttribute("sizes").split(";")]
        assert len(sizes) == len(areas)
        assert sum(sizes) == pytest.approx(1.0)
        for area in areas:
            [plot] = elements(area)
            assert plot.tagName == "plot"
            assert elements(plot)


def test_rviz(scenario, files):
    config = yaml.safe_load(files["RViz"].read_text())
    manager = config["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == "map"
    displays = {display["Name"]: display for display in manager["Displays"]}
    prefix = scenario.platoon.namespace
    poses = {
        name: display["Topic"]["Value"]
        for name, display in displays.items()
        if display["Class"] == "rviz_default_plugins/Pose"
    }
    assert poses == {f"vehicle {i}": f"{prefix}/vehicle_{i}/pose" for i in vehicles(scenario)}
    assert displays["markers"]["Topic"]["Value"] == f"{prefix}/markers"


def test_the_computed_spacing_error_is_that_of_the_vehicle(tmp_path):
    values = {"platoon.followers": 3, "platoon.standstill_distance": 7.5}
    scenario = Scenario.from_values(values, {2: {"controller.time_headway": 1.25}})
    write_layouts(View.of_scenario(scenario), tmp_path, ["plotjuggler"])
    document = xml.dom.minidom.parse(str(tmp_path / "plotjuggler3.xml"))
    functions = {
        snippet.getAttribute("name"): snippet.getElementsByTagName("function")[0].firstChild.data
        for snippet in document.getElementsByTagName("snippet")
    }
    assert functions["delta_1"] == "return value - v1 + 7.5 + 0.95 * v2"
    assert functions["delta_2"] == "return value - v1 + 7.5 + 1.25 * v2"
    assert functions["gap_2"] == "return v1 - value"


def test_plotjuggler_3_loads_the_recording_with_the_layout(tmp_path):
    view = View.of_scenario(Scenario(), tmp_path / "run" / "bag" / "bag.mcap")
    write_layouts(view, tmp_path / "run" / "layouts", ["plotjuggler"])
    document = xml.dom.minidom.parse(str(tmp_path / "run" / "layouts" / "plotjuggler3.xml"))
    [file] = document.getElementsByTagName("fileInfo")
    assert file.getAttribute("filename") == str(Path("..") / "bag" / "bag.mcap")
    [plugin] = file.getElementsByTagName("plugin")
    assert plugin.getAttribute("ID") == "DataLoad MCAP"
    [parameters] = plugin.getElementsByTagName("parameters")
    loaded = set(parameters.getAttribute("selected_topics").split(";"))
    assert loaded <= set(published(view.scenario))
    curves = {curve.getAttribute("name") for curve in document.getElementsByTagName("curve")}
    for source in document.getElementsByTagName("linked_source"):
        curves.add(source.firstChild.data)
    assert all(any(c.startswith(f"{t}/") for t in loaded) for c in curves if c.startswith("/"))


def test_only_the_viewers_asked_for(tmp_path):
    layouts = write_layouts(View.of_scenario(Scenario()), tmp_path, ["rviz", "foxglove", "rviz"])
    assert [layout.viewer for layout in layouts] == ["RViz", "Foxglove"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["foxglove.json", "platoon.rviz"]
    assert set(VIEWERS) == {"foxglove", "plotjuggler", "rviz"}
    with pytest.raises(UserError, match="rqt: is no viewer"):
        write_layouts(View.of_scenario(Scenario()), tmp_path, ["rqt"])


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot be written"):
        write_layouts(View.of_scenario(Scenario()), tmp_path / "file" / "layouts")
