"""Evaluate many scenarios: whatever varies, in one table, judged by the criteria of a plan.

A plan names a scenario, what varies (a matrix, a random design, designs, seeds), and criteria.
What is computed is written down row by row: the same command goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import json
import os
import re
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from cacc_platoon.cli.console import say
from cacc_platoon.cli.exit_codes import DONE, NOT_STRING_STABLE
from cacc_platoon.cli.progress import ProgressLine
from cacc_platoon.cli.ros import require_ros
from cacc_platoon.errors import UserError, printable
from cacc_platoon.sweep.criterion import BeyondListError

if TYPE_CHECKING:
    from cacc_platoon.figures.style import Axes
    from cacc_platoon.sweep.maps import Map
    from cacc_platoon.sweep.plan import Plan
    from cacc_platoon.sweep.rows import RowResult


RUN_ONLY = (
    *("headline", "worst_braking", "proven", "standing", "age_margins", "events", "noise"),
    *("ensemble", "distance", "consistency", "leader_consistency", "link_consistency"),
    *("findings", "provenance"),
)
"""What metrics.json of a run on nodes has beyond what a simulated row has."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("plan", type=Path, help="plan file, e.g. config/plans/headway_and_snr.yaml")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help="folder of the study (default: runs/<plan>-<UTC time>); where it holds the same "
        "study, that goes on",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="replace a parameter of the plan's scenario; may be repeated",
    )
    parser.add_argument(
        "--backend",
        choices=("simulate", "run"),
        default="simulate",
        help="in arrays (default), or on ROS 2 nodes, one platoon after the other",
    )
    parser.add_argument(
        "--workers", type=int, metavar="N", help="processes at once (default: one a core)"
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="evaluate on the workers of this Dask scheduler, e.g. tcp://10.0.0.1:8786",
    )
    parser.add_argument("--list", action="store_true", help="print the rows and do nothing")
    parser.add_argument("--check", action="store_true", help="exit 3 unless every row passes")
    parser.add_argument(
        "--junit", type=Path, metavar="FILE", help="write the criteria as a JUnit file, too"
    )
    parser.add_argument("--parquet", action="store_true", help="write table.parquet, too")
    parser.add_argument("--json", action="store_true", help="print summary.json and nothing else")


def run(options: argparse.Namespace) -> int:
    """Plan, evaluate what is not there yet, write the table, judge."""
    _check_outputs(options)
    from cacc_platoon.sweep.folder import open_study  # noqa: PLC0415  (heavy)
    from cacc_platoon.sweep.plan import load_plan  # noqa: PLC0415
    from cacc_platoon.sweep.table import junit, place, summary, told  # noqa: PLC0415

    plan = load_plan(options.plan, options.set)
    _check_names(plan, options.backend)
    if options.list:
        for point in plan.points():
            print(printable(place(point)))
        return DONE
    stamp = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
    folder = options.output or Path("runs") / f"{plan.name}-{stamp}"
    with open_study(folder, plan, options.backend) as file:
        if file.rows:
            say(f"{folder}: has {len(file.rows)} of {plan.rows} rows already")
        with ProgressLine() as progress:
            progress(plan.name, len(file.rows), plan.rows)
            for row in _evaluated(plan, file.rows, folder, options):
                file.add(row)
                progress(plan.name, len(file.rows), plan.rows)
        rows = file.rows
    _write(folder, plan, rows, parquet=options.parquet)
    if options.junit:
        options.junit.write_text(junit(plan, rows), encoding="utf-8")
    if options.json:
        print(json.dumps(summary(plan, rows), indent=1, allow_nan=False))
    else:
        print(printable("\n".join([*told(plan, rows), f"  table  {folder / 'table.csv'}"])))
    passed = all(row.passed for row in rows.values())
    return NOT_STRING_STABLE if options.check and not passed else DONE


def _check_outputs(options: argparse.Namespace) -> None:
    """Refuse what cannot be done before anything is evaluated."""
    if options.workers is not None and options.workers < 1:
        raise UserError(f"--workers {options.workers} is below 1: nothing would be evaluated.")
    if options.scheduler and (options.workers or options.backend == "run"):
        raise UserError("--scheduler: its workers evaluate. Leave --workers and --backend out.")
    if options.workers and options.backend == "run":
        raise UserError("--workers: platoons on nodes run one after the other. Leave it out.")
    if options.junit and not options.junit.parent.is_dir():
        raise UserError(f"--junit {options.junit}: there is no folder {options.junit.parent}.")
    if options.parquet and not importlib.util.find_spec("pyarrow"):
        raise UserError(
            "--parquet takes pyarrow, which is not installed. pip install 'cacc_platoon[sweep]', "
            "or leave it out: table.csv has the same."
        )


