"""Single nodes, each a host of its own, and what the supervisor was started with."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import rclpy
from rclpy.exceptions import InvalidNamespaceException
from rclpy.node import Node

from cacc_platoon.dds import shared_memory
from cacc_platoon.dds.environment import set_up
from cacc_platoon.errors import UserError, one_line
from cacc_platoon.model import Channel, ControlLaw, Reception
from cacc_platoon.nodes.executor import create_executor, spin_for
from cacc_platoon.nodes.leader import LeaderNode
from cacc_platoon.nodes.node import RECORD_PARAMETER, PlatoonNode
from cacc_platoon.nodes.noise_relay import NoiseRelayNode
from cacc_platoon.nodes.recorder import RecorderNode
from cacc_platoon.nodes.ros_parameters import given_parameters, scenario_of
from cacc_platoon.nodes.vehicle import VehicleNode
from cacc_platoon.scenario import Follower
from cacc_platoon.scenario.file import parameter_files, read_scenario
from cacc_platoon.scenario.names import NodeKind, NodeName
from cacc_platoon.stop_signal import StopSignal
from cacc_platoon.supervision.host import POLL_PERIOD, serve
from cacc_platoon.supervision.host_session import HostSession
from cacc_platoon.supervision.log import LOG, forward_log
from cacc_platoon.supervision.participant import start_ros, taking_part
from cacc_platoon.supervision.protocol import sendable
from msg_adapters.topics import Graph

BAD_INPUT = 2
HELP = """\
Run the {name} node of one vehicle, as a host of its own.

  ros2 run cacc_platoon {name} --ros-args -r __ns:=/platoon/vehicle_{index} \\
      --params-file config/paper_a.yaml [-p record:=DIR]

The vehicle's index comes from the namespace. The node waits for the supervisor (started with
-p run.spawn:=false) and ends when the run does. With record it records what it publishes; the
supervisor has to know the folder, -p record.parts:=DIR."""

MARKERS_HELP = """\
Draw a platoon for RViz: a box and a number for each vehicle, on <prefix>/markers.

  ros2 run cacc_platoon markers --ros-args -r __ns:=/platoon --params-file config/paper_a.yaml

Works beside a run and beside `ros2 bag play`; `platoon layout` writes an RViz configuration."""

RECORDER_HELP = """\
Record the topics of a whole platoon, for nodes started manually that do not record themselves.

  ros2 run cacc_platoon recorder --ros-args -r __ns:=/platoon \\
      --params-file config/paper_a.yaml -p record:=DIR

The supervisor does this by itself for topics that no node records. It has to know the folder of
one that does, -p record.parts:=DIR."""

Made = TypeVar("Made")


def leader(stop: StopSignal) -> int:
    """Run the leader."""
    return _run_node(stop, "leader", LeaderNode, 0)


def vehicle(
    stop: StopSignal,
    law: Callable[[Follower], ControlLaw] | None,
    reception: Callable[[Follower], Reception] | None,
) -> int:
    """Run a follower; `law` and `reception` may make others from its parameters."""
    return _run_node(stop, "vehicle", lambda: VehicleNode(law=law, reception=reception), 1)


def noise_relay(stop: StopSignal, channel: Callable[[Follower], Channel] | None) -> int:
    """Run a noise relay; `channel` may make another channel from the follower's parameters."""
    return _run_node(stop, "noise_relay", lambda: NoiseRelayNode(channel=channel), 1)


