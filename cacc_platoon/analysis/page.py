"""The report as one HTML file that needs nothing else."""

from __future__ import annotations

import html
from pathlib import Path
from typing import TYPE_CHECKING

from cacc_platoon.analysis.figures.motion import draw_platoon_length, draw_spacing_errors
from cacc_platoon.analysis.figures.style import draw_svg, standalone

if TYPE_CHECKING:
    from cacc_platoon.analysis.report import Report


def render_page(report: Report, figures: Path) -> str:
    """Return the page, and write its figures as SVG files."""
    run = report.run.trajectory
    drawn = {
        "spacing_errors": draw_svg("spacing_errors", lambda axes: draw_spacing_errors(axes, run)),
        "platoon_length": draw_svg(
            "platoon_length", lambda axes: draw_platoon_length(axes, run, report.expectation)
        ),
    }
    figures.mkdir(parents=True, exist_ok=True)
    for name, svg in drawn.items():
        (figures / f"{name}.svg").write_text(standalone(svg), encoding="utf-8")
    body = "".join(f"<figure>{svg}</figure>" for svg in drawn.values())
    return (
        "<!doctype html><html lang=en><meta charset=utf-8>"
        f"<title>{html.escape(run.scenario.name)}</title>"
        f"<pre>{html.escape(report.summary())}</pre>{body}</html>"
    )