def _check_names(plan: Plan, backend: str) -> None:
    """Refuse names that no row has, by those of a short run."""
    from cacc_platoon.scenario import Scenario  # noqa: PLC0415  (heavy)
    from cacc_platoon.sweep.evaluate import document_of, parameters_of  # noqa: PLC0415

    short = {"run.duration": 11.0, "platoon.followers": plan.scenario.platoon.followers}
    document = parameters_of(plan.scenario) | document_of(Scenario.from_values(short))
    unknown = () if backend == "simulate" else RUN_ONLY
    try:
        for value in plan.columns:
            if value.path[0] not in unknown:
                value.check(document)
        for criterion in plan.criteria:
            with contextlib.suppress(BeyondListError):
                if criterion.value.path[0] not in unknown:
                    criterion.holds(document)
    except UserError as error:
        raise UserError(f"{plan.name}: {error}") from error


def _evaluated(
    plan: Plan, done: Mapping[int, RowResult], folder: Path, options: argparse.Namespace
) -> Iterator[RowResult]:
    """Yield the rows that are not there yet, as they come."""
    from cacc_platoon.sweep.engine import ENDED, Evaluation, Processes  # noqa: PLC0415  (heavy)
    from cacc_platoon.sweep.on_nodes import OnNodes  # noqa: PLC0415

    there = {row for row, one in done.items() if one.failed != ENDED}
    left = (point for point in plan.points() if point.row not in there)
    missing = plan.rows - len(there)
    if not missing:
        return
    if options.backend == "run":
        require_ros("sweep --backend run", "platoon sweep without it computes in arrays")
        with OnNodes(folder / "runs") as nodes:
            yield from Evaluation(
                plan, left, lambda: ThreadPoolExecutor(1), workers=1, evaluate=nodes
            ).rows()
        return
    if options.scheduler:
        from cacc_platoon.sweep.cluster import DaskExecutor  # noqa: PLC0415

        yield from Evaluation(plan, left, lambda: DaskExecutor(options.scheduler)).rows()
        return
    workers = min(options.workers or os.cpu_count() or 1, missing)
    yield from Evaluation(plan, left, lambda: Processes(workers), workers=workers).rows()


def _write(folder: Path, plan: Plan, rows: Mapping[int, RowResult], *, parquet: bool) -> None:
    """Write the table, the summary and the figures."""
    from cacc_platoon.sweep.maps import maps  # noqa: PLC0415  (heavy)
    from cacc_platoon.sweep.table import summary, write_csv, write_parquet  # noqa: PLC0415

    write_csv(folder / "table.csv", plan, rows)
    text = json.dumps(summary(plan, rows), indent=1, allow_nan=False)
    (folder / "summary.json").write_text(f"{text}\n", encoding="utf-8")
    figures = folder / "figures"
    for old in figures.glob("*.svg"):
        old.unlink()
    for number, one in enumerate(maps(plan, rows), start=1):
        figures.mkdir(exist_ok=True)
        name = re.sub(r"[^\w]+", "_", one.name).strip("_")
        (figures / f"{number:02}_{name}.svg").write_text(_drawn(one), encoding="utf-8")
    if parquet:
        write_parquet(folder / "table.parquet", plan, rows)


def _drawn(one: Map) -> str:
    """Return a map or a curve as SVG."""
    from cacc_platoon.figures.study import plot_curve, plot_map  # noqa: PLC0415  (heavy)
    from cacc_platoon.figures.style import draw_svg, standalone  # noqa: PLC0415

    shown = f"share of rows: {one.name}" if one.share else one.name
    if one.over:
        shown += f"\n(mean over {', '.join(one.over)})"
    places = [sorted(axis.places) for axis in one.axes]
    names = [axis.title for axis in one.axes]

    def draw(axes: Axes) -> None:
        if len(places) == 1:
            plot_curve(axes, places[0], one.values, (names[0], shown))
        else:
            x, y = places
            plot_map(axes, x, y, one.values, (*names, shown), share=one.share)

    return standalone(draw_svg(f"{one.name} over {' and '.join(names)}", draw))
