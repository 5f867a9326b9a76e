"""What `ros2 run` starts: single nodes by hand, each a host of its own, and the supervisor."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import rclpy
from rclpy.exceptions import InvalidNamespaceException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from cacc_platoon.errors import UserError
from cacc_platoon.nodes.host import StopSignal, published_topics, serve
from cacc_platoon.nodes.leader import LeaderNode
from cacc_platoon.nodes.node import RECORD_PARAMETER, PlatoonNode
from cacc_platoon.nodes.noise_relay import NoiseRelayNode
from cacc_platoon.nodes.recorder import RecorderNode
from cacc_platoon.nodes.session import HostSession
from cacc_platoon.nodes.vehicle import VehicleNode

BAD_INPUT = 2
HELP = """\
{summary}

  ros2 run cacc_platoon {name} --ros-args -r __ns:=/platoon/vehicle_{index} \\
      --params-file config/paper_a.yaml [-p record:=DIR]

The vehicle's index comes from the namespace. The node waits for the supervisor (started with
-p run.spawn:=false) and ends when the run does. With record it records what it publishes."""

Made = TypeVar("Made")


def leader() -> int:
    """Run the leader by hand."""
    return _run_node(LeaderNode, 0)


def vehicle() -> int:
    """Run a follower by hand."""
    return _run_node(VehicleNode, 1)


def noise_relay() -> int:
    """Run a noise relay by hand."""
    return _run_node(NoiseRelayNode, 1)


def _run_node(create: Callable[[], PlatoonNode], example_index: int) -> int:
    """Run one node until the supervisor ends the run, or a signal does."""
    name = {LeaderNode: "leader", VehicleNode: "vehicle", NoiseRelayNode: "noise_relay"}[create]  # type: ignore[index]
    if asked_for_help(HELP.format(summary=create.__doc__, name=name, index=example_index)):
        return 0
    stop = StopSignal(signal.SIGINT, signal.SIGTERM)
    node = start(create)
    if node is None:
        return BAD_INPUT
    host = f"vehicle_{node.index}_{name}"
    recorder = None
    if folder := text_parameter(node, RECORD_PARAMETER):
        topics = published_topics(node.scenario, name, node.index)
        recorder = start(lambda: RecorderNode(node.scenario, host, topics, Path(folder) / host))
        if recorder is None:
            return BAD_INPUT
    nodes: list[Node] = [node, recorder] if recorder else [node]
    session = HostSession(host, nodes, node.scenario, recorder)
    node.get_logger().info("waiting for the supervisor")
    return serve(nodes, session, recorder, stop)


def asked_for_help(text: str) -> bool:
    """Print the help text when the command line asks for it."""
    asked = bool({"-h", "--help"} & set(sys.argv[1:]))
    if asked:
        print(text)
    return asked


def start(create: Callable[[], Made]) -> Made | None:
    """Start rclpy and make something of it; when that cannot be, say why in one line."""
    try:
        if not rclpy.ok():
            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        return create()
    except UserError as error:
        print(error, file=sys.stderr)
    except OSError as error:
        print(f"{error.filename}: cannot be written: {error.strerror}", file=sys.stderr)
    except (RuntimeError, InvalidNamespaceException, ValueError) as error:
        print(" ".join(str(error).split()), file=sys.stderr)
    return None


def text_parameter(node: Node, name: str) -> str:
    """Return a node's own text parameter, empty when it was not given."""
    value: Any = node.get_parameter(name).value if node.has_parameter(name) else ""
    return str(value)
