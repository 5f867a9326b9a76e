"""List every parameter of a scenario: type, unit, default, range and meaning."""

from __future__ import annotations

import argparse
import json

from cacc_platoon.cli.exit_codes import DONE
from cacc_platoon.scenario.parameter import KIND_TEXT, Parameter
from cacc_platoon.scenario.schema import scenario_schema
from cacc_platoon.scenario.table import SNR_DB, TABLE


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    shape = parser.add_mutually_exclusive_group()
    shape.add_argument("--markdown", action="store_true", help="print a table for a document")
    shape.add_argument(
        "--schema",
        action="store_true",
        help="print the JSON Schema of scenario files, by which editors complete keys",
    )


def run(options: argparse.Namespace) -> int:
    """Print the parameter table."""
    if options.schema:
        print(json.dumps(scenario_schema(), indent=2))
    else:
        print(markdown_table() if options.markdown else plain_list())
    return DONE


def markdown_table() -> str:
    """Return the parameter table as the README shows it."""
    lines = ["| parameter | default | unit | range | meaning |", "|---|---|---|---|---|"]
    for row in _rows():
        own = " *" if row.per_vehicle else ""
        limits = row.range_text.replace("|", "\\|") or KIND_TEXT[row.kind]
        lines.append(
            f"| `{row.name}`{own} | {_default(row)} | {row.unit} | {limits} | {row.meaning} |"
        )
    return "\n".join(lines)


def plain_list() -> str:
    """Return the parameter table for a terminal."""
    return "\n".join(
        f"{row.name:30} {_default(row):>12} {row.unit:8} {row.meaning}"
        + (f" ({row.range_text})" if row.range_text else "")
        for row in _rows()
    )


def _rows() -> list[Parameter]:
    rows = list(TABLE.values())
    rows.insert(rows.index(TABLE["v2v.rho"]) + 1, SNR_DB)
    return rows


def _default(row: Parameter) -> str:
    if row is SNR_DB:
        return ""
    if isinstance(row.default, tuple):
        return "the paper's" if row.default else ""
    return str(row.default).lower() if isinstance(row.default, bool) else str(row.default)
