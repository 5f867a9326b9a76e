"""Manually started nodes have parameters of their own; those of the run they must share."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import split_vehicle

LOCAL = {
    *("run.hosts", "run.spawn", "run.manual_nodes", "run.real_time_factor", "run.start_timeout"),
    *("run.remote_hosts", "run.host_commands"),
    *("run.stall_timeout", "record.directory", "record.parts", "leader.file", "leader.digest"),
}
"""Parameters of which a manually started node may have values of its own."""


def shared_parameters(scenario: Scenario, index: int, groups: Iterable[str]) -> dict[str, Any]:
    """Return the parameters of some groups in which a vehicle must agree with the run."""
    values = {**scenario.values(), **scenario.overrides.get(index, {})}
    if index in scenario.indices:
        values["vehicle.tau"] = scenario.follower(index).tau
    groups = set(groups)
    shared = {
        name: value
        for name, value in values.items()
        if name.partition(".")[0] in groups and name not in LOCAL
    }
    plain: dict[str, Any] = json.loads(json.dumps(shared))
    return plain


def disagreements(scenario: Scenario, parameters: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return how the parameters of nodes, by node and name, differ from those of the run."""
    found = []
    for node, given in parameters.items():
        vehicle = split_vehicle(node)
        if vehicle is None:
            found.append(f"{node}: is no node of a vehicle")
            continue
        groups = {name.partition(".")[0] for name in given}
        expected = shared_parameters(scenario, vehicle[1], groups)
        found += [
            f"{node}: {name} = {given[name]} but the run has {value}"
            for name, value in expected.items()
            if given.get(name, value) != value
        ]
    return found
