"""The supervisor: starts the run when everybody is connected, paces it, watches it, ends it."""

from __future__ import annotations

import json
import time
from collections import Counter
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy
from std_msgs.msg import Int64, String

from cacc_platoon.nodes import qos, ros_parameters
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario
from cacc_platoon.scenario.names import NodeName
from cacc_platoon.scenario.table import GROUPS
from cacc_platoon.supervision.host_session import (
    HEARTBEAT_PERIOD,
    MATCHING,
    RUNNING,
    WAITING,
    heard,
)
from msg_adapters.topics import Graph

MAX_HOSTS = 1000
UNKNOWN = "_NODE_NAME_UNKNOWN_"
GRAPH_PERIOD = 0.5


class SupervisorNode(Node):  # type: ignore[misc]
    """Publishes horizon, status and scenario; hears what hosts say and how far recorders are.

    Attributes
    ----------
    run : str
        What tells this run from every other.
    hosts : dict of str to dict
        Last word of each host.
    progress : int
        Sample up to which everything is recorded, -1 before the first.
    """

    def __init__(self, scenario: Scenario, run: str) -> None:
        prefix = scenario.platoon.namespace
        super().__init__("supervisor", namespace=prefix, use_global_arguments=False)
        ros_parameters.declare(self, scenario, {}, tuple(GROUPS))
        self.scenario = scenario
        self.run = run
        self.hosts: dict[str, dict[str, Any]] = {}
        self.progress = -1
        self.state = WAITING
        self.message = ""
        self._recorded: dict[str, int] = {}
        self._strange: list[str] = []
        self._published = -1
        self._last = scenario.samples - 1
        self._heartbeat = 0.0
        self._started = 0.0
        self.graph = Graph.of(scenario)
        self.topics = self.graph.platoon
        latched = qos.latched()
        self._horizon = self.create_publisher(Int64, self.topics.horizon, latched)
        self._status = self.create_publisher(String, self.topics.status, latched)
        self._scenario_publisher = self.create_publisher(String, self.topics.scenario, latched)
        self._scenario_publisher.publish(String(data=format_scenario(scenario)))
        profile = qos.latched()
        profile.depth = MAX_HOSTS
        self.create_subscription(String, self.topics.host_state, self._on_host_state, profile)

    @property
    def complete(self) -> bool:
        """Whether every sample is recorded."""
        return self.progress >= self._last

    def absent_nodes(self) -> list[str]:
        """Return the nodes of the platoon that have not appeared."""
        present = {node for host in self.hosts.values() for node in host["nodes"]}
        return [node for node in self.scenario.node_names if node not in present]

    def begin_matching(self) -> None:
        """Tell everybody which connections to wait for."""
        self._change(MATCHING)

    def unmatched(self) -> list[str]:
        """Return the connections that are still missing."""
        missing = [
            f"recorder of host {name}: its progress is not heard"
            for name, count in self._progress_publishers().items()
            if not count
        ]
        for name, host in self.hosts.items():
            if host["state"] == "up":
                missing += host["missing"] or [f"host {name} has not reported its connections"]
        return missing

    def begin_running(self) -> None:
        """Let the leader go."""
        self._started = time.monotonic()
        self._change(RUNNING)
        self._publish_horizon()

    def advance(self, sample: int) -> None:
        """Take note that everything is there up to a sample, and let the leader follow."""
        if sample > self.progress:
            self.progress = sample
            self._publish_horizon()

    def end(self, state: str, message: str) -> None:
        """Tell everybody that the run has ended, and how."""
        self.message = message
        self._change(state)

    def poll(self) -> None:
        """Keep the heartbeat, and the pace when it is limited."""
        if self.state == RUNNING and self.scenario.run.real_time_factor:
            self._publish_horizon()
        if time.monotonic() - self._heartbeat > HEARTBEAT_PERIOD:
            self._publish_status()

    def failures(self) -> list[str]:
        """Return what hosts have reported as failures."""
        failures = [host["failure"] for host in self.hosts.values() if host["failure"]]
        return failures + self._strange

    def disagreements(self) -> list[str]:
        """Return how parameters of nodes started manually differ from the run's."""
        found = []
        for host in self.hosts.values():
            for node, given in host["parameters"].items():
                index = NodeName.parse(node).vehicle
                groups = {name.partition(".")[0] for name in given}
                expected = ros_parameters.shared_parameters(self.scenario, index, groups)
                found += [
                    f"{node}: {name} = {given[name]} but the run has {value}"
                    for name, value in expected.items()
                    if given.get(name, value) != value
                ]
        return found

    def foreign_publishers(self) -> list[str]:
        """Return the topics of this platoon that somebody else publishes too, with who it is."""
        own = {topic.name for topic in self.graph.run_topics} | {
            *(self.topics.horizon, self.topics.status),
            *(self.topics.recorded(name) for name in self._recorded),
        }
        found = []
        for topic in sorted(own):
            publishers = self.get_publishers_info_by_topic(topic)
            if len(publishers) > 1:
                names = sorted(
                    f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in publishers
                )
                found.append(f"{topic} has {len(names)} publishers: {', '.join(names)}")
        return found

    def host_summaries(self) -> list[dict[str, Any]]:
        """Return name, process and nodes of every host, for run.json and the status."""
        return [
            {"name": name, "pid": host["pid"], "nodes": host["nodes"]}
            for name, host in sorted(self.hosts.items())
        ]

    def _on_host_state(self, message: String) -> None:
        host = heard(message.data)
        if host is None:
            self._strange.append(
                f"{self.topics.host_state}: a message from another publisher, no host of ours"
            )
            return
        name = host["host"]
        if host["run"] != self.run:
            return
        if name not in self.hosts and host["records"]:
            self._recorded[name] = -1
            topic = self.topics.recorded(name)
            self.create_subscription(
                Int64, topic, lambda said: self._on_recorded(name, said.data), qos.latched()
            )
        self.hosts[name] = host

    def _on_recorded(self, host: str, sample: int) -> None:
        if sample > self._published:
            self._strange.append(
                f"host {host}: says that it recorded sample {sample}, beyond the horizon "
                f"{self._published}: it comes from another publisher"
            )
            return
        self._recorded[host] = sample
        self.advance(min(self._recorded.values()))

    def _progress_publishers(self) -> dict[str, int]:
        return {
            host: subscription.get_publisher_count()
            for subscription in self.subscriptions
            if (host := self.topics.host_recorded(subscription.topic_name)) is not None
        }

    def _publish_horizon(self) -> None:
        run = self.scenario.run
        horizon = self.progress + run.window
        if run.real_time_factor:
            elapsed = time.monotonic() - self._started
            horizon = min(horizon, int(elapsed * run.real_time_factor / run.step))
        self._published = max(self._published, horizon + self.scenario.platoon.followers)
        self._horizon.publish(Int64(data=horizon))

    def _count_subscribers(self) -> dict[str, int]:
        """Return how many subscribers each data topic has to reach before the run may start.

        Those of the platoon, and strangers that are in the graph by now: they miss nothing either.
        """
        prefix = self.scenario.platoon.namespace
        own = {f"{prefix}/{node}" for host in self.hosts.values() for node in host["nodes"]}
        wanted = Counter(topic for host in self.hosts.values() for topic in host["subscribes"])
        counts = {}
        for topic in self.graph.run_topics:
            strangers = [
                info
                for info in self.get_subscriptions_info_by_topic(topic.name)
                if f"{info.node_namespace.rstrip('/')}/{info.node_name}" not in own
                and info.node_name != UNKNOWN
                and info.qos_profile.durability == DurabilityPolicy.VOLATILE
            ]
            counts[topic.name] = wanted[topic.name] + len(strangers)
        return counts

    def _change(self, state: str) -> None:
        self.state = state
        self._publish_status()

    def _publish_status(self) -> None:
        self._heartbeat = time.monotonic()
        status = {
            "run": self.run,
            "state": self.state,
            "sample": self.progress,
            "samples": self._last + 1,
            "message": self.message,
            "hosts": self.host_summaries(),
            "subscribers": self._count_subscribers() if self.state == MATCHING else {},
        }
        self._status.publish(String(data=json.dumps(status)))
