"""Layouts show exactly what a platoon publishes, for any prefix, indices and number of vehicles."""

import json
import re
import xml.dom.minidom
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml  # PyYAML, not the library that writes the layouts
from rosbags.typesys import Stores, get_typestore

from cacc_platoon.bags.rows import TopicRows
from cacc_platoon.cli import layout as layout_verb
from cacc_platoon.cli import main
from cacc_platoon.errors import UserError
from cacc_platoon.report.layouts import VIEWERS, View, write_layouts
from cacc_platoon.report.layouts.plots import MOST_CURVES
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import simulate
from msg_adapters.topics import VehicleTopics

ROS = get_typestore(Stores.ROS2_JAZZY)
TYPES = {
    "pose": "geometry_msgs/msg/PoseStamped",
    "twist": "geometry_msgs/msg/TwistStamped",
    "accel": "geometry_msgs/msg/AccelStamped",
    "v2v/accel": "geometry_msgs/msg/AccelStamped",
    "command": "geometry_msgs/msg/AccelStamped",
    "spacing_error": "geometry_msgs/msg/Vector3Stamped",
}
PLATOONS: dict[str, dict[str, object]] = {
    "the paper's": {},
    "one follower": {"platoon.followers": 1},
    "fifty": {"platoon.followers": 50},
    "another prefix": {"platoon.namespace": "/lab/green", "platoon.followers": 4},
    "chained": {"platoon.first_follower": 9, "platoon.followers": 4},
    "all recorded": {"record.command": True, "record.spacing_error": True},
}


@pytest.fixture(params=PLATOONS.values(), ids=list(PLATOONS))
def shown(request):
    return Scenario.from_values(request.param)


@pytest.fixture
def files(shown, tmp_path):
    layouts = write_layouts(View.of_scenario(shown), tmp_path)
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


def test_foxglove(shown, files):
    layout = json.loads(files["Foxglove"].read_text())
    panels = layout["configById"]
    series = [path for panel in panels.values() for path in panel.get("paths", ())]
    drawn = {split_foxglove(path["value"]) for path in series}
    assert drawn == expected_curves(shown)
    assert drawn <= numbers(shown, ".")
    assert all(path["timestampMethod"] == "headerStamp" for path in series)
    for name, panel in panels.items():
        if name.startswith("Plot!"):
            assert sum(path["enabled"] for path in panel["paths"]) <= MOST_CURVES
            assert panel["paths"][0]["enabled"]
            assert panel["paths"][-1]["enabled"]
    prefix = shown.platoon.namespace
    poses = [f"{prefix}/vehicle_{i}/pose" for i in vehicles(shown)]
    assert list(panels["3D!platoon"]["topics"]) == [*poses, f"{prefix}/markers"]
    assert panels["RawMessages!scenario"]["topicPath"] == f"{prefix}/scenario"
    assert sorted(leaves(layout["layout"])) == sorted(panels)


def split_foxglove(path):
    """Split a message path where the topic's last `/` part ends."""
    topic, _, field = path.partition(".")
    return topic, field


def leaves(node):
    return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]


def test_plotjuggler_3(shown, files):
    document = xml.dom.minidom.parse(str(files["PlotJuggler 3"]))
    snippets = {s.getAttribute("name"): s for s in document.getElementsByTagName("snippet")}
    curves = [c.getAttribute("name") for c in document.getElementsByTagName("curve")]
    known = {f"{topic}/{field}" for topic, field in numbers(shown, "/")}
    assert set(curves) <= known | set(snippets)
    assert set(snippets) <= set(curves)
    for snippet in snippets.values():
        [linked] = snippet.getElementsByTagName("linked_source")
        others = snippet.getElementsByTagName("additional_sources")[0]
        sources = [
            linked,
            *(node for node in others.childNodes if node.nodeType == node.ELEMENT_NODE),
        ]
        assert {text(source) for source in sources} <= known
    followers = list(vehicles(shown))[1:]
    drawn = {f"gap_{i}" for i in (followers[0], followers[-1])}
    if shown.record.spacing_error:
        assert not any(name.startswith("delta") for name in snippets)
    else:
        drawn |= {f"delta_{i}" for i in (followers[0], followers[-1])}
    assert drawn <= set(snippets)
    if len(followers) <= MOST_CURVES:
        expected = {f"{t}/{f.replace('.', '/')}" for t, f in expected_curves(shown)}
        assert set(curves) - set(snippets) == expected
    check_docks(document)


