"""Layouts for PlotJuggler 3 and 4: two formats, both XML.

Version 3 names a curve by one text, and computes curves from others; written is what
`MainWindow::loadLayoutFromFile` of 3.10 to 3.17 reads. Version 4 names topic and field apart;
written is what its published source reads (layout schema 4; PlotDocker.cpp, PlotWidget.cpp and
LayoutXml.cpp of September 2026).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from cacc_platoon.figures.style import spread
from cacc_platoon.report.layouts.plots import MOST_CURVES, Curve, Plot, plots
from cacc_platoon.report.layouts.view import View
from msg_adapters.topics import Topic

Attributes = dict[str, str]


class Area(NamedTuple):
    """One plot: what stands above it, and the attributes of each `curve` element."""

    title: str
    curves: tuple[Attributes, ...]


class Tab(NamedTuple):
    """A page of plots, one above the other."""

    name: str
    areas: tuple[Area, ...]


class Computed(NamedTuple):
    """A curve that PlotJuggler 3 computes at every message of its first source.

    Attributes
    ----------
    name : str
        Its name in the list of curves.
    function : str
        Lua; `value` is the first source, v1, v2, ... are the others.
    sources : tuple of Topic
        What it is computed from.
    """

    name: str
    function: str
    sources: tuple[Topic, ...]


def plotjuggler3_layout(view: View, folder: Path) -> str:
    """Return a layout for PlotJuggler 3; it loads the recording too, where there is one.

    Parameters
    ----------
    view : View
        Whose platoon is shown, and what it publishes.
    folder : Path
        Where the layout will be; the recording is named relative to it.
    """
    followers = _drawn(view)
    gaps = [_gap(view, index) for index in followers]
    errors = (
        [] if view.graph.spacing_error else [_spacing_error(view, index) for index in followers]
    )
    root = Element("root")
    spacing = Tab("gap", (_computed_area(view, "gap [m]", gaps),))
    if errors:
        above = _computed_area(view, "spacing error delta_i [m]", errors)
        spacing = Tab("gap and spacing error", (above, *spacing.areas))
    _add_tabs(root, "Main Window", [spacing, *_recorded_tabs(view, _curve3)])
    SubElement(root, "use_relative_time_offset", enabled="1")
    if view.storage:
        _add_recording(root, view, os.path.relpath(view.storage, folder))
    _add_computed(root, [*errors, *gaps])
    return _text(root)


def plotjuggler4_layout(view: View) -> str:
    """Return a layout for PlotJuggler 4, bound to whatever recording is open.

    Parameters
    ----------
    view : View
        Whose platoon is shown, and what it publishes.
    """
    root = Element("root", format="PlotJuggler", pj4_version="4", binding="generic")
    _add_tabs(root, "main", [*_recorded_tabs(view, _curve4)])
    SubElement(root, "data_processors")
    return _text(root)


def _curve3(curve: Curve) -> Attributes | None:
    if not curve.shown:  # this version cannot hide a curve
        return None
    return {"name": _series(curve.topic), "color": curve.colour}


def _curve4(curve: Curve) -> Attributes | None:
    return {
        "topic": curve.topic.name,
        "field": _path(curve.topic),
        "color": curve.colour,
        "visible": "true" if curve.shown else "false",
    }


def _path(topic: Topic) -> str:
    return topic.kind.field.replace(".", "/")


def _series(topic: Topic) -> str:
    """Return the name that PlotJuggler 3 gives the number in a topic's messages."""
    return f"{topic.name}/{_path(topic)}"


def _recorded_tabs(view: View, attributes: Callable[[Curve], Attributes | None]) -> Iterator[Tab]:
    """Yield the pages of what is in the topics, two plots on each."""
    found = plots(view)
    for k in range(0, len(found), 2):
        pair = found[k : k + 2]
        areas = tuple(_recorded_area(plot, attributes) for plot in pair)
        yield Tab(" and ".join(plot.key for plot in pair), areas)


