"""Names of a platoon's vehicles, nodes and hosts: the one place that writes and parses them."""

from __future__ import annotations

import re
from enum import StrEnum
from typing import NamedTuple

_VEHICLE = re.compile(r"vehicle_(\d{1,9})")


class NodeKind(StrEnum):
    """What a node of a vehicle is; also its ROS name and the name of its executable."""

    LEADER = "leader"
    VEHICLE = "vehicle"
    NOISE_RELAY = "noise_relay"


class NodeName(NamedTuple):
    """A node of one vehicle.

    Examples
    --------
    >>> str(NodeName(NodeKind.NOISE_RELAY, 3))
    'vehicle_3/noise_relay'
    """

    kind: NodeKind
    vehicle: int

    def __str__(self) -> str:
        return f"{vehicle_name(self.vehicle)}/{self.kind}"


def vehicle_name(index: int) -> str:
    """Return the name of a vehicle, the last part of its namespace.

    Examples
    --------
    >>> vehicle_name(3)
    'vehicle_3'
    """
    return f"vehicle_{index}"


def vehicle_index(name: str) -> int | None:
    """Return the index of a vehicle's name, None for any other text.

    Examples
    --------
    >>> vehicle_index("vehicle_3"), vehicle_index("vehicle_x")
    (3, None)
    """
    match = _VEHICLE.fullmatch(name)
    return int(match[1]) if match else None


def split_vehicle(path: str) -> tuple[str, int, str] | None:
    """Return prefix, index and rest of a path with a vehicle in it; None where there is none.

    Examples
    --------
    >>> split_vehicle("/platoon/vehicle_3/v2v/accel")
    ('/platoon', 3, 'v2v/accel')
    >>> split_vehicle("/platoon/vehicle_3")
    ('/platoon', 3, '')
    """
    parts = path.split("/")
    for place in range(len(parts) - 1, -1, -1):
        index = vehicle_index(parts[place])
        if index is not None:
            return "/".join(parts[:place]), index, "/".join(parts[place + 1 :])
    return None


def host_name(host: str) -> str:
    """Return the name of a host: the last part of its namespace, of its part, of its process."""
    return f"host_{host}"
