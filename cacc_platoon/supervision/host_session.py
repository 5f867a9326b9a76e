"""How a host and the supervisor talk: the start barrier, failures, and the end of the run.

A host publishes what it runs and how it is on <prefix>/host_state; the supervisor publishes what
everybody should do on <prefix>/status. Both are latched JSON texts.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from cacc_platoon.nodes import qos
from cacc_platoon.nodes.node import PlatoonNode
from cacc_platoon.nodes.recorder import RecorderNode
from cacc_platoon.nodes.ros_parameters import shared_parameters
from cacc_platoon.scenario import Scenario
from msg_adapters.topics import PlatoonTopics

WAITING, MATCHING, RUNNING, FINISHED, FAILED = (
    *("waiting", "matching", "running"),
    *("finished", "failed"),
)
ENDED = (FINISHED, FAILED)
HEARTBEAT_PERIOD = 0.2


class HostSession:
    """One host's side of the talk, through one of its nodes.

    Parameters
    ----------
    host : str
        Name of the host.
    nodes : iterable of Node
        All nodes of the process; the first one carries the talk.
    scenario : Scenario
        The run.
    recorder : RecorderNode, optional
        The host's recorder.
    run : str, optional
        Which run the host belongs to; without it, the first one it hears of.
    """

    def __init__(
        self,
        host: str,
        nodes: Iterable[Node],
        scenario: Scenario,
        recorder: RecorderNode | None = None,
        run: str = "",
    ) -> None:
        self._nodes = list(nodes)
        self._prefix = f"{scenario.platoon.namespace}/"
        self._silence_limit = 2.0 * scenario.run.stall_timeout + 5.0
        self._status: dict[str, Any] = {"state": WAITING}
        self._heard: float | None = None
        topics = PlatoonTopics(scenario.platoon.namespace)
        self._state: dict[str, Any] = {
            "run": run,
            "host": host,
            "pid": os.getpid(),
            "nodes": [_relative(node, self._prefix) for node in self._nodes],
            "publishes": self._own_topics("publishers"),
            "subscribes": self._own_topics("subscriptions"),
            "records": recorder.recorded if recorder else [],
            "part": str(recorder.folder) if recorder else "",
            "state": "up",
            "missing": [],
            "failure": "",
            "parameters": {} if run else self._parameters(),
        }
        carrier = self._nodes[0]
        self._publisher = carrier.create_publisher(String, topics.host_state, _many_latched())
        carrier.create_subscription(String, topics.status, self._on_status, qos.latched())
        self._publish()

    @property
    def host(self) -> str:
        """Name of the host."""
        return str(self._state["host"])

    @property
    def finished(self) -> bool:
        """Whether the supervisor has ended the run in good order."""
        return bool(self._status["state"] == FINISHED)

    @property
    def ended(self) -> bool:
        """Whether the supervisor has ended the run."""
        return self._status["state"] in ENDED

    @property
    def abandoned(self) -> bool:
        """Whether the supervisor was heard once and has fallen silent."""
        return self._heard is not None and time.monotonic() - self._heard > self._silence_limit

    def poll(self) -> None:
        """Report failures, and connections while the supervisor waits for them."""
        for node in self._nodes:
            if failures := getattr(node, "failures", None):
                self.fail(failures[0])
        if self._status["state"] == MATCHING and self._state["state"] == "up":
            missing = self._missing(self._status["subscribers"])
            if not missing:
                self._change(state="matched", missing=[])
            elif missing != self._state["missing"]:
                self._change(missing=missing)

    def fail(self, reason: str) -> None:
        """Report a failure that ends the run."""
        if not self._state["failure"]:
            self._change(state="failed", failure=reason)

    def close(self) -> None:
        """Report that the host is done and its part is closed."""
        self._change(state="closed")

    def _on_status(self, message: String) -> None:
        status = heard(message.data)
        if status is None:
            return
        if not self._state["run"]:
            self._change(run=status["run"])
        if status["run"] == self._state["run"]:
            self._status, self._heard = status, time.monotonic()

    def _missing(self, subscribers: dict[str, int]) -> list[str]:
        """Say which connections of this host's nodes are not there yet."""
        missing = []
        for node in self._nodes:
            for publisher in node.publishers:
                expected = subscribers.get(publisher.topic_name, 0)
                found = publisher.get_subscription_count()
                if found < expected:
                    missing.append(
                        f"{_relative(node, self._prefix)}: {found} of {expected} subscribers of "
                        f"{publisher.topic_name}"
                    )
            for subscription in node.subscriptions:
                topic = subscription.topic_name
                if topic in subscribers and not subscription.get_publisher_count():
                    missing.append(f"{_relative(node, self._prefix)}: no publisher of {topic}")
        return missing

    def _own_topics(self, kind: str) -> list[str]:
        return [
            endpoint.topic_name
            for node in self._nodes
            for endpoint in getattr(node, kind)
            if endpoint.topic_name.startswith(self._prefix)
        ]

    def _parameters(self) -> dict[str, dict[str, Any]]:
        """Return the parameters of nodes started manually, which must be those of the run."""
        return {
            _relative(node, self._prefix): shared_parameters(node.scenario, node.index, node.groups)
            for node in self._nodes
            if isinstance(node, PlatoonNode)
        }

    def _change(self, **changes: object) -> None:
        self._state.update(changes)
        self._publish()

    def _publish(self) -> None:
        self._publisher.publish(String(data=json.dumps(self._state)))


def heard(text: str) -> dict[str, Any] | None:
    """Return what a host or a supervisor says; None for a text that is none of ours."""
    try:
        said = json.loads(text)
    except ValueError:
        return None
    return said if isinstance(said, dict) and {"run", "state"} <= said.keys() else None


def _relative(node: Node, prefix: str) -> str:
    name: str = node.get_fully_qualified_name()
    return name.removeprefix(prefix)


def _many_latched() -> QoSProfile:
    """Return the latched profile with room for the few changes of a host's state."""
    profile = qos.latched()
    profile.depth = 10
    return profile
