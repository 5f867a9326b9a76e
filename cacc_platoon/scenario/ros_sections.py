"""Which node a section of a ROS parameter file is for; ROS's own rules, wildcards and order."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

from cacc_platoon.scenario.names import NodeKind, NodeName, vehicle_index
from cacc_platoon.scenario.parameter import ScenarioError, flatten

SECTION = "ros__parameters"
VEHICLE_READERS = {
    "vehicle": NodeKind.VEHICLE,
    "sensing": NodeKind.VEHICLE,
    "controller": NodeKind.VEHICLE,
    "v2v": NodeKind.NOISE_RELAY,
}
"""Parameter groups of which a follower may have values of its own, and the node that reads them."""
EVERY_READER = (NodeKind.VEHICLE, NodeKind.NOISE_RELAY)

SAME_QUANTITY = ("v2v.rho", "v2v.snr_db")


@dataclass
class Values:
    """What a file says, by dotted name: for the whole platoon and for single followers."""

    common: dict[str, Any] = field(default_factory=dict)
    overrides: dict[int, dict[str, Any]] = field(default_factory=dict)


def read_sections(
    tree: Mapping[str, Any], source: str, path: str = ""
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield each node name pattern of a parsed file with its flat parameters, in file order.

    Raises
    ------
    ScenarioError
        When a value stands outside of every section, or a pattern can be no node's name.
    """
    for key, value in tree.items():
        if not isinstance(value, Mapping) and key == SECTION:
            raise ScenarioError(
                f"{source}: {SECTION} of {path or 'the file'} holds no parameters. "
                "Write them below it, indented."
            )
        if not isinstance(value, Mapping) or (key == SECTION and not path):
            raise ScenarioError(
                f"{source}: {path or 'the file'} has {key} outside of {SECTION}, it "
                f"would be ignored. Put parameters under /**: {SECTION}:."
            )
        if key != SECTION:
            yield from read_sections(value, source, f"{path}/{str(key).strip('/')}")
        elif re.fullmatch(r"(/(\*\*?|[A-Za-z_]\w*))+", path, re.ASCII):
            yield path, flatten(value)
        else:
            raise ScenarioError(
                f"{source}: section {path} can be no node's name, its values would be ignored. "
                "Use names, * for any one name and ** for any number of names."
            )


class SectionTargets(NamedTuple):
    """The nodes that a section can be for: the platoon's namespace and its followers' indices."""

    prefix: str
    followers: range

    @property
    def leader(self) -> str:
        """The leader's node, which drives ahead of the first follower."""
        return f"{self.prefix}/{NodeName(NodeKind.LEADER, self.followers[0] - 1)}"

    def vehicles_matching(self, pattern: str, nodes: tuple[NodeKind, ...]) -> list[int]:
        """Return the vehicles one of whose `nodes` the pattern is for, with any that it names."""
        return _vehicles_matching(self, pattern, nodes)


@lru_cache(maxsize=1000)
def _vehicles_matching(
    graph: SectionTargets, pattern: str, nodes: tuple[NodeKind, ...]
) -> list[int]:
    """Do the work of `SectionTargets.vehicles_matching`, once for all values of a section."""
    named = [index for part in pattern.split("/") if (index := vehicle_index(part)) is not None]
    candidates = named[:1] or graph.followers
    return [
        index
        for index in candidates
        if any(_matches(pattern, f"{graph.prefix}/{NodeName(node, index)}") for node in nodes)
    ]


def assign(
    sections: list[tuple[str, dict[str, Any]]], graph: SectionTargets, source: str
) -> Values:
    """Give every value to the nodes that would read it; a later section replaces an earlier one.

    Parameters
    ----------
    sections : list of (str, dict)
        Node name patterns with their parameters, in file order.
    graph : SectionTargets
        The nodes there are.
    source : str
        Begins the error line.

    Raises
    ------
    ScenarioError
        When no node of the platoon would read a value.
    """
    values = Values()
    for pattern, section in sections:
        for name, value in section.items():
            if not _assign_one(values, pattern, graph, name, value):
                raise ScenarioError(
                    f"{source}: section {pattern} is for no node of the platoon {graph.prefix} "
                    f"that reads {name}, it would be ignored. "
                    f"Use /** or {graph.prefix}/vehicle_<i>/*."
                )
    return values


def replace(target: dict[str, Any], name: str, value: Any) -> None:
    """Set a value in place of an earlier one, and of another name for the same quantity."""
    forget(target, name)
    target[name] = value


def _assign_one(values: Values, pattern: str, graph: SectionTargets, name: str, value: Any) -> bool:
    """Give one value to its readers; whether there are any."""
    group = name.partition(".")[0]
    common = _matches(pattern, f"{graph.prefix}/supervisor")
    if group == "leader" and _matches(pattern, graph.leader):
        common = True
    reader = VEHICLE_READERS.get(group)
    vehicles = graph.vehicles_matching(pattern, (reader,) if reader else EVERY_READER)
    if common and (vehicles or not reader):
        values.common[name] = value
        for own in values.overrides.values():
            forget(own, name)
        return True
    for index in vehicles:
        values.overrides.setdefault(index, {})[name] = value
    return bool(vehicles)


def forget(target: dict[str, Any], name: str) -> None:
    """Take a value away, and that of another name for the same quantity."""
    for other in SAME_QUANTITY if name in SAME_QUANTITY else (name,):
        target.pop(other, None)


def _matches(pattern: str, node: str) -> bool:
    """Whether a section name, with its wildcards * and **, is for the node.

    It takes one step for each part of the one and each part of the other.
    """
    names = node.split("/")[1:]
    ends = {0}  # how many names the parts so far can stand for
    for part in pattern.split("/")[1:]:
        if part == "**":
            ends = set(range(min(ends), len(names) + 1))
        else:
            ends = {end + 1 for end in ends if end < len(names) and part in ("*", names[end])}
        if not ends:
            return False
    return len(names) in ends
