"""One figure of a page: what it is called, what it shows and how it is drawn."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from cacc_platoon.figures.style import draw_svg


class Picture(NamedTuple):
    """One figure: its file name, what it shows, and how to draw it."""

    name: str
    title: str
    caption: str
    draw: Callable[..., None]
    rows: int = 1
    height: float = 3.1

    def svg(self) -> str:
        """Draw it."""
        return draw_svg(self.title, self.draw, self.rows, self.height)
