r"""The supervisor as an executable of its own, for `ros2 run` and launch files.

  ros2 run cacc_platoon supervisor --ros-args --params-file config/paper_a.yaml \
      [-p run.spawn:=false] [-p record.directory:=DIR]

It does what `platoon run` does, with ROS parameters: spawns the hosts (or waits for nodes that
were started manually when run.spawn is false), runs, records and judges.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from cacc_platoon.cli.exit_codes import BAD_INPUT, DONE
from cacc_platoon.cli.ros import require_ros
from cacc_platoon.cli.run import run_and_judge
from cacc_platoon.errors import UserError
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import load_scenario, parameter_files


def main() -> int:
    """Run the supervisor with the parameters of its command line."""
    if {"-h", "--help"} & set(sys.argv[1:]):
        print(__doc__)
        return DONE
    try:
        return run_and_judge(
            _scenario(),
            None,
            argparse.Namespace(json=False, check=False, no_report=False, verbose=False),
        )
    except UserError as error:
        print(error, file=sys.stderr)
        return BAD_INPUT


def _scenario() -> Scenario:
    """Build the scenario from the ROS parameters, and from the files for single vehicles.

    ROS hands a node its own parameters only; the sections for single vehicles, which the hosts
    need, are read from the files themselves.
    """
    require_ros("supervisor", "platoon simulate runs a scenario")
    from cacc_platoon.supervision.entry_points import supervisor_parameters  # noqa: PLC0415  (needs ROS)

    values = supervisor_parameters()
    overrides: dict[int, dict[str, Any]] = {}
    name, folder = "supervisor", Path()
    for path in parameter_files(sys.argv):
        scenario = load_scenario(path)
        name, folder = scenario.name, path.parent
        for index, section in scenario.overrides.items():
            overrides.setdefault(index, {}).update(section)
    return Scenario.from_values(values, overrides, name, folder)
