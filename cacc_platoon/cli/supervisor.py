r"""The supervisor as an executable of its own, for `ros2 run` and launch files.

  ros2 run cacc_platoon supervisor [--set KEY=VALUE] --ros-args \
      --params-file config/paper_a.yaml [-p run.spawn:=false] \
      [-p record.directory:=DIR] [-p record.parts:=DIR]

It does what `platoon run` does, with ROS parameters: spawns the hosts (or waits for nodes that
were started manually when run.spawn is false), runs, records and judges. --set replaces a
parameter, for a single vehicle too (vehicle_5.controller.k_v=0.7), or several: "[KEY=VALUE, ...]".
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from cacc_platoon.cli.exit_codes import BAD_INPUT, DONE
from cacc_platoon.cli.ros import require_ros
from cacc_platoon.errors import UserError
from cacc_platoon.stop_signal import STOP_SIGNALS, StopSignal

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cacc_platoon.cli.progress import ProgressLog
    from cacc_platoon.scenario import Scenario

_BETWEEN = re.compile(r",(?![^\[]*\])")  # a comma, but none within a list of numbers


def main() -> int:
    """Run the supervisor with the parameters of its command line."""
    if {"-h", "--help"} & set(sys.argv[1:]):
        print(__doc__)
        return DONE
    options = argparse.Namespace(json=False, check=False, no_report=False, verbose=False)
    try:
        with StopSignal(*STOP_SIGNALS) as stop:  # before anything is loaded: no Ctrl-C is lost
            from cacc_platoon.cli.run import run_and_judge  # noqa: PLC0415  (heavy)

            return run_and_judge(_scenario(sys.argv), None, options, stop, _log_progress)
    except UserError as error:
        print(error, file=sys.stderr)
        return BAD_INPUT


def settings_of(text: str) -> list[str]:
    """Return the `key=value` texts of one or of a list in brackets.

    Examples
    --------
    >>> settings_of("[run.seed=2, vehicle.tau=[0.5, 0.4]]")
    ['run.seed=2', 'vehicle.tau=[0.5, 0.4]']
    >>> settings_of("run.seed=2")
    ['run.seed=2']
    """
    text = text.strip()
    if not text.startswith("["):
        return [text]
    parts = _BETWEEN.split(text.removeprefix("[").removesuffix("]"))
    return [part.strip() for part in parts if part.strip()]


def _scenario(arguments: Sequence[str]) -> Scenario:
    """Build the scenario from the ROS parameters, and from the files for single vehicles.

    ROS hands a node its own parameters only; the sections for single vehicles, which the hosts
    need, are read from the files themselves. They are read first: what is wrong with a file is
    said in our words and not in those of rcl.
    """
    from cacc_platoon.scenario import Scenario  # noqa: PLC0415  (heavy)
    from cacc_platoon.scenario.file import (  # noqa: PLC0415
        apply_settings,
        load_scenario,
        parameter_files,
    )
    from cacc_platoon.scenario.ros_sections import Values  # noqa: PLC0415

    values = Values()
    name, folder = "supervisor", Path()
    for path in parameter_files(arguments):
        scenario = load_scenario(path)
        name, folder = scenario.name, path.parent
        for index, section in scenario.overrides.items():
            values.overrides.setdefault(index, {}).update(section)
    require_ros("supervisor", "platoon simulate runs a scenario")
    from rclpy.utilities import remove_ros_args  # noqa: PLC0415  (needs ROS)

    from cacc_platoon.supervision.single_nodes import supervisor_parameters  # noqa: PLC0415

    values.common |= supervisor_parameters()
    parser = argparse.ArgumentParser(prog="supervisor")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    for text in parser.parse_args(remove_ros_args(args=list(arguments))[1:]).set:
        apply_settings(settings_of(text), values)
    return Scenario.from_values(values.common, values.overrides, name, folder)


def _log_progress(step: float | None = None, *, shown: bool = True) -> ProgressLog:
    """Return a progress that is logged as ROS nodes log."""
    from rclpy.logging import get_logger  # noqa: PLC0415  (needs ROS)

    from cacc_platoon.cli.progress import ProgressLog  # noqa: PLC0415

    return ProgressLog(get_logger("supervisor").info, step, shown=shown)
