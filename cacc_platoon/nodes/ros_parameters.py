"""The parameter table as ROS parameters: declared with descriptors, read back into a scenario."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import parameter_files, scenario_version
from cacc_platoon.scenario.names import split_vehicle
from cacc_platoon.scenario.parameter import Parameter, ScenarioError, refuse_unknown
from cacc_platoon.scenario.table import FORMER_NAMES, SNR_DB, TABLE

FOREIGN = ("use_sim_time", "qos_overrides.", "start_type_description_service")
_LARGE = 1e300


def descriptor(row: Parameter, *, changeable: bool = False) -> ParameterDescriptor:
    """Return the ROS descriptor of a table row: meaning, unit, range; whether it may change."""
    unit = "" if row.unit == "-" else f" [{row.unit}]"
    description = ParameterDescriptor(
        name=row.name,
        description=f"{row.meaning}{unit}",
        additional_constraints=row.range_text,
        read_only=not changeable,
        dynamic_typing=changeable or " | " in row.kind,
    )
    low, high = row.at_least, row.at_most
    if row.kind == "float" and (low is not None or high is not None):
        description.floating_point_range = [
            FloatingPointRange(
                from_value=-_LARGE if low is None else float(low),
                to_value=_LARGE if high is None else float(high),
            )
        ]
    if row.kind == "int" and (low is not None or high is not None):
        description.integer_range = [
            IntegerRange(
                from_value=-(2**63) if low is None else int(low),
                to_value=2**63 - 1 if high is None else int(high),
            )
        ]
    return description


def declare(
    node: Node,
    scenario: Scenario,
    overrides: Mapping[str, Any],
    groups: tuple[str, ...],
    changeable: str = "",
) -> None:
    """Declare the parameters of some groups with the values the node will use.

    All of them but the one that is `changeable` stay as they are.
    """
    values = {**scenario.values(), **overrides}
    rows = [row for row in TABLE.values() if row.name.partition(".")[0] in groups]
    given = [row.name for row in rows if node.has_parameter(row.name)]
    for name in given:
        node.undeclare_parameter(name)
    node.declare_parameters(
        "",
        [
            (
                row.name,
                list(value) if isinstance(value, tuple) else value,
                descriptor(row, changeable=row.name == changeable),
            )
            for row in rows
            if (value := values[row.name]) != ()
        ],
        ignore_override=True,
    )


def given_parameters(node: Node, *own: str) -> dict[str, Any]:
    """Return the parameters a node was started with, by dotted name, less its `own`.

    Raises
    ------
    ScenarioError
        For a name that neither the table nor the node has.
    """
    found: dict[str, RosParameter] = node.get_parameters_by_prefix("")
    names = [name for name in found if name not in own and not name.startswith(FOREIGN)]
    source = f"parameters of {node.get_fully_qualified_name()}"
    refuse_unknown(names, [*TABLE, SNR_DB.name, *FORMER_NAMES, *own], source)
    return {name: _plain(found[name].value) for name in names}


def scenario_of(node: Node, *own: str) -> Scenario:
    """Build the scenario of a node that was started manually, from its parameters."""
    values = given_parameters(node, *own)
    prefix = namespace_prefix(node.get_namespace())
    if values.setdefault("platoon.namespace", prefix) != prefix:
        raise ScenarioError(
            f"{node.get_fully_qualified_name()}: is not in platoon.namespace = "
            f"{values['platoon.namespace']}, the platoon would never find it. "
            "Correct one of the two."
        )
    files = parameter_files(sys.argv)
    for file in files:
        scenario_version(file.read_text(encoding="utf-8"), str(file))
    folder = files[-1].parent if files else Path()
    source = f"parameters of {node.get_fully_qualified_name()}"
    return Scenario.from_values(values, None, source, folder)


def refuse_unknown_node(scenario: Scenario, node: str) -> None:
    """Raise ScenarioError when a platoon has no such node, which would wait for ever."""
    names = scenario.node_names
    if node not in names:
        raise ScenarioError(
            f"{node}: is no node of this platoon, which has {names[0]} to {names[-1]}. Correct "
            "the namespace or platoon.followers."
        )


def namespace_prefix(namespace: str) -> str:
    """Return the platoon's prefix of a vehicle's namespace."""
    found = split_vehicle(namespace)
    return found[0] if found and not found[2] else namespace


def vehicle_index(namespace: str, executable: str) -> int:
    """Return the vehicle's index from its namespace.

    Raises
    ------
    ScenarioError
        When the namespace does not end in vehicle_<i>.
    """
    found = split_vehicle(namespace)
    if found is None or not found[0] or found[2]:
        raise ScenarioError(
            f"{executable}: takes its index from its namespace, but runs in {namespace}. "
            "Add --ros-args -r __ns:=/platoon/vehicle_<i>."
        )
    return found[1]


def _plain(value: Any) -> Any:
    return tuple(value) if hasattr(value, "__len__") and not isinstance(value, str) else value
