"""One figure of a page: what it is called, what it shows and how it is drawn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from cacc_platoon.figures.style import draw_png, draw_svg, standalone
from cacc_platoon.notation import as_text


class Picture(NamedTuple):
    """One figure: its file name, what it shows, and how to draw it.

    Attributes
    ----------
    name : str
        File name without suffix.
    title, caption : str
        What it shows.
    draw : callable
        Draws on the axes it is given, `rows` times `columns` of them.
    rows, columns : int
        How the axes are arranged.
    height : float
        Height [inch].
    """

    name: str
    title: str
    caption: str
    draw: Callable[..., None]
    rows: int = 1
    height: float = 3.1
    columns: int = 1

    def svg(self) -> str:
        """Draw it for a page."""
        return draw_svg(as_text(self.title), self.draw, self.rows, self.height, self.columns)

    def save(self, folder: Path) -> list[Path]:
        """Draw it into files, SVG and PNG, the same bytes every time."""
        svg, png = folder / f"{self.name}.svg", folder / f"{self.name}.png"
        svg.write_text(standalone(self.svg()), encoding="utf-8")
        png.write_bytes(draw_png(self.title, self.draw, self.rows, self.height, self.columns))
        return [svg, png]
