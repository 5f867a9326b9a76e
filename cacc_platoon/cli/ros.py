"""What a verb that starts nodes needs: ROS, and hosts being prepared."""

from __future__ import annotations

import argparse
import os
import sys

from cacc_platoon.cli.console import libraries_on_stderr
from cacc_platoon.dds.environment import check_loading, set_up
from cacc_platoon.errors import UserError

ROS_MODULES = ("rclpy", "rcl_interfaces", "std_msgs", "geometry_msgs")


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
        When a package of ROS cannot be loaded.
    """
    check_loading()
    try:
        from cacc_platoon.supervision import launcher  # noqa: PLC0415, F401  (that is the question)
    except ModuleNotFoundError as error:
        if error.name not in ROS_MODULES:
            raise
        raise UserError(
            f"platoon {verb}: {error}. It needs ROS 2: source its setup file or see Install in "
            f"the README; {without_ros} without."
        ) from error


def prepare_nodes() -> None:
    """Begin to load what hosts need.

    Processes of hosts begin with the environment as it is now. DDS stays on this machine unless
    the environment says otherwise.

    Raises
    ------
    UserError
        When DDS cannot start in this environment.
    """
    from cacc_platoon.supervision import launcher  # noqa: PLC0415  (needs ROS)

    for line in set_up(os.environ):
        print(f"platoon: warning: {line}", file=sys.stderr)
    with libraries_on_stderr():
        launcher.prepare()


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
