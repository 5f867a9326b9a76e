"""What a verb that starts nodes needs: ROS, and hosts being prepared."""

from __future__ import annotations

import argparse
import importlib.util
import os
import subprocess
import sys
from functools import cache

from cacc_platoon.cli.console import libraries_on_stderr, say
from cacc_platoon.dds.environment import check_loading, set_up
from cacc_platoon.errors import UserError

RMW_VARIABLES = ("RMW_IMPLEMENTATION", "RCL_ASSERT_RMW_ID_MATCHES")
USUAL_RMW = "rmw_fastrtps_cpp"
ROS_MODULES = (
    "rclpy",
    "rcl_interfaces",
    "rosgraph_msgs",
    "std_msgs",
    "std_srvs",
    "geometry_msgs",
)


def require_ros(verb: str, without_ros: str) -> None:
    """Refuse a verb that starts nodes where there is no ROS.

    Parameters
    ----------
    verb : str
        Who needs it.
    without_ros : str
        What does a part of it without.

    Raises
    ------
    UserError
        When a package of ROS cannot be loaded, or its middleware is not there.
    """
    check_loading()
    if fault := rmw_fault():
        raise UserError(f"platoon {verb}: {fault}")
    try:
        from cacc_platoon.supervision import launcher  # noqa: PLC0415, F401  (that is the question)
    except ModuleNotFoundError as error:
        if error.name not in ROS_MODULES:
            raise
        raise UserError(
            f"platoon {verb}: {error}. It needs ROS 2: source its setup file or see Install in "
            f"the README; {without_ros} without."
        ) from error


@cache
def rmw_fault() -> str:
    """Say what is wrong with the middleware that the environment asks for; empty when it is there.

    Without it the import of rclpy ends the process, so another process tries it first.
    """
    asked = {name: os.environ[name] for name in RMW_VARIABLES if os.environ.get(name)}
    if set(asked.values()) <= {USUAL_RMW} or importlib.util.find_spec("rclpy") is None:
        return ""
    command = [sys.executable, "-c", "import rclpy; rclpy.get_rmw_implementation_identifier()"]
    done = subprocess.run(command, capture_output=True, check=False)
    if done.returncode == 0:
        return ""
    named = " and ".join(f"{name} = {value}" for name, value in asked.items())
    return (
        f"{named} is not installed here, so no node can start. Install it, or take the "
        f"variable out of the environment to use {USUAL_RMW}."
    )


def prepare_nodes(processes: int = 1) -> None:
    """Begin to load what hosts need.

    Processes of hosts, so many, begin with the environment as it is now. DDS stays on this machine
    unless the environment says otherwise.

    Raises
    ------
    UserError
        When DDS cannot start in this environment.
    """
    from cacc_platoon.supervision import launcher  # noqa: PLC0415  (needs ROS)

    set_up_dds(processes)
    with libraries_on_stderr():
        launcher.prepare()


def set_up_dds(processes: int = 1) -> None:
    """Let processes, so many, take part in DDS on this machine, unless the environment says more.

    Raises
    ------
    UserError
        When DDS cannot start in this environment.
    """
    for line in set_up(os.environ, processes):
        say(f"warning: {line}")


def add_verbose_argument(parser: argparse.ArgumentParser) -> None:
    """Declare how much a verb that starts nodes says of them."""
    parser.add_argument(
        "-v",
        "--verbose",
        action="store_true",
        help="show on standard error what the supervisor and every host log",
    )


def log_everything() -> None:
    """From now on, show what the supervisor and every host log on standard error."""
    from cacc_platoon.supervision.log import log_to_stderr  # noqa: PLC0415  (needs ROS)

    log_to_stderr()
