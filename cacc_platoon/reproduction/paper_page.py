"""The paper's results, one by one, from runs of its three cases."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cacc_platoon.errors import UserError
from cacc_platoon.formats import Format
from cacc_platoon.notation import as_html
from cacc_platoon.report.html_page import draw_figures, html_page
from cacc_platoon.report.metrics_json import metrics_document, plain_values
from cacc_platoon.report.tables import text_table
from cacc_platoon.reproduction.paper_figures import paper_pictures

if TYPE_CHECKING:
    from cacc_platoon.bags.raw import Progress
    from cacc_platoon.reproduction.claims import Claim
    from cacc_platoon.reproduction.reproduce import Reproduction

PAGE_FILE, DATA_FILE, FIGURES = "paper.html", "paper.json", "figures"
FORMAT = Format(DATA_FILE, 1)
SLIPS = (
    "S is nonempty exactly when a_1 > a_2; the text's 'or b_1 >= b_2' is not enough.",
    "S is sufficient, not necessary: the exact region is wider, and unbounded in k_p.",
    "Definition 2 takes the maximum norm and the H-infinity norm for the same. They are not: the "
    "L-infinity gain of one hop is above 1 in the stable cases too, and both are reported by name.",
    "The largest w of n bits is 1 + 1/rho - 2^(1-n)/rho, a little below 1 + 1/rho.",
)


def document(result: Reproduction) -> dict[str, Any]:
    """Return what paper.json holds."""
    plain: dict[str, Any] = plain_values(
        {
            "format": FORMAT.version,
            "agrees": result.agrees,
            "claims": [_claim(claim) for claim in result.claims],
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


def summary(result: Reproduction) -> str:
    """Return the table "paper says / we measured" for a terminal."""
    rows = [("", "", "paper says", "we measured")]
    rows += [
        ("  " if claim.agrees else "! ", claim.what, claim.paper, claim.measured)
        for claim in result.claims
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    lines = [
        "".join(text.ljust(width + 2) for text, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    data = [f"data of case {name}: {one.line}" for name, one in result.unsound.items()]
    return "\n".join([result.headline, *data, "", *lines])


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
    kind, sign = ("good", "&#10003;") if result.agrees else ("bad", "&#10007;")
    rows = [
        (
            "yes" if claim.agrees else "NO",
            claim.where,
            claim.what,
            claim.paper,
            claim.measured,
            claim.basis,
        )
        for claim in result.claims
    ]
    heads = ("agrees", "where", "quantity", "paper says", "we measured", "basis")
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
    slips = "".join(f"<li>{as_html(line)}</li>" for line in SLIPS)
    return html_page(
        result.headline,
        f'<header class="verdict {kind}"><h1>{sign} {as_html(result.headline)}</h1></header>'
        f"<h2>Paper says, we measured</h2>{text_table(heads, rows)}"
        f'<h2>Figures</h2><div class="grid">{figures}</div>'
        f"<h2>Where the paper slips</h2><ul>{slips}</ul>"
        f"<h2>Runs</h2>{text_table(('case', 'status', 'data', 'messages', 'digest'), runs)}",
        document(result),
    )
