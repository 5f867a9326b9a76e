"""A part on its way over DDS, from the host that recorded it to the supervisor.

The supervisor says how many bytes of the stream it has, the host sends some more than that: like
the horizon of a run, so that no queue overflows however slow or lossy the network is.
"""

from __future__ import annotations

import contextlib
import struct
import time
from array import array
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Int64, UInt8MultiArray

from cacc_platoon.errors import UserError
from cacc_platoon.nodes import qos
from cacc_platoon.nodes.executor import spin_for
from cacc_platoon.runs.part_stream import CHUNK, PartSink, PartSource, StreamError
from cacc_platoon.supervision.log import LOG
from msg_adapters.topics import PlatoonTopics

AHEAD = 64 * CHUNK
"""Bytes that may be under way."""
DEPTH = 256
"""Pieces that a queue holds."""
HAS_IT, LEAVES_IT = -1, -2
"""What the supervisor says when it wants no more: it has everything, or the host is to keep it."""
PERIOD = 0.25
"""How often it says how much it has [s]."""
PATIENCE = 20.0
"""How long either side waits for a sign of the other [s]."""
_OFFSET = struct.Struct("<Q")


def _pieces() -> QoSProfile:
    """Return the profile of pieces: the first may be sent before the supervisor is connected."""
    return qos.latched(DEPTH)


class PartOffer:
    """Gives a host's part to whoever asks for it.

    Parameters
    ----------
    node : Node
        Carries the messages.
    topics : PlatoonTopics
        Of the platoon.
    host : str
        Name of the host.
    """

    def __init__(self, node: Node, topics: PlatoonTopics, host: str) -> None:
        self._publisher = node.create_publisher(UInt8MultiArray, topics.part(host), _pieces())
        self._asked: int | None = None
        self._heard = time.monotonic()
        node.create_subscription(Int64, topics.part_wanted(host), self._on_wanted, qos.latched())

    def give(
        self,
        executor: Executor,
        folder: Path,
        names: Sequence[str],
        given_up: Callable[[], object],
    ) -> bool:
        """Send a part until the supervisor has it; False when it leaves it, or falls silent.

        Parameters
        ----------
        executor : Executor
            Spins the node.
        folder : Path
            The part.
        names : sequence of str
            Topics that it holds.
        given_up : callable
            Returns whether to wait no longer.
        """
        self._heard = time.monotonic()
        sent, pieces = 0, self._all(folder, names)
        piece = next(pieces, None)
        while self._asked is None or self._asked >= 0:
            if time.monotonic() - self._heard > PATIENCE or given_up():
                return False
            while piece is not None and self._asked is not None and sent < self._asked + AHEAD:
                self._send(sent, piece)
                sent, piece = sent + len(piece), next(pieces, None)
            spin_for(executor, 0.01)
        return self._asked == HAS_IT and piece is None

    @staticmethod
    def _all(folder: Path, names: Sequence[str]) -> Iterator[bytes]:
        """Yield the stream; nothing of a part that cannot be read."""
        with contextlib.suppress(OSError, KeyError, UserError):
            yield from PartSource(folder, names).pieces()

    def _send(self, offset: int, piece: bytes) -> None:
        message = UInt8MultiArray()
        message.data = array("B", _OFFSET.pack(offset) + piece)
        self._publisher.publish(message)

    def _on_wanted(self, message: Int64) -> None:
        self._heard = time.monotonic()
        self._asked = message.data


class PartRequest:
    """Fetches the part of a host.

    Parameters
    ----------
    node : Node
        Carries the messages.
    topics : PlatoonTopics
        Of the platoon.
    host : str
        Name of the host.
    sink : PartSink, optional
        Where it goes; without one, nothing is wanted and the host is told so.

    Attributes
    ----------
    trouble : str
        Why it cannot be had; empty while all is well.
    """

    def __init__(self, node: Node, topics: PlatoonTopics, host: str, sink: PartSink | None) -> None:
        self.sink, self.trouble = sink, ""
        self._wanted = node.create_publisher(Int64, topics.part_wanted(host), qos.latched())
        self._moved = self._said = time.monotonic()
        self._told = 0
        if sink:
            node.create_subscription(UInt8MultiArray, topics.part(host), self._on_piece, _pieces())
        self._say()

    @property
    def over(self) -> bool:
        """Whether there is nothing more to wait for."""
        return self.sink is None or self.sink.complete or bool(self.trouble)

    def poll(self) -> None:
        """Say how much is here; give up when nothing has come for long."""
        now = time.monotonic()
        if not self.over and now - self._moved > PATIENCE:
            self.trouble = f"nothing more of it has come for {PATIENCE:g} s"
        if now - self._said > PERIOD or self.over:
            self._say()

    def _say(self) -> None:
        self._said = time.monotonic()
        self._told = self.sink.received if self.sink else LEAVES_IT
        if self.over:
            self._told = HAS_IT if self.sink and self.sink.complete else LEAVES_IT
        self._wanted.publish(Int64(data=self._told))

    def _on_piece(self, message: UInt8MultiArray) -> None:
        if self.over or self.sink is None:
            return
        data, before = bytes(message.data), self.sink.received
        try:
            if len(data) < _OFFSET.size or len(data) > 2 * CHUNK:
                raise StreamError(f"a piece of {len(data)} bytes came")
            self.sink.take(_OFFSET.unpack_from(data)[0], data[_OFFSET.size :])
        except StreamError as error:
            self.trouble = f"{error}: another publisher is on its topic"
        except OSError as error:
            self.trouble = f"it cannot be written: {error.strerror}"
        if self.sink.received > before:
            self._moved = time.monotonic()
        if self.over or self.sink.received > self._told + AHEAD // 4:
            self._say()


def fetch(
    executor: Executor,
    requests: dict[str, PartRequest],
    observe: Callable[[int], None],
    given_up: Callable[[], bool],
) -> None:
    """Wait until every part is here or cannot be had.

    Parameters
    ----------
    executor : Executor
        Spins the node of the requests.
    requests : dict of str to PartRequest
        By host.
    observe : callable
        Called with how many bytes have come.
    given_up : callable
        Returns whether to wait no longer.
    """
    while not all(request.over for request in requests.values()):
        spin_for(executor, 0.02)
        for request in requests.values():
            request.poll()
        observe(sum(request.sink.received for request in requests.values() if request.sink))
        if given_up():
            for request in requests.values():
                request.trouble = request.trouble or "it was not waited for"
    for host, request in requests.items():
        request.poll()
        if request.sink:
            request.sink.close()
        if request.trouble:
            LOG.info("the part of host %s: %s", host, request.trouble)
