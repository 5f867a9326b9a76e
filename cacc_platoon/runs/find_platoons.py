"""Which platoons a bag holds: namespaces and vehicles, found from the names of its topics."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

from cacc_platoon.bags.raw import RawTopic
from msg_adapters.topics import role_of

MAX_FOLLOWERS = 500
_PREFIX = re.compile(r"(/\w+)*", re.ASCII)


class FoundPlatoon(NamedTuple):
    """A platoon seen in a bag.

    Attributes
    ----------
    prefix : str
        Its namespace.
    vehicles : tuple of int
        Indices that have at least one topic.
    messages : int
        Messages on their topics.
    """

    prefix: str
    vehicles: tuple[int, ...]
    messages: int


def find_platoons(topics: Mapping[str, list[RawTopic]]) -> list[FoundPlatoon]:
    """Return the platoons of a bag, the one with the most messages first."""
    vehicles: dict[str, set[int]] = {}
    messages: dict[str, int] = {}
    for name, parts in topics.items():
        found = role_of(name)
        if found and found[1].vehicle <= MAX_FOLLOWERS and _PREFIX.fullmatch(found[0]):
            prefix, role = found
            vehicles.setdefault(prefix, set()).add(role.vehicle)
            count = sum(len(part.lengths) for part in parts)
            messages[prefix] = messages.get(prefix, 0) + count
    platoons = [
        FoundPlatoon(prefix, tuple(sorted(indices)), messages[prefix])
        for prefix, indices in vehicles.items()
    ]
    return sorted(platoons, key=lambda platoon: (-platoon.messages, platoon.prefix))
