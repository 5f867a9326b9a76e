"""A layout for Foxglove (and Lichtblick), as `Import from file` reads it.

The keys of the panels are those of `foxglove.layouts` in the Foxglove SDK; only the panel's title
has a key of its own in each program.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from cacc_platoon.report.layouts.plots import Curve, Plot, plots
from cacc_platoon.report.layouts.view import View

TITLES = ("foxglovePanelTitle", "lichtblickPanelTitle")


class Panel(Protocol):
    """One panel: an id, which begins with its type, and its settings."""

    @property
    def id(self) -> str:
        """The id by which the arrangement refers to it."""
        ...

    def settings(self) -> dict[str, Any]:
        """Return what `configById` holds for it."""
        ...


@dataclass(frozen=True)
class PlotPanel:
    """Curves over the time in their messages' headers."""

    plot: Plot

    @property
    def id(self) -> str:
        """The panel's id."""
        return f"Plot!{self.plot.key}"

    def settings(self) -> dict[str, Any]:
        """Return the panel's settings."""
        return {
            **dict.fromkeys(TITLES, f"{self.plot.title} [{self.plot.unit}]"),
            "paths": [_series(curve) for curve in self.plot.curves],
            "yAxisLabel": self.plot.unit,
            "xAxisVal": "timestamp",
            "isSynced": True,
            "showXAxisLabels": True,
            "showYAxisLabels": True,
            "showLegend": True,
            "legendDisplay": "floating",
            "showPlotValuesInLegend": False,
            "sidebarDimension": 240,
        }


@dataclass(frozen=True)
class ScenePanel:
    """The vehicles along the road, seen obliquely from above."""

    view: View

    @property
    def id(self) -> str:
        """The panel's id."""
        return "3D!platoon"

    def settings(self) -> dict[str, Any]:
        """Return the panel's settings."""
        view, graph = self.view, self.view.graph
        topics: dict[str, Any] = {
            view.vehicle(index).pose.name: {"visible": True, "type": "arrow", "color": colour}
            for index, colour in view.colours().items()
        }
        topics[graph.platoon.markers] = {"visible": True}
        return {
            **dict.fromkeys(TITLES, f"Platoon {graph.prefix}"),
            "cameraState": _camera(view.length),
            "followMode": "follow-none",
            "followTf": view.vehicle(view.scenario.leader_index).pose.frame_id,
            "scene": {},
            "transforms": {},
            "topics": topics,
            "layers": {"grid": _grid()},
            "imageMode": {},
        }


@dataclass(frozen=True)
class TextPanel:
    """The messages of a topic as they are."""

    key: str
    topic: str

    @property
    def id(self) -> str:
        """The panel's id."""
        return f"RawMessages!{self.key}"

    def settings(self) -> dict[str, Any]:
        """Return the panel's settings."""
        return {
            **dict.fromkeys(TITLES, self.topic),
            "topicPath": self.topic,
            "diffEnabled": False,
            "expansion": "all",
        }


def foxglove_layout(view: View) -> str:
    """Return the layout as JSON text.

    Parameters
    ----------
    view : View
        Whose platoon is shown, and what it publishes.
    """
    curves = [PlotPanel(plot) for plot in plots(view)]
    scenario = TextPanel("scenario", view.graph.platoon.scenario)
    scene = ScenePanel(view)
    panels: list[Panel] = [*curves, scene, scenario]
    right = _split("column", 65, scene.id, scenario.id)
    layout = {
        "configById": {panel.id: panel.settings() for panel in panels},
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1.0},
        "layout": _split("row", 60, _stack([panel.id for panel in curves]), right),
    }
    return json.dumps(layout, indent=1, allow_nan=False) + "\n"


def _series(curve: Curve) -> dict[str, Any]:
    return {
        "value": f"{curve.topic.name}.{curve.topic.kind.field}",
        "enabled": curve.shown,
        "timestampMethod": "headerStamp",
        "label": curve.label,
        "color": curve.colour,
    }


def _stack(panels: Sequence[str]) -> Any:
    """Return the arrangement of panels one above the other, all of one height."""
    if len(panels) == 1:
        return panels[0]
    half = len(panels) // 2
    return _split("column", 100 * half / len(panels), _stack(panels[:half]), _stack(panels[half:]))


def _split(direction: str, percentage: float, first: Any, second: Any) -> dict[str, Any]:
    return {
        "direction": direction,
        "splitPercentage": percentage,
        "first": first,
        "second": second,
    }


def _camera(length: float) -> dict[str, Any]:
    """Return a camera that has the whole platoon before it; vehicles start at 0 and behind."""
    return {
        "perspective": True,
        "distance": 1.4 * length + 20.0,
        "phi": 45,
        "thetaOffset": 90,
        "targetOffset": [-length / 2.0, 0, 0],
        "target": [0, 0, 0],
        "targetOrientation": [0, 0, 0, 1],
        "fovy": 45,
        "near": 0.5,
        "far": 20000,
    }


def _grid() -> dict[str, Any]:
    return {
        "layerId": "foxglove.Grid",
        "instanceId": "grid",
        "label": "Grid",
        "visible": True,
        "frameLocked": True,
        "size": 2000,
        "divisions": 100,
        "lineWidth": 1,
        "color": "#9e9e9e80",
        "position": [0, 0, 0],
        "rotation": [0, 0, 0],
    }