def test_plotjuggler_4(shown, files):
    document = xml.dom.minidom.parse(str(files["PlotJuggler 4"]))
    [root] = [node for node in document.childNodes if node.nodeType == node.ELEMENT_NODE]
    assert (root.tagName, root.getAttribute("pj4_version")) == ("root", "4")
    assert root.getAttribute("binding") == "generic"
    curves = document.getElementsByTagName("curve")
    drawn = {(c.getAttribute("topic"), c.getAttribute("field")) for c in curves}
    assert drawn == {(t, f.replace(".", "/")) for t, f in expected_curves(shown)}
    assert drawn <= numbers(shown, "/")
    for plot in document.getElementsByTagName("plot"):
        visible = [c.getAttribute("visible") for c in plot.getElementsByTagName("curve")]
        assert visible.count("true") <= MOST_CURVES
    check_docks(document)
    ids = [e.getAttribute("id") for e in document.getElementsByTagName("*") if e.hasAttribute("id")]
    assert len(set(ids)) == len(ids)


def text(element: Any) -> str:
    """Return the text inside of an XML element."""
    return str(element.firstChild.data)


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


def test_rviz(shown, files):
    config = yaml.safe_load(files["RViz"].read_text())
    manager = config["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == "map"
    displays = {display["Name"]: display for display in manager["Displays"]}
    prefix = shown.platoon.namespace
    poses = {
        name: display["Topic"]["Value"]
        for name, display in displays.items()
        if display["Class"] == "rviz_default_plugins/Pose"
    }
    assert poses == {f"vehicle {i}": f"{prefix}/vehicle_{i}/pose" for i in vehicles(shown)}
    assert displays["markers"]["Topic"]["Value"] == f"{prefix}/markers"


def test_what_plotjuggler_3_computes_is_what_the_simulation_has(tmp_path):
    values = {"platoon.followers": 3, "platoon.standstill_distance": 7.5, "run.duration": 12.0}
    scenario = Scenario.from_values(values, {2: {"controller.time_headway": 1.25}})
    write_layouts(View.of_scenario(scenario), tmp_path, ["plotjuggler"])
    run = simulate(scenario)
    signals = {}
    for column in range(4):
        vehicle = f"/platoon/vehicle_{column}"
        signals[f"{vehicle}/pose/pose/position/x"] = run.position[:, column]
        signals[f"{vehicle}/twist/twist/linear/x"] = run.velocity[:, column]
    document = xml.dom.minidom.parse(str(tmp_path / "plotjuggler3.xml"))
    computed = {
        snippet.getAttribute("name"): computed_curve(snippet, signals)
        for snippet in document.getElementsByTagName("snippet")
    }
    for column in range(3):
        error, gap = run.spacing_error[:, column], run.gap[:, column]
        assert computed[f"delta_{column + 1}"] == pytest.approx(error, abs=1e-9)
        assert computed[f"gap_{column + 1}"] == pytest.approx(gap)
    assert np.abs(run.spacing_error).max() > 1e-3


def computed_curve(snippet: Any, signals: dict[str, Any]) -> Any:
    """Evaluate a curve's function, whose Lua is arithmetic that Python has too."""
    names = {"value": signals[text(snippet.getElementsByTagName("linked_source")[0])]}
    others = snippet.getElementsByTagName("additional_sources")[0]
    for node in others.childNodes:
        if node.nodeType == node.ELEMENT_NODE:
            names[node.tagName] = signals[text(node)]
    function = text(snippet.getElementsByTagName("function")[0])
    assert function.startswith("return ")
    return eval(function.removeprefix("return "), {}, names)


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
        curves.add(text(source))
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


def run_layout(capsys, *arguments):
    """Run the verb and return its exit code and the object it prints."""
    code = main(["layout", "--json", *map(str, arguments)])
    out, error = capsys.readouterr()
    return code, json.loads(out) if out else error


def test_a_run_folder_gets_them_inside(bags, tmp_path, capsys):
    values = {"platoon.namespace": "/lab/green", "record.command": True}
    run = bags.run(tmp_path / "run", bags.scenario(values)).path
    code, answer = run_layout(capsys, run)
    assert (code, answer["format"]) == (0, 1)
    files = {layout["viewer"]: Path(layout["file"]) for layout in answer["layouts"]}
    assert set(files) == {"Foxglove", "PlotJuggler 3", "PlotJuggler 4", "RViz"}
    assert {file.parent for file in files.values()} == {run / "layouts"}
    assert "/lab/green/vehicle_1/command.accel.linear.x" in files["Foxglove"].read_text()
    [loaded] = xml.dom.minidom.parse(str(files["PlotJuggler 3"])).getElementsByTagName("fileInfo")
    assert (run / "layouts" / loaded.getAttribute("filename")).resolve().is_file()
    assert str(run / "bag" / "bag.mcap") in answer["layouts"][0]["open"]


def test_a_scenario_file_gets_them_in_the_working_folder(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = Path("mine.yaml")
    file.write_text("/**: {ros__parameters: {platoon: {followers: 2}}}\n")
    code, answer = run_layout(capsys, file, "--for", "rviz", "--set", "platoon.followers=3")
    assert code == 0
    assert [layout["file"] for layout in answer["layouts"]] == ["mine_layouts/platoon.rviz"]
    assert "vehicle_3" in Path("mine_layouts/platoon.rviz").read_text()


def test_a_bag_of_another_tool_shows_what_is_in_it(bags, tmp_path, capsys):
    scenario = bags.scenario({"platoon.namespace": "/other", "platoon.first_follower": 5})
    recording = bags.record(scenario)
    error = VehicleTopics("/other", 5).spacing_error
    stamps = [k * scenario.step_ns for k in range(scenario.samples)]
    messages = error.codec.encode_many(stamps, [0.0] * len(stamps))
    recording[error.name] = TopicRows(error.kind.type_name, messages)
    bag = bags.foreign(tmp_path / "taken", scenario, recording)
    code, answer = run_layout(capsys, bag)
    assert code == 0
    layouts = tmp_path / "taken_layouts"
    assert {Path(layout["file"]).parent for layout in answer["layouts"]} == {layouts}
    text = (layouts / "foxglove.json").read_text()
    assert "/other/vehicle_5/spacing_error.vector.x" in text
    assert "/other/vehicle_5/command" not in text
    # sqlite3 is nothing that PlotJuggler's MCAP loader reads
    assert "fileInfo" not in (layouts / "plotjuggler3.xml").read_text()


def test_what_holds_no_platoon_is_refused_in_one_line(tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    assert main(["layout", str(tmp_path / "empty")]) == 2
    assert "holds no .mcap or .db3 file" in capsys.readouterr().err
    assert main(["layout", str(tmp_path / "none.yaml")]) == 2
    assert "none.yaml: cannot be read" in capsys.readouterr().err


def test_the_values_of_a_recording_cannot_be_set(whole_run, capsys):
    assert main(["layout", str(whole_run), "--set", "platoon.followers=3"]) == 2
    assert "was recorded with its own parameters" in capsys.readouterr().err


def test_the_viewers_of_the_command_are_those_of_the_library():
    assert layout_verb.VIEWERS == VIEWERS


def test_without_json_every_file_is_named_with_how_to_open_it(whole_run, tmp_path, capsys):
    assert main(["layout", str(whole_run), "-o", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    for file in (tmp_path / "out").iterdir():
        assert str(file) in out
    assert "Import from file" in out
    assert "plotjuggler --layout" in out
    assert "rviz2 -d" in out
