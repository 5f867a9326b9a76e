"""The report as one HTML file that needs nothing else: verdict, figures, numbers, provenance."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cacc_platoon.analysis.monitor import NO_ALARM, monitor_line
from cacc_platoon.notation import as_html
from cacc_platoon.report.figure_list import pictures
from cacc_platoon.report.html_page import draw_figures, html_page
from cacc_platoon.report.tables import (
    clock_table,
    event_table,
    fact_table,
    fallback_table,
    follower_table,
    monitor_table,
    noise_table,
    reception_table,
    scenario_table,
)
from cacc_platoon.report.verdict_section import findings_section, verdict_section

if TYPE_CHECKING:
    from cacc_platoon.analysis.analyse import Report
    from cacc_platoon.bags.raw import Progress


@np.errstate(all="ignore")  # numbers of an unstable run may overflow in a figure, too
def render_page(
    report: Report, metrics: dict[str, Any], figures: Path, progress: Progress | None = None
) -> str:
    """Return the page, and write its figures as SVG files.

    Parameters
    ----------
    report : Report
        What to show.
    metrics : dict
        What its metrics.json holds.
    figures : Path
        Folder of the figures, made when missing.
    progress : callable, optional
        Called before each figure.
    """
    body = "".join(
        (
            verdict_section(report, metrics),
            findings_section(report),
            f'<h2>Figures</h2><div class="grid">'
            f"{draw_figures(list(pictures(report)), figures, progress)}</div>",
            *_numbers(report, metrics),
        )
    )
    title = f"{report.headline}: {report.run.trajectory.scenario.name}"
    return html_page(title, body, metrics)


def _numbers(report: Report, metrics: dict[str, Any]) -> Iterator[str]:
    facts = metrics["provenance"]
    recorded = facts["recorded_with"] or {}
    yield f"<h2>Numbers per follower</h2>{follower_table(metrics)}"
    yield f"<h2>Noise per link</h2>{noise_table(metrics)}"
    if any(follower.counted for follower in report.run.trajectory.scenario.followers):
        yield f"<h2>Packets per link</h2>{reception_table(metrics)}"
    if report.measured.fallback:
        yield f"<h2>States of reception</h2>{fallback_table(metrics)}"
    if watched := report.measured.monitor:
        lines = "".join(f"<li>{as_html(monitor_line(one))}</li>" for one in watched)
        yield f"<h2>Assumption monitor</h2>{monitor_table(metrics)}<ul>{lines}</ul>"
        yield f"<p>{as_html(NO_ALARM)}</p>"
    if metrics["clocks"]:
        yield f"<h2>Samples by clocks</h2>{clock_table(metrics)}"
    if metrics["events"]:
        yield f"<h2>Course of the run</h2>{event_table(metrics)}"
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
