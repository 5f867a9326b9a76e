"""A configuration for RViz 2: the vehicles as arrows, and their markers where a node draws them."""

from __future__ import annotations

import io
from typing import Any

from ruamel.yaml import YAML

from cacc_platoon.report.layouts.view import View

WIDTH, HEIGHT = 1600, 900


def rviz_layout(view: View) -> str:
    """Return the configuration as YAML text.

    Parameters
    ----------
    view : View
        Whose platoon is shown.
    """
    document = {
        "Panels": [
            {"Class": "rviz_common/Displays", "Name": "Displays"},
            {"Class": "rviz_common/Time", "Name": "Time"},
        ],
        "Visualization Manager": _manager(view),
        "Window Geometry": {"Height": HEIGHT, "Width": WIDTH},
    }
    buffer = io.StringIO()
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.dump(document, buffer)
    return buffer.getvalue()


def _manager(view: View) -> dict[str, Any]:
    frame = _frame(view)
    poses = [_pose(view, index, colour) for index, colour in view.colours().items()]
    return {
        "Class": "",
        "Global Options": {
            "Background Color": "48; 48; 48",
            "Fixed Frame": frame,
            "Frame Rate": 30,
        },
        "Displays": [_grid(frame), _markers(view.graph.platoon.markers), *poses],
        "Tools": [
            {"Class": f"rviz_default_plugins/{tool}"}
            for tool in ("MoveCamera", "FocusCamera", "Measure")
        ],
        "Views": {
            "Current": {
                "Class": "rviz_default_plugins/TopDownOrtho",
                "Name": "Current View",
                "Scale": round(0.8 * WIDTH / (view.length + 20.0), 3),  # pixels per metre
                "X": -view.length / 2.0,
                "Y": 0,
            }
        },
        "Value": True,
    }


def _frame(view: View) -> str:
    """Return the frame that poses are given in."""
    return view.vehicle(view.scenario.leader_index).pose.frame_id


def _grid(frame: str) -> dict[str, Any]:
    return {
        "Class": "rviz_default_plugins/Grid",
        "Name": "road",
        "Enabled": True,
        "Cell Size": 10,
        "Plane Cell Count": 1000,
        "Reference Frame": frame,
    }


def _markers(topic: str) -> dict[str, Any]:
    return {
        "Class": "rviz_default_plugins/MarkerArray",
        "Name": "markers",
        "Enabled": True,
        "Topic": _subscription(topic),
    }


def _pose(view: View, index: int, colour: str) -> dict[str, Any]:
    red, green, blue = bytes.fromhex(colour[1:])
    return {
        "Class": "rviz_default_plugins/Pose",
        "Name": f"vehicle {index}",
        "Enabled": True,
        "Shape": "Arrow",
        "Color": f"{red}; {green}; {blue}",
        "Alpha": 1,
        "Shaft Length": 3,
        "Shaft Radius": 0.8,
        "Head Length": 1.8,
        "Head Radius": 1.6,
        "Topic": _subscription(view.vehicle(index).pose.name),
    }


def _subscription(topic: str) -> dict[str, Any]:
    return {
        "Value": topic,
        "Depth": 5,
        "History Policy": "Keep Last",
        "Reliability Policy": "Reliable",
        "Durability Policy": "Volatile",
    }
