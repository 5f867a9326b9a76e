"""What every page is made of: the frame around its body, and its figures."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cacc_platoon.figures.style import standalone
from cacc_platoon.notation import as_html

if TYPE_CHECKING:
    from cacc_platoon.bags.raw import Progress
    from cacc_platoon.figures.picture import Picture


STYLE = Path(__file__).with_name("style.css")


def html_page(title: str, body: str, data: dict[str, Any]) -> str:
    """Return a page that needs no other file; `data` goes along for scripts to read."""
    text = json.dumps(data, allow_nan=False).replace("<", "\\u003c")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{html.escape(title)}</title>\n<style>{STYLE.read_text(encoding='utf-8')}</style>\n</head>\n"
        f'<body>\n{body}\n<script type="application/json" id="metrics">{text}</script>\n'
        "</body>\n</html>\n"
    )


def draw_figures(
    pictures: Sequence[Picture], folder: Path, progress: Progress | None = None
) -> str:
    """Draw pictures, write each as an SVG file, and return them as HTML figures.

    Parameters
    ----------
    pictures : sequence of Picture
        In the order of the page.
    folder : Path
        Where the SVG files go, made when missing.
    progress : callable, optional
        Called before each picture.
    """
    folder.mkdir(parents=True, exist_ok=True)
    figures = []
    for number, picture in enumerate(pictures):
        if progress:
            progress("drawing", number, len(pictures))
        svg = picture.svg()
        (folder / f"{picture.name}.svg").write_text(standalone(svg), encoding="utf-8")
        figures.append(
            f"<figure>{svg}<figcaption><b>{as_html(picture.title)}.</b> "
            f"{as_html(picture.caption)}</figcaption></figure>\n"
        )
    return "".join(figures)
