"""The report as one HTML file that needs nothing else: verdict, figures, numbers, provenance."""

from __future__ import annotations

import html
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from cacc_platoon.analysis.figures.style import standalone
from cacc_platoon.analysis.page.look import STYLE
from cacc_platoon.analysis.page.pictures import pictures
from cacc_platoon.analysis.page.tables import (
    fact_table,
    follower_table,
    noise_table,
    scenario_table,
)
from cacc_platoon.analysis.page.verdict import findings_section, verdict_section

if TYPE_CHECKING:
    from cacc_platoon.analysis.reading.raw import Progress
    from cacc_platoon.analysis.report import Report


def render_page(report: Report, figures: Path, progress: Progress | None = None) -> str:
    """Return the page, and write its figures as SVG files.

    Parameters
    ----------
    report : Report
        What to show.
    figures : Path
        Folder of the figures, made when missing.
    progress : callable, optional
        Called before each figure.
    """
    figures.mkdir(parents=True, exist_ok=True)
    name = html.escape(report.run.trajectory.scenario.name)
    body = "".join(
        (
            verdict_section(report),
            findings_section(report),
            "<h2>Figures</h2>",
            '<div class="grid">',
            *_figures(report, figures, progress),
            "</div>",
            *_numbers(report),
        )
    )
    data = json.dumps(report.metrics, allow_nan=False).replace("<", "\\u003c")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{html.escape(report.verdict.headline)}: {name}</title>\n"
        f"<style>{STYLE}</style>\n</head>\n<body>\n{body}\n"
        f'<script type="application/json" id="metrics">{data}</script>\n</body>\n</html>\n'
    )


def _figures(report: Report, folder: Path, progress: Progress | None) -> Iterator[str]:
    chosen = list(pictures(report))
    for number, picture in enumerate(chosen):
        if progress:
            progress("drawing", number, len(chosen))
        svg = picture.svg()
        (folder / f"{picture.name}.svg").write_text(standalone(svg), encoding="utf-8")
        yield (
            f"<figure>{svg}<figcaption>"
            f"<b>{html.escape(picture.title)}.</b> {html.escape(picture.caption)}"
            "</figcaption></figure>\n"
        )


def _numbers(report: Report) -> Iterator[str]:
    facts = report.metrics["provenance"]
    recorded = facts["recorded_with"] or {}
    yield f"<h2>Numbers per follower</h2>{follower_table(report.metrics)}"
    yield f"<h2>Noise per link</h2>{noise_table(report.metrics)}"
    yield f"<h2>Scenario</h2>{scenario_table(report.run.trajectory.scenario)}"
    yield "<h2>Provenance</h2>"
    yield fact_table(
        [
            ("digest of the messages", facts["digest"]),
            ("digest when the run ended", facts["digest_recorded"] or "not recorded"),
            ("seed", facts["seed"]),
            ("messages", facts["messages"]),
            ("samples", f"{facts['samples']}, {facts['step']:g} s apart"),
            ("namespace", facts["namespace"]),
            ("status", facts["status"] or "unknown"),
            *([("message", facts["message"])] if facts["message"] else []),
            *((f"recorded with {name}", version) for name, version in recorded.items()),
            *((f"analysed with {name}", v) for name, v in facts["analysed_with"].items()),
            *((f"machine: {name}", value) for name, value in (facts["fingerprint"] or {}).items()),
        ]
    )
