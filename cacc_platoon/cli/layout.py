"""Write layouts that open a platoon in Foxglove, PlotJuggler and RViz.

For a scenario file, a run folder or any bag; any prefix and number of vehicles. PlotJuggler has
two formats, one for version 3 and one for version 4; the latter follows its published source.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from cacc_platoon.cli.exit_codes import DONE
from cacc_platoon.cli.progress import ProgressLine
from cacc_platoon.formats import Format

VIEWERS = ("foxglove", "plotjuggler", "rviz")
FORMAT = Format("layout --json", 1)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument(
        "path",
        metavar="RUN|BAG|SCENARIO",
        type=Path,
        help="run folder, bag, .mcap/.db3 or scenario file (.yaml)",
    )
    parser.add_argument(
        "--for",
        dest="viewers",
        action="append",
        choices=VIEWERS,
        help="for this viewer only; may be repeated (default: all)",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help="where they go (default: RUN/layouts, <bag>_layouts beside a bag, "
        "./<scenario>_layouts)",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="replace a value of a scenario file; may be repeated",
    )
    parser.add_argument("--scenario", type=Path, metavar="FILE", help="parameters of a bag")
    parser.add_argument("--namespace", help="which platoon, when the bag holds several")
    parser.add_argument("--json", action="store_true", help="print one JSON object and no text")


def run(options: argparse.Namespace) -> int:
    """Write the layouts; say which, and how to open them."""
    from cacc_platoon.report.layouts import view_of, write_layouts  # noqa: PLC0415  (heavy)
    from cacc_platoon.scenario.file import load_scenario  # noqa: PLC0415  (heavy)

    given = load_scenario(options.scenario) if options.scenario else None
    with ProgressLine() as progress:
        view = view_of(
            options.path,
            settings=options.set,
            scenario=given,
            namespace=options.namespace,
            progress=progress,
        )
    folder = options.output or _default_folder(options.path)
    layouts = write_layouts(view, folder, options.viewers or VIEWERS)
    if options.json:
        files = [
            {"viewer": layout.viewer, "file": str(layout.file), "open": layout.how}
            for layout in layouts
        ]
        print(json.dumps({"format": FORMAT.version, "layouts": files}, indent=1))
    else:
        for layout in layouts:
            print(f"{layout.viewer:14} {layout.file}\n{'':14} {layout.how}")
    return DONE


def _default_folder(path: Path) -> Path:
    """Return where the layouts of a run folder, a bag or a scenario file go."""
    from cacc_platoon.report.layouts.view import SCENARIO_SUFFIXES  # noqa: PLC0415  (heavy)
    from cacc_platoon.runs.locate import locate  # noqa: PLC0415  (heavy)

    if path.suffix in SCENARIO_SUFFIXES:
        return Path(f"{path.stem}_layouts")
    bag, folder = locate(path)
    return folder / "layouts" if folder else bag.with_name(f"{bag.stem}_layouts")
