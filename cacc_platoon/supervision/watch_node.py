"""Hears what a platoon says of itself, for whoever watches it, and holds nobody up.

It hears the supervisor and the views of hosts, no data topic, so that a run neither waits for it
nor sends it what vehicles send each other. Views come best effort; the supervisor's words are
latched, and a queue of it that nobody empties stops nobody either.
"""

from __future__ import annotations

import contextlib
import os
from collections import deque
from collections.abc import Callable, Iterator

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from cacc_platoon.dds import shared_memory
from cacc_platoon.dds.environment import over_udp_alone
from cacc_platoon.errors import UserError
from cacc_platoon.nodes import qos
from cacc_platoon.nodes.executor import create_executor, spin_for
from cacc_platoon.supervision.participant import start_ros
from cacc_platoon.supervision.supervisor_node import MANY
from cacc_platoon.supervision.view_message import Heard
from cacc_platoon.time_limit import time_limit
from msg_adapters.topics import PlatoonTopics

KEPT = 2**21
"""Bytes of views that are kept until somebody looks; older ones are dropped."""
DDS_LIMIT = 5.0
"""How long the node may take to end [s]."""
_STRING = "std_msgs/msg/String"
_SUPERVISOR = "supervisor"


class WatchNode(Node):  # type: ignore[misc]
    """Keeps what a platoon has said of itself since that was taken last."""

    def __init__(self) -> None:
        super().__init__(
            f"watch_{os.getpid()}",
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._forget()

    def follow(self, prefix: str, *, scenario_too: bool = True) -> None:
        """Hear a platoon from now on; its scenario only where that is not known."""
        topics = PlatoonTopics(prefix)
        if scenario_too:
            self._subscribe(topics.scenario, qos.latched(), self._on_scenario)
        self._subscribe(topics.status, qos.latched(), self._on_status)
        self._subscribe(topics.events, qos.latched(MANY), self._on_event)
        self._subscribe(topics.view, qos.glimpse(), self._on_view)

    def take(self) -> Heard:
        """Return what was heard since this was called last."""
        heard = Heard(self._scenario, self._status, tuple(self._events), tuple(self._views))
        self._forget()
        return heard

    def running_platoons(self) -> list[str]:
        """Return the namespaces of the platoons in this domain that have a supervisor."""
        found = []
        for name, types in self.get_topic_names_and_types():
            prefix, _, last = name.rpartition("/")
            if last == "status" and prefix and _STRING in types and self.is_there(prefix):
                found.append(prefix)
        return sorted(found)

    def is_there(self, prefix: str) -> bool:
        """Whether a platoon has a supervisor."""
        return any(
            (info.node_namespace, info.node_name) == (prefix, _SUPERVISOR)
            for info in self.get_publishers_info_by_topic(PlatoonTopics(prefix).status)
        )

    def _forget(self) -> None:
        self._scenario: bytes | None = None
        self._status: bytes | None = None
        self._events: deque[bytes] = deque(maxlen=MANY)
        self._views: deque[bytes] = deque()
        self._kept = 0

    def _subscribe(self, topic: str, profile: QoSProfile, take: Callable[[bytes], None]) -> None:
        self.create_subscription(String, topic, take, profile, raw=True)

    def _on_scenario(self, data: bytes) -> None:
        self._scenario = data

    def _on_status(self, data: bytes) -> None:
        self._status = data

    def _on_event(self, data: bytes) -> None:
        self._events.append(data)

    def _on_view(self, data: bytes) -> None:
        self._views.append(data)
        self._kept += len(data)
        while self._kept > KEPT:
            self._kept -= len(self._views.popleft())


@contextlib.contextmanager
def watching() -> Iterator[tuple[WatchNode, Callable[[float], None]]]:
    """Start rclpy and yield a node that hears, and what spins it for so many seconds.

    It uses no shared memory: nobody can make it deaf, and it leaves nothing when it is killed.

    Raises
    ------
    UserError
        When that cannot be.
    """
    try:
        with over_udp_alone(os.environ):
            start_ros([])
            node = WatchNode()
    except RuntimeError as error:
        rclpy.try_shutdown()
        raise UserError(
            f"ROS does not start: {' '.join(str(error).split())}. Look at ROS_DOMAIN_ID and at "
            "platoon doctor."
        ) from error
    executor = create_executor()
    executor.add_node(node)
    shared_memory.note_segments()
    try:
        yield node, lambda seconds: spin_for(executor, seconds)
    finally:
        with time_limit(DDS_LIMIT, 1), shared_memory.cleared_segments():
            executor.shutdown()
            node.destroy_node()
            rclpy.try_shutdown()
