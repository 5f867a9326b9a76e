"""What a host that may be started again records, before anybody else can know of it.

A process that is killed has then told nobody what is not in its record, and no vehicle has used a
packet that is not in its own. So the process that comes in its place says the same, to the last
bit, and the record of a vehicle is that of what it used.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from typing import TypeAlias

from cacc_platoon.runs.past import Past
from msg_adapters.stamped import LayoutError
from msg_adapters.topics import Topic, is_packets

Receive: TypeAlias = Callable[[bytes], object]
"""Takes the CDR bytes of a message."""


class Journal:
    """Records what the nodes of a host send and receive, in the order in which that happens.

    Parameters
    ----------
    record : mapping of str to callable
        What records the messages of each topic that the host records.
    step : int
        Control period [ns].
    again : int
        So many of the last messages are sent again, since nobody knows who has them: as many as
        wait for one who stands still.
    past : Past, optional
        What was recorded before this process was started again; it is recorded anew at once.

    Attributes
    ----------
    resumed : bool
        Whether there is a past.
    """

    def __init__(
        self, record: Mapping[str, Receive], step: int, again: int, past: Past | None = None
    ) -> None:
        self._record, self._step, self._again, self._past = record, step, again, past
        self.resumed = past is not None
        self._live_from = -math.inf if past is None else math.inf
        self._held: deque[tuple[Receive, bytes]] = deque()
        self._followed: list[tuple[str, Receive]] = []
        if past:
            for name, take in record.items():
                for data in past.rows(name):
                    take(data)

    def sending(self, topic: Topic, publish: Receive) -> Receive:
        """Return what records each message of a topic and publishes it.

        After a start the same messages come again, which are known but for the last ones. Packets
        are recorded where they arrive; those are lost of which nobody knows whether they did.
        """
        if is_packets(topic.name):
            return self._sending_packets(topic, publish) if self._past else publish
        known = self._past.count(topic.name) if self._past else 0
        take = self._record[topic.name]

        def send(data: bytes) -> None:
            nonlocal known
            known -= 1
            if known < 0:
                take(data)
            elif known >= self._again:
                return
            if self._live_from == math.inf:
                self._held.append((publish, data))
            else:
                publish(data)

        return send

    def _sending_packets(self, topic: Topic, publish: Receive) -> Receive:
        def send_live(data: bytes) -> None:
            if topic.codec.decode(data)[0] >= self._live_from:
                publish(data)

        def send(data: bytes) -> None:
            if self._live_from == math.inf:
                self._held.append((send_live, data))
            else:
                send_live(data)

        return send

    def receiving(self, topic: Topic, receive: Receive) -> Receive:
        """Return what hands on each message of a topic, packets once they are recorded.

        After a start it begins where the past ends.
        """
        self._followed.append((topic.name, receive))
        if not is_packets(topic.name):
            return self._completed(self._past, topic, receive) if self._past else receive
        take = self._record[topic.name]

        def receive_recorded(data: bytes) -> None:
            take(data)
            receive(data)

        return receive_recorded

    def recalling(self, topic: Topic, receive: Receive) -> None:
        """Let `resume` hand on what was recorded of a topic that nobody follows."""
        self._followed.append((topic.name, receive))

    def resume(self) -> None:
        """Hand on what was recorded before this process was started."""
        for name, receive in self._followed:
            for data in self._past.rows(name) if self._past else ():
                receive(data)

    def begin(self, sample: int) -> None:
        """From now on everybody is connected; packets count from a sample on."""
        if self._past:
            self._live_from = sample * self._step
        while self._held:
            publish, data = self._held.popleft()
            publish(data)

    def _completed(self, past: Past, topic: Topic, receive: Receive) -> Receive:
        """Return what hands on every sample: what came since the past is taken from the record."""
        due, waiting = past.count(topic.name), list[bytes]()

        def follow(data: bytes) -> None:
            nonlocal due
            try:
                newest = topic.codec.decode(data)[0] // self._step
            except LayoutError:
                receive(data)  # which refuses it
                return
            waiting.append(data)
            first = topic.codec.decode(waiting[0])[0] // self._step
            missed = past.between(topic.name, due, first) if due < first else []
            for one in missed:
                receive(one)
            due += len(missed)
            if due < first:
                return  # it is not recorded yet
            for one in waiting:
                receive(one)
            due = max(due, newest + 1)
            waiting.clear()

        return follow