def _recorded_area(plot: Plot, attributes: Callable[[Curve], Attributes | None]) -> Area:
    curves = tuple(found for curve in plot.curves if (found := attributes(curve)))
    return Area(f"{plot.title} [{plot.unit}]", curves)


def _computed_area(view: View, title: str, curves: Sequence[Computed]) -> Area:
    """Return the plot of one computed curve a follower."""
    colours = [view.colours()[index] for index in _drawn(view)]
    pairs = zip(curves, colours, strict=True)
    return Area(title, tuple({"name": curve.name, "color": colour} for curve, colour in pairs))


def _drawn(view: View) -> list[int]:
    """Return the followers whose computed curves are drawn."""
    indices = view.scenario.indices
    return [indices[place] for place in spread(len(indices), MOST_CURVES)]


def _gap(view: View, index: int) -> Computed:
    """Return x_(i-1) - x_i [m]."""
    own, ahead = view.vehicle(index), view.vehicle(index - 1)
    return Computed(f"gap_{index}", "return v1 - value", (own.pose, ahead.pose))


def _spacing_error(view: View, index: int) -> Computed:
    """Return delta_i = x_i - x_(i-1) + d + h_w v_i [m] with the follower's own d and h_w."""
    own, ahead, follower = view.vehicle(index), view.vehicle(index - 1), view.follower(index)
    distance, headway = follower.standstill_distance, follower.gains.time_headway
    function = f"return value - v1 + {distance!r} + {headway!r} * v2"
    return Computed(f"delta_{index}", function, (own.pose, ahead.pose, own.twist))


def _add_tabs(root: Element, name: str, tabs: Sequence[Tab]) -> None:
    """Add pages; `id` is for version 4, which keeps its state by it."""
    place = {"id": "platoon", "name": name, "parent": "main_window"}
    pages = SubElement(root, "tabbed_widget", place)
    for number, tab in enumerate(tabs):
        tab_id = f"tab_{number}"
        page = SubElement(pages, "Tab", id=tab_id, tab_name=tab.name, containers="1")
        container, count = SubElement(page, "Container"), len(tab.areas)
        sizes = ";".join([f"{1 / count:.8f}"] * count)
        splitter = SubElement(
            container, "DockSplitter", orientation="-", count=str(count), sizes=sizes
        )
        for row, area in enumerate(tab.areas):
            area_id = f"{tab_id}_area_{row}"
            dock = SubElement(splitter, "DockArea", id=area_id, name=area.title)
            plot = SubElement(dock, "plot", id=f"{area_id}_plot", mode="TimeSeries", style="Lines")
            for curve in area.curves:
                SubElement(plot, "curve", curve)
    SubElement(pages, "currentTabIndex", index="0")


def _add_recording(root: Element, view: View, file: str) -> None:
    """Name the file to load with the layout, and the topics to load from it."""
    found = [curve.topic for plot in plots(view) for curve in plot.curves]
    found += [view.vehicle(index).pose for index in view.scenario.vehicles]
    files = SubElement(root, "previouslyLoaded_Datafiles")
    info = SubElement(files, "fileInfo", filename=file, prefix="")
    loader = SubElement(info, "plugin", ID="DataLoad MCAP")
    settings = {
        "use_timestamp": "1",  # the stamp in the header: when it was measured
        "use_mcap_log_time": "0",
        "clamp_large_arrays": "0",
        "max_array_size": "100",
        "selected_topics": ";".join(sorted({topic.name for topic in found})),
    }
    SubElement(loader, "parameters", settings)


def _add_computed(root: Element, curves: Sequence[Computed]) -> None:
    equations = SubElement(root, "customMathEquations")
    for curve in curves:
        snippet = SubElement(equations, "snippet", name=curve.name)
        SubElement(snippet, "global")
        SubElement(snippet, "function").text = curve.function
        SubElement(snippet, "linked_source").text = _series(curve.sources[0])
        others = SubElement(snippet, "additional_sources")
        for number, topic in enumerate(curve.sources[1:], 1):
            SubElement(others, f"v{number}").text = _series(topic)


def _text(root: Element) -> str:
    indent(root, " ")
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{tostring(root, encoding='unicode')}\n"