def _run_node(
    stop: StopSignal, name: str, create: Callable[[], PlatoonNode], example_index: int
) -> int:
    """Run one node until the supervisor ends the run, or a signal does."""
    if asked_for_help(HELP.format(name=name, index=example_index)):
        return 0
    if stop.received():
        return stop.exit_code
    node = start(create)
    if node is None:
        return BAD_INPUT
    own = NodeName(NodeKind(name), node.index)
    host = str(own).replace("/", "_")
    recorder = None
    if folder := text_parameter(node, RECORD_PARAMETER):
        topics = list(Graph.of(node.scenario).recorded_with(own))
        recorder = start(lambda: RecorderNode(node.scenario, host, topics, Path(folder) / host))
        if recorder is None:
            return BAD_INPUT
    nodes: list[Node] = [node, recorder] if recorder else [node]
    _log_through(node)
    records, part = (recorder.recorded, str(recorder.folder)) if recorder else ([], "")
    session = HostSession(host, nodes, node.scenario, records=records, part=part)
    LOG.info("waiting for the supervisor")
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
        for path in parameter_files(sys.argv):
            read_scenario(path)  # rcl says it in two lines of its own
        if not rclpy.ok():
            for line in set_up(os.environ):
                print(line, file=sys.stderr)
            start_ros(None)
        with taking_part():
            return create()
    except UserError as error:
        print(error, file=sys.stderr)
    except OSError as error:
        print(one_line(f"{error.filename}: cannot be written: {error.strerror}"), file=sys.stderr)
    except (RuntimeError, InvalidNamespaceException, ValueError) as error:
        print(one_line(" ".join(str(error).split())), file=sys.stderr)
    return None


def _log_through(node: Node) -> None:
    """From now on this process logs as ROS nodes do: on the console and below ROS_LOG_DIR."""
    logger = node.get_logger()
    forward_log(lambda message: logger.info(sendable(message)))


def text_parameter(node: Node, name: str) -> str:
    """Return a node's own text parameter, empty when it was not given."""
    value: Any = node.get_parameter(name).value if node.has_parameter(name) else ""
    return str(value)


def recorder(stop: StopSignal) -> int:
    """Record a whole platoon for hosts that do not record themselves."""
    if asked_for_help(RECORDER_HELP):
        return 0
    if stop.received():
        return stop.exit_code
    made = start(_manual_recorder)
    if made is None:
        return BAD_INPUT
    _log_through(made)
    part = str(made.folder)
    session = HostSession("recorder", [made], made.scenario, records=made.recorded, part=part)
    LOG.info("waiting for the supervisor")
    return serve([made], session, made, stop)


def _manual_recorder() -> RecorderNode:
    node = Node("recorder", automatically_declare_parameters_from_overrides=True)
    try:
        scenario = scenario_of(node, RECORD_PARAMETER)
        folder = text_parameter(node, RECORD_PARAMETER)
    finally:
        node.destroy_node()
    if not folder:
        raise UserError("recorder: has nowhere to record to. Add -p record:=DIR.")
    return RecorderNode(
        scenario, "recorder", Graph.of(scenario).recorded, Path(folder) / "recorder"
    )


def supervisor_parameters() -> dict[str, Any]:
    """Return the parameters that the supervisor executable was started with.

    Raises
    ------
    UserError
        When the command line is not one of ROS, or DDS cannot start.
    """
    set_up(os.environ)
    try:
        start_ros(None)
        node = Node("supervisor", automatically_declare_parameters_from_overrides=True)
        try:
            values = given_parameters(node)
            namespace = node.get_namespace()
        finally:
            node.destroy_node()
            rclpy.try_shutdown()
    except (RuntimeError, InvalidNamespaceException, ValueError) as error:
        raise UserError(f"supervisor: {' '.join(str(error).split())}") from error
    if namespace != "/":
        values.setdefault("platoon.namespace", namespace)
    return values


def markers(stop: StopSignal) -> int:
    """Draw a platoon for RViz until a signal ends it."""
    if asked_for_help(MARKERS_HELP):
        return 0
    try:
        from cacc_platoon.nodes.markers import MarkerNode  # noqa: PLC0415  (optional package)
    except ModuleNotFoundError as error:
        print(f"markers: {error}. It needs visualization_msgs; install it.", file=sys.stderr)
        return BAD_INPUT
    node = start(MarkerNode)
    if node is None:
        return BAD_INPUT
    executor = create_executor()
    executor.add_node(node)
    while not stop.received():
        spin_for(executor, POLL_PERIOD)
    with shared_memory.cleared_segments():
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
    return 0
