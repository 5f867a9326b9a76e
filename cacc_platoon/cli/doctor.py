"""Say what is installed, whether nodes reach each other, and what stands in the way."""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import platform
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from cacc_platoon import __version__
from cacc_platoon.cli.console import libraries_on_stderr
from cacc_platoon.cli.exit_codes import DONE, FAILED
from cacc_platoon.cli.ros import rmw_fault
from cacc_platoon.dds.environment import RANGE, check_loading, is_local, set_up
from cacc_platoon.dds.shared_memory import sweep
from cacc_platoon.errors import UserError

LIBRARIES = ("numpy", "rosbags", "ruamel.yaml", "matplotlib")
ENVIRONMENT = (
    "ROS_DISTRO",
    "ROS_DOMAIN_ID",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "RMW_IMPLEMENTATION",
    "ROS_STATIC_PEERS",
)
FREE_SPACE = 2**30


class Finding(NamedTuple):
    """One thing looked at: whether it is well, and what was found or should be done."""

    what: str
    well: bool
    text: str


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("--json", action="store_true", help="print the findings as one object")


def run(options: argparse.Namespace) -> int:
    """Look at everything; exit with 1 when something needed is not well."""
    checks: list[Callable[[], Finding]] = [
        _python,
        *(lambda name=name: _library(name) for name in LIBRARIES),
        _rclpy,
        _network,
        _discovery,
        _shared_memory,
        _disk,
    ]
    with libraries_on_stderr():
        findings = [check() for check in checks]
    if options.json:
        print(
            json.dumps({found.what: {"ok": found.well, "text": found.text} for found in findings})
        )
    else:
        for found in findings:
            print(f"{'ok ' if found.well else 'NO '} {found.what:15} {found.text}")
    return DONE if all(found.well for found in findings) else FAILED


def _python() -> Finding:
    version = platform.python_version()
    text = f"{version}, cacc_platoon {__version__}, {os.cpu_count()} cores, {sys.platform}"
    return Finding("python", sys.version_info >= (3, 11), text)


def _library(name: str) -> Finding:
    try:
        return Finding(name, True, importlib.metadata.version(name))
    except importlib.metadata.PackageNotFoundError:
        return Finding(name, False, f"is not installed: pip install {name}")


def _rclpy() -> Finding:
    if fault := rmw_fault():
        return Finding("rclpy", False, fault)
    try:
        check_loading()
        import rclpy  # noqa: PLC0415, F401  (that is the question)
        from rclpy.utilities import get_rmw_implementation_identifier  # noqa: PLC0415

        from cacc_platoon.nodes.executor import create_executor  # noqa: PLC0415, F401
    except UserError as error:
        return Finding("rclpy", False, str(error))
    except ImportError as error:
        return Finding("rclpy", False, f"{error}; source ROS 2 Jazzy or see Install in the README")
    settings = ", ".join(f"{name}={os.environ[name]}" for name in ENVIRONMENT if name in os.environ)
    return Finding(
        "rclpy", True, f"{get_rmw_implementation_identifier()}; {settings or 'defaults'}"
    )


def _network() -> Finding:
    """Say from where nodes can be reached."""
    try:
        lines = set_up(os.environ)
    except UserError as error:
        return Finding("network", False, str(error))
    where = (
        "nodes can be reached from this machine alone"
        if is_local(os.environ)
        else f"nodes can be reached from other machines, as {RANGE} or a profile of yours says"
    )
    return Finding("network", not lines, "; ".join([where, *lines]))


def _discovery() -> Finding:
    """Let two processes exchange a message over DDS."""
    if rmw_fault():
        return Finding("DDS", False, "not tried without rclpy")
    try:
        set_up(os.environ)
        check_loading()
        from cacc_platoon.supervision.round_trip import measure_round_trip  # noqa: PLC0415
    except ImportError:
        return Finding("DDS", False, "not tried without rclpy")
    except UserError:
        return Finding("DDS", False, "not tried, see above")
    seconds = measure_round_trip(timeout=10.0)
    if seconds is None:
        return Finding(
            "DDS",
            False,
            "two processes on this machine do not find each other: look at ROS_DOMAIN_ID, "
            "ROS_AUTOMATIC_DISCOVERY_RANGE and a firewall on the loopback interface",
        )
    return Finding("DDS", True, f"two processes found each other and answered in {seconds:.2f} s")


def _shared_memory() -> Finding:
    removed, broken = sweep()
    text = f"removed {len(removed)} leftovers of killed runs" if removed else "no leftovers"
    return Finding("shared memory", not broken, "; ".join([text, *broken]))


def _disk() -> Finding:
    free = shutil.disk_usage(Path.cwd()).free
    text = f"{free / 2**30:.1f} GiB free here; a run of 200 s with 12 followers takes 0.3 GiB"
    return Finding("disk", free > FREE_SPACE, text)
