"""Layouts that open a platoon in Foxglove, PlotJuggler 3 and 4 and RViz, for any prefix and N."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from cacc_platoon.errors import UserError
from cacc_platoon.report.layouts.foxglove import foxglove_layout
from cacc_platoon.report.layouts.plotjuggler import plotjuggler3_layout, plotjuggler4_layout
from cacc_platoon.report.layouts.rviz import rviz_layout
from cacc_platoon.report.layouts.view import View, view_of

__all__ = ["VIEWERS", "Layout", "View", "view_of", "write_layouts"]

VIEWERS = ("foxglove", "plotjuggler", "rviz")


class Layout(NamedTuple):
    """One layout on disk.

    Attributes
    ----------
    viewer : str
        Which program reads it.
    file : Path
        Where it is.
    how : str
        How to open it, one line.
    """

    viewer: str
    file: Path
    how: str


def write_layouts(view: View, folder: Path, viewers: Sequence[str] = VIEWERS) -> list[Layout]:
    """Write the layouts of some viewers into a folder, over older ones.

    Parameters
    ----------
    view : View
        Whose platoon is shown, and what it publishes.
    folder : Path
        Is made when it does not exist.
    viewers : sequence of str, optional
        Some of `VIEWERS`; all by default.

    Raises
    ------
    UserError
        When the folder cannot be written.
    """
    layouts, texts = [], []
    for viewer in dict.fromkeys(viewers):
        for layout, text in _layouts(viewer, view, folder):
            layouts.append(layout)
            texts.append(text)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for layout, text in zip(layouts, texts, strict=True):
            layout.file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UserError(
            f"{folder}: the layouts cannot be written ({error.strerror}). "
            "Choose another folder with -o."
        ) from error
    return layouts


def _layouts(viewer: str, view: View, folder: Path) -> list[tuple[Layout, str]]:
    """Return the files of one viewer with their texts; PlotJuggler has one for each version."""
    recording = str(view.storage) if view.storage else "the recording"
    match viewer:
        case "foxglove":
            live = "" if view.storage else ", or connect to platoon watch --web"
            how = f"open {recording}{live}, then Import from file in the list of layouts"
            layout = Layout("Foxglove", folder / "foxglove.json", how)
            return [(layout, foxglove_layout(view))]
        case "plotjuggler":
            return _plotjuggler(view, folder, recording)
        case "rviz":
            file = folder / "platoon.rviz"
            layout = Layout("RViz", file, f"rviz2 -d {file}, during a run or `ros2 bag play`")
            return [(layout, rviz_layout(view))]
    raise UserError(f"{viewer}: is no viewer. Choose among {', '.join(VIEWERS)}.")


def _plotjuggler(view: View, folder: Path, recording: str) -> list[tuple[Layout, str]]:
    old, new = folder / "plotjuggler3.xml", folder / "plotjuggler4.pj4.xml"
    how = f"plotjuggler --layout {old}" + (
        ", which loads the recording too" if view.storage else f", with {recording} open"
    )
    return [
        (Layout("PlotJuggler 3", old, how), plotjuggler3_layout(view, folder)),
        (
            Layout("PlotJuggler 4", new, f"open {recording}, then Load Layout"),
            plotjuggler4_layout(view),
        ),
    ]
