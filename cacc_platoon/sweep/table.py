"""The table of a study, its summary, and its criteria as a JUnit file."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from cacc_platoon.errors import UserError, printable
from cacc_platoon.formats import Format
from cacc_platoon.sweep.plan import Plan, Point
from cacc_platoon.sweep.rows import RowResult

SUMMARY_FORMAT = Format("summary.json of a study", 1)
_SHOWN = 3
MOST_NAMED = 20
"""So many failed rows are named in a summary."""


def header(plan: Plan) -> list[str]:
    """Return the names of the columns of a table."""
    values = [value.text for value in plan.columns]
    criteria = [f"met: {criterion.text}" for criterion in plan.criteria]
    return ["row", *plan.labels, *values, *criteria, "passed", "failed"]


def lines(plan: Plan, rows: Mapping[int, RowResult]) -> Iterator[list[Any]]:
    """Yield the rows of a table that are there, in order, as Python values."""
    for point in plan.points():
        if (found := rows.get(point.row)) is not None:
            values = [found.values.get(value.text) for value in plan.columns]
            met = [found.met.get(criterion.text) for criterion in plan.criteria]
            labels = point.labels.values()
            yield [point.row, *labels, *values, *met, found.passed, found.failed]


def write_csv(path: Path, plan: Plan, rows: Mapping[int, RowResult]) -> None:
    """Write the table; numbers are written so that they are read back to the last bit."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header(plan))
        for line in lines(plan, rows):
            writer.writerow([_text(value) for value in line])


def write_parquet(path: Path, plan: Plan, rows: Mapping[int, RowResult]) -> None:
    """Write the table for pandas, polars and DuckDB.

    Raises
    ------
    UserError
        Where pyarrow is not installed.
    """
    try:
        import pyarrow as pa  # noqa: PLC0415  (an extra, and slow to import)
        from pyarrow import parquet  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise UserError(
            f"{path}: Parquet takes pyarrow, which is not installed. pip install "
            "'cacc_platoon[sweep]'; table.csv is there."
        ) from error
    columns = [*zip(*lines(plan, rows), strict=True)]
    arrays = [pa.array(_of_one_kind(column)) for column in columns]
    parquet.write_table(pa.table(arrays, header(plan)), path)


def _of_one_kind(column: tuple[Any, ...]) -> list[Any]:
    """Return a column as numbers, as truth values, or else as texts."""
    kinds = {type(value) for value in column if value is not None}
    if kinds <= {int, float} and len(kinds) > 1:
        return [value if value is None else float(value) for value in column]
    if len(kinds) > 1 or kinds & {list, dict}:
        return [value if value is None else str(value) for value in column]
    return list(column)


def _text(value: Any) -> str:
    match value:
        case None:
            return ""
        case bool():
            return "true" if value else "false"
        case float():
            return repr(value)
    return str(value)


def summary(plan: Plan, rows: Mapping[int, RowResult]) -> dict[str, Any]:
    """Return what a study says in a few numbers, as summary.json has it."""
    there = [rows[row] for row in sorted(rows)]
    failed = [row for row in there if row.failed]
    return {
        "format": SUMMARY_FORMAT.version,
        "plan": plan.name,
        "rows": plan.rows,
        "evaluated": len(there),
        "passed": sum(row.passed for row in there),
        "failed": len(failed),
        "failures": [{"row": row.row, "reason": row.failed} for row in failed[:MOST_NAMED]],
        "criteria": [
            {
                "text": criterion.text,
                "met": sum(row.met.get(criterion.text, False) for row in there),
                "missed": [row.row for row in there if row.met.get(criterion.text) is False][
                    :MOST_NAMED
                ],
            }
            for criterion in plan.criteria
        ],
        "columns": {value.text: _range(value.text, there) for value in plan.columns},
    }


def _range(name: str, rows: list[RowResult]) -> dict[str, Any]:
    """Return least and largest of a column with their rows; how often each, of truth values."""
    values = [(row.values[name], row.row) for row in rows if row.values.get(name) is not None]
    if values and all(isinstance(value, bool) for value, _ in values):
        return {"true": sum(value for value, _ in values), "known": len(values)}
    numbers = [one for one in values if type(one[0]) in (int, float) and math.isfinite(one[0])]
    if not numbers:
        return {"known": len(values)}
    least, first = min(numbers)
    largest, last = max(numbers, key=lambda one: (one[0], -one[1]))
    return {
        "known": len(numbers),
        "min": least,
        "min_row": first,
        "max": largest,
        "max_row": last,
    }


def told(plan: Plan, rows: Mapping[int, RowResult]) -> Iterator[str]:
    """Yield what a person wants to know of a study, line by line."""
    found = summary(plan, rows)
    missed = found["evaluated"] - found["passed"] - found["failed"]
    whole = "" if found["evaluated"] == plan.rows else f" of {plan.rows}"
    yield (
        f"{plan.name}: {found['evaluated']}{whole} rows"
        + (f", {found['passed']} meet every criterion, {missed} do not" if plan.criteria else "")
        + f", {found['failed']} failed"
    )
    texts = [*found["columns"], *(criterion.text for criterion in plan.criteria)]
    wide = max(map(len, texts))
    named = {failure["row"] for failure in found["failures"][:_SHOWN]}
    named |= {one["missed"][0] for one in found["criteria"] if one["missed"]}
    points = {point.row: point for point in plan.points() if point.row in named}
    for criterion in found["criteria"]:
        line = f"  {criterion['text']:{wide}} met by {criterion['met']}"
        if criterion["missed"]:
            line += f"; not by row {place(points[criterion['missed'][0]])}"
        yield line
    for failure in found["failures"][:_SHOWN]:
        yield f"  failed: row {place(points[failure['row']])}: {failure['reason']}"
    for name, span in found["columns"].items():
        if "min" in span and span["min"] == span["max"]:
            yield f"  {name:{wide}} {span['min']:.6g} everywhere"
        elif "min" in span:
            yield (
                f"  {name:{wide}} {span['min']:.6g} (row {span['min_row']}) to "
                f"{span['max']:.6g} (row {span['max_row']})"
            )
        elif "true" in span:
            yield f"  {name:{wide}} true in {span['true']} of {span['known']}"


def place(point: Point) -> str:
    """Name a row and where it is."""
    where = ", ".join(f"{name}={_short(value)}" for name, value in point.labels.items())
    return f"{point.row} ({where})"


def _short(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def junit(plan: Plan, rows: Mapping[int, RowResult]) -> str:
    """Return the criteria as a JUnit file: a test case for each, and for each row that failed."""
    root = ET.Element("testsuites", name=plan.name)
    texts = [criterion.text for criterion in plan.criteria] or ["evaluated"]
    for text in texts:
        suite = ET.SubElement(root, "testsuite", name=text)
        counts = {"tests": 0, "failures": 0, "errors": 0}
        for point in plan.points():
            if (found := rows.get(point.row)) is None:
                continue
            counts["tests"] += 1
            case = ET.SubElement(suite, "testcase", classname=plan.name, name=place(point))
            if found.failed:
                counts["errors"] += 1
                ET.SubElement(case, "error", message=printable(found.failed))
            elif found.met.get(text) is False:
                counts["failures"] += 1
                ET.SubElement(case, "failure", message=f"not {text}")
        for name, count in counts.items():
            suite.set(name, f"{count}")
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'
