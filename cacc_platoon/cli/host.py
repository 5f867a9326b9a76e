"""Run the vehicles of a platoon that a supervisor on another machine gives to this host.

It waits for a supervisor whose run.remote_hosts has its name, takes part, and ends with the run.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from cacc_platoon.cli.exit_codes import BAD_INPUT
from cacc_platoon.cli.ros import require_ros, set_up_dds
from cacc_platoon.errors import UserError
from cacc_platoon.scenario.checks import check_namespace
from cacc_platoon.scenario.remote_hosts import is_host_name, read_vehicles
from cacc_platoon.stop_signal import STOP_SIGNALS, StopSignal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("name", help="name of the host, as in run.remote_hosts of the supervisor")
    parser.add_argument(
        "--vehicles",
        metavar="1-6",
        help="refuse to run others than these (default: what the supervisor says)",
    )
    parser.add_argument("--namespace", default="/platoon", help="the platoon's (default: /platoon)")
    parser.add_argument(
        "--part",
        type=Path,
        metavar="DIR",
        help="record in DIR/host_NAME and keep it (default: in runs/, until the supervisor has it)",
    )
    parser.add_argument(
        "--timeout",
        type=float,
        default=300.0,
        metavar="SECONDS",
        help="how long to wait for a supervisor (default: 300)",
    )
    parser.add_argument(
        "--own-code",
        action="store_true",
        help="let the scenario, which comes over the network, name code of this machine",
    )
    parser.add_argument(
        "--attached", action="store_true", help="end when standard input does, as run.host_commands"
    )


def run(options: argparse.Namespace) -> int:
    """Wait for a run and take part in it."""
    if not is_host_name(options.name):
        raise UserError(
            f"{options.name[:60]!r} is no name of a host: letters, digits and single underscores, "
            "a letter first. Give the name in run.remote_hosts."
        )
    check_namespace(options.namespace, "--namespace")
    try:
        vehicles = read_vehicles(options.vehicles) if options.vehicles else ()
    except ValueError as error:
        raise UserError(f"--vehicles: {error}. Give vehicles such as 1-6 or 0,3.") from error
    with StopSignal(*STOP_SIGNALS) as stop:
        require_ros("host", "platoon simulate runs a scenario")
        set_up_dds()
        from cacc_platoon.supervision.meeting import Wishes  # noqa: PLC0415  (needs ROS)
        from cacc_platoon.supervision.remote_host import run_remote_host  # noqa: PLC0415

        wishes = Wishes(
            options.name,
            options.namespace,
            vehicles,
            options.part,
            options.timeout,
            options.own_code,
            options.attached,
        )
        return run_remote_host(wishes, stop)


def main() -> int:
    """Run the host as an executable of its own, for `ros2 run` and launch files."""
    parser = argparse.ArgumentParser(prog="host", description=__doc__)
    add_arguments(parser)
    ros = sys.argv.index("--ros-args") if "--ros-args" in sys.argv else len(sys.argv)
    try:
        return run(parser.parse_args(sys.argv[1:ros]))
    except UserError as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
