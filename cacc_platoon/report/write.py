"""What a report leaves on disk: metrics.json, figures/ and report.html."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

from cacc_platoon.analysis import Report, analyse
from cacc_platoon.bags.raw import Progress
from cacc_platoon.errors import UserError
from cacc_platoon.report.metrics_json import metrics_document

METRICS_FILE = "metrics.json"
PAGE_FILE = "report.html"
FIGURES = "figures"


class WrittenReport(NamedTuple):
    """A report and what its metrics.json holds."""

    report: Report
    metrics: dict[str, Any]


def report_run(
    path: Path | str,
    progress: Progress | None = None,
    **options: Any,
) -> WrittenReport:
    """Analyse a run and write metrics.json, figures/ and report.html.

    Parameters
    ----------
    path : Path or str
        A run folder, a bag's folder or a storage file.
    progress : callable, optional
        Called periodically with what is being done, how much is done and how much there is.
    **options
        As in `analyse`.
    """
    return write_report(analyse(path, progress=progress, **options), progress)


def write_report(report: Report, progress: Progress | None = None) -> WrittenReport:
    """Write metrics.json, figures/ and report.html into the report's folder.

    Raises
    ------
    UserError
        When the folder cannot be written.
    """
    from cacc_platoon.report.page import render_page  # noqa: PLC0415  (matplotlib is slow)

    metrics = metrics_document(report)
    text = json.dumps(metrics, indent=1, allow_nan=False)
    try:
        report.folder.mkdir(parents=True, exist_ok=True)
        (report.folder / METRICS_FILE).write_text(text + "\n", encoding="utf-8")
        page = render_page(report, metrics, report.folder / FIGURES, progress)
        (report.folder / PAGE_FILE).write_text(page, encoding="utf-8")
    except OSError as error:
        raise UserError(
            f"{report.folder}: the report cannot be written ({error.strerror}). "
            "Choose another folder with -o."
        ) from error
    return WrittenReport(report, metrics)
