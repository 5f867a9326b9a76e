"""The paper's results, one by one, from runs of its three cases."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cacc_platoon.analysis.document import plain_values
from cacc_platoon.errors import UserError
from cacc_platoon.formats import Format
from cacc_platoon.notation import as_html
from cacc_platoon.report.html_page import draw_figures, html_page
from cacc_platoon.report.metrics_json import metrics_document
from cacc_platoon.report.tables import text_table
from cacc_platoon.reproduction.journal import DOI
from cacc_platoon.reproduction.paper_figures import paper_pictures

if TYPE_CHECKING:
    from cacc_platoon.bags.raw import Progress
    from cacc_platoon.reproduction.claim import Claim
    from cacc_platoon.reproduction.reproduce import Reproduction
    from cacc_platoon.reproduction.slip import Slip

PAGE_FILE, DATA_FILE, FIGURES = "paper.html", "paper.json", "figures"
FORMAT = Format(DATA_FILE, 1)
HEADS = ("agrees", "where", "quantity", "paper says", "we measured", "basis")
JOURNAL_NOTE = (
    f"A later version of the paper, doi {DOI}, shows more cases. What it says is read from its "
    "figures: about right at best."
)
_COLUMNS = (50, 36, 44)
_AGREES = {True: "yes", False: "NO", None: "question"}
_MARKS = {True: "  ", False: "! ", None: "? "}


def document(result: Reproduction) -> dict[str, Any]:
    """Return what paper.json holds."""
    plain: dict[str, Any] = plain_values(
        {
            "format": FORMAT.version,
            "agrees": result.agrees,
            "claims": [_claim(claim) for claim in result.claims],
            "journal": {"doi": DOI, "claims": [_claim(claim) for claim in result.journal]},
            "slips": [_slip(slip) for slip in result.slips],
            "cases": {name: metrics_document(report) for name, report in result.reports.items()},
        }
    )
    return plain


def _claim(claim: Claim) -> dict[str, Any]:
    return {
        "where": claim.where,
        "what": claim.what,
        "paper": claim.paper,
        "measured": claim.measured,
        "agrees": claim.agrees,
        "basis": claim.basis,
    }


def _slip(slip: Slip) -> dict[str, Any]:
    return {
        "where": slip.where,
        "paper": slip.paper,
        "holds": slip.holds,
        "check": slip.check,
        "shown": slip.shown,
    }


def summary(result: Reproduction) -> str:
    """Return the tables of the page for a terminal."""
    data = [f"data of case {name}: {one.line}" for name, one in result.unsound.items()]
    lines = [result.headline, result.journal_line, *data, ""]
    lines += _row("", ("", "paper says", "we measured"))
    lines += _claim_rows(result.claims)
    lines += ["", *_row("", (f"journal version, doi {DOI}", "paper says", "we measured"))]
    lines += _claim_rows(result.journal)
    lines += ["", *_row("", ("where the paper slips", "what holds", "shown by"))]
    for slip in result.slips:
        what = f"{slip.where}: {slip.paper}"
        lines += _row(_MARKS[slip.shown], (what, slip.holds, slip.check))
    return "\n".join(lines)


def _claim_rows(claims: Sequence[Claim]) -> list[str]:
    return [
        line
        for claim in claims
        for line in _row(_MARKS[claim.agrees], (claim.what, claim.paper, claim.measured))
    ]


def _row(mark: str, cells: Sequence[str]) -> list[str]:
    """Return a row of a terminal's table, its cells folded to their columns."""
    folded = [
        textwrap.wrap(cell, width, break_on_hyphens=False)
        for cell, width in zip(cells, _COLUMNS, strict=True)
    ]
    lines = []
    for number, parts in enumerate(zip_longest(*folded, fillvalue="")):
        padded = (part.ljust(width + 2) for part, width in zip(parts, _COLUMNS, strict=True))
        lines.append(((mark if number == 0 else "").ljust(2) + "".join(padded)).rstrip())
    return lines


def write_reproduction(
    result: Reproduction, folder: Path, progress: Progress | None = None
) -> Path:
    """Write paper.json, figures/ and paper.html into a folder and return the page.

    Raises
    ------
    UserError
        When the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(document(result), indent=1, allow_nan=False)
        (folder / DATA_FILE).write_text(text + "\n", encoding="utf-8")
        figures = draw_figures(list(paper_pictures(result.reports)), folder / FIGURES, progress)
        page = folder / PAGE_FILE
        page.write_text(_page(result, figures), encoding="utf-8")
    except OSError as error:
        raise UserError(
            f"{folder}: the paper's results cannot be written ({error.strerror}). Choose another "
            "folder with -o."
        ) from error
    return page


def _page(result: Reproduction, figures: str) -> str:
    kind, sign = ("good", "&#10003;") if result.complete else ("bad", "&#10007;")
    slips = [
        ("yes" if slip.shown else "NO", slip.where, slip.paper, slip.holds, slip.check)
        for slip in result.slips
    ]
    slip_heads = ("shown", "where", "paper says, or leaves open", "what holds", "shown by")
    runs = [
        (
            name,
            report.run.info.status if report.run.info else "",
            report.standing.line,
            report.run.messages,
            report.run.digest,
        )
        for name, report in result.reports.items()
    ]
    return html_page(
        result.headline,
        f'<header class="verdict {kind}"><h1>{sign} {as_html(result.headline)}</h1>'
        f"<p>{as_html(result.journal_line)}.</p></header>"
        f"<h2>Paper says, we measured</h2>{text_table(HEADS, _claim_cells(result.claims))}"
        f"<h2>Journal version</h2><p>{as_html(JOURNAL_NOTE)}</p>"
        f"{text_table(HEADS, _claim_cells(result.journal))}"
        f"<h2>Where the paper slips</h2>{text_table(slip_heads, slips)}"
        f'<h2>Figures</h2><div class="grid">{figures}</div>'
        f"<h2>Runs</h2>{text_table(('case', 'status', 'data', 'messages', 'digest'), runs)}",
        document(result),
    )


def _claim_cells(claims: Sequence[Claim]) -> list[tuple[str, ...]]:
    return [
        (_AGREES[one.agrees], one.where, one.what, one.paper, one.measured, one.basis)
        for one in claims
    ]
