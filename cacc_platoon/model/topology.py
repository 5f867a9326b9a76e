"""Who receives from whom over V2V."""

from __future__ import annotations

from itertools import accumulate, pairwise
from typing import NamedTuple

FURTHER = 2**16
"""Between the keys of links to one receiver: more than any index, so that no two are equal."""


class Link(NamedTuple):
    """One V2V link, from a vehicle ahead to a follower; both by index."""

    sender: int
    receiver: int

    @property
    def key(self) -> int:
        """The number by which its random streams are keyed: the receiver's, where it is nearest."""
        return self.receiver + (self.receiver - self.sender - 1) * FURTHER


class Topology(NamedTuple):
    """Each follower receives from its nearest predecessors.

    Attributes
    ----------
    followers : range
        Indices of the followers; the leader has the one before the first.
    predecessors : int
        How many vehicles ahead a follower receives from, as far as there are so many.

    Examples
    --------
    >>> Topology(range(1, 4), predecessors=2).links_to(3)
    (Link(sender=2, receiver=3), Link(sender=1, receiver=3))
    """

    followers: range
    predecessors: int = 1

    def links_to(self, receiver: int) -> tuple[Link, ...]:
        """Return the links to a follower, from the nearest sender on."""
        furthest = max(receiver - self.predecessors, self.followers.start - 1)
        return tuple(Link(sender, receiver) for sender in range(receiver - 1, furthest - 1, -1))

    @property
    def links(self) -> tuple[Link, ...]:
        """All links, from front to rear, those to one follower from the nearest sender on."""
        return tuple(link for receiver in self.followers for link in self.links_to(receiver))

    @property
    def senders(self) -> list[int]:
        """The column of every link's sender among the vehicles, the leader's being 0."""
        return [link.sender - self.followers.start + 1 for link in self.links]

    @property
    def columns(self) -> list[slice]:
        """Where the links to each follower are among all links."""
        ends = list(accumulate((len(self.links_to(i)) for i in self.followers), initial=0))
        return [slice(start, stop) for start, stop in pairwise(ends)]
