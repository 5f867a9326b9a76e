"""What was recorded before a host was started again, for its nodes to go on from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from cacc_platoon.bags.rows import TopicRows
from cacc_platoon.runs.parts import newest_of
from cacc_platoon.scenario.names import split_vehicle
from msg_adapters.topics import VehicleTopics, is_count


class Past:
    """The messages of a run so far, as its hosts have recorded them on this machine.

    Parameters
    ----------
    ended : Path
        The folder with the parts of hosts that ended.
    parts : Path
        The folder in which all hosts record.
    """

    def __init__(self, ended: Path, parts: Path) -> None:
        self._folders = parts, ended
        self._records = self._read()

    def rows(self, topic: str) -> list[bytes]:
        """Return the messages of a topic up to when this was made."""
        return self._bytes(self._records, topic, 0, self.count(topic))

    def count(self, topic: str) -> int:
        """Return how many messages of a topic there are, up to when this was made.

        What a vehicle by a clock had used at its samples is cut to those of which all is recorded;
        how it moved follows from the samples before.
        """
        found, vehicle = self._records.get(topic), split_vehicle(topic)
        if found is None:
            return 0
        number = len(found.messages)
        if vehicle is None or not is_count(topic):
            return number
        prefix, index, _ = vehicle
        timing = self._records.get(VehicleTopics(prefix, index).timing.name)
        return number if timing is None else min(number, len(timing.messages))

    def between(self, topic: str, begin: int, end: int) -> list[bytes]:
        """Return the messages of some samples of a topic that has every sample.

        Others go on recording, so there may be more of them than there were.
        """
        return self._bytes(self._read(), topic, begin, end)

    def _read(self) -> dict[str, TopicRows]:
        return newest_of(*self._folders)

    @staticmethod
    def _bytes(records: Mapping[str, TopicRows], topic: str, begin: int, end: int) -> list[bytes]:
        found = records.get(topic)
        return [] if found is None else [row.tobytes() for row in found.messages[begin:end]]
