"""A host's part in a run, through one of its nodes: what it receives and what it publishes.

What that means is decided in `host_machine`; here are topics, connections and the clock.
"""

from __future__ import annotations

import math
import os
import platform
import time
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from rclpy.node import Node
from std_msgs.msg import String

from cacc_platoon.nodes import qos
from cacc_platoon.nodes.node import PlatoonNode
from cacc_platoon.nodes.recorder import RecorderNode
from cacc_platoon.runs.journal import Journal
from cacc_platoon.scenario import Scenario
from cacc_platoon.supervision.agreement import shared_parameters
from cacc_platoon.supervision.host_machine import Endpoint, HostMachine, missing_connections
from cacc_platoon.supervision.log import LOG
from cacc_platoon.supervision.protocol import (
    HostPhase,
    HostState,
    OtherVersionError,
    ProtocolError,
    RunStatus,
    sendable,
)
from cacc_platoon.supervision.run_state import some
from cacc_platoon.supervision.view_answers import ViewAnswers
from msg_adapters.topics import Graph, PlatoonTopics

STATES = 10
"""States of a host that there is room for; few of them matter."""
CONNECTION_MARGIN = 0.5
"""For so long connections have to be there before a host that was started again goes on [s]."""
CONNECTION_LIMIT = 5.0
"""So long a host that was started again waits for subscribers [s]; some may have ended."""
SUPERVISOR_LIMIT = 10.0
"""So many start time-outs a host waits for a run."""


class HostSession:
    """One host's part in a run.

    Parameters
    ----------
    host : str
        Name of the host.
    nodes : iterable of Node
        All nodes of the process; the first one carries the messages.
    scenario : Scenario
        The run.
    records : sequence of str, optional
        Topics that the host records.
    part : str, optional
        Where it does so.
    run : str, optional
        Which run the host belongs to; without it, the first one it meets that is not over.
    failure : str, optional
        Why it cannot do its part; it is there to say so.
    journal : Journal, optional
        Of nodes that may be started again. Where they were, the host waits for those who receive
        what it publishes.
    """

    def __init__(
        self,
        host: str,
        nodes: Iterable[Node],
        scenario: Scenario,
        *,
        records: Sequence[str] = (),
        part: str = "",
        run: str = "",
        failure: str = "",
        journal: Journal | None = None,
    ) -> None:
        self._nodes = list(nodes)
        self._prefix = f"{scenario.platoon.namespace}/"
        state = HostState(
            run=run,
            host=host,
            pid=os.getpid(),
            nodes=tuple(self._relative(node) for node in self._nodes),
            publishes=self._own_topics("publishers"),
            subscribes=self._own_topics("subscriptions"),
            records=tuple(records),
            part=part,
            parameters={} if run else self._parameters(),
            machine=sendable(platform.node()),
        )
        self._misunderstood = self._begun = False
        self._journal, self._scenario = journal, scenario
        self._heard_since = math.inf
        self._start_timeout = scenario.run.start_timeout
        self._wait = SUPERVISOR_LIMIT * self._start_timeout
        self._waits_since = time.monotonic()
        self._machine = HostMachine(state, 2.0 * scenario.run.stall_timeout + 5.0)
        topics, carrier = PlatoonTopics(scenario.platoon.namespace), self._nodes[0]
        self._publisher = carrier.create_publisher(String, topics.host_state, qos.latched(STATES))
        carrier.create_subscription(String, topics.status, self._on_status, qos.latched())
        self._answers = [
            ViewAnswers(node, host, lambda: self._machine.state.run)
            for node in self._nodes
            if isinstance(node, RecorderNode)
        ]
        LOG.info("host %s: process %d, %s", host, state.pid, ", ".join(state.nodes))
        self._publish()
        if failure:
            self.fail(failure)

    def __str__(self) -> str:
        """Name the host, its process and its nodes."""
        state = self._machine.state
        return f"host {state.host} (process {state.pid}: {some(state.nodes)})"

    @property
    def host(self) -> str:
        """Name of the host."""
        return self._machine.state.host

    @property
    def finished(self) -> bool:
        """Whether the supervisor has ended the run cleanly."""
        return self._machine.finished

    @property
    def ended(self) -> bool:
        """Whether the supervisor has ended the run."""
        return self._machine.ended

    @property
    def samples(self) -> int:
        """How many samples the run takes, as far as the supervisor has said; 0 before."""
        return self._machine.samples

    @property
    def abandoned(self) -> bool:
        """Whether the supervisor was there once and has fallen silent."""
        return self._machine.abandoned(time.monotonic())

    @property
    def unmet(self) -> str:
        """Why no run is waited for any longer; empty while one is, and once one was met."""
        if self._machine.status or time.monotonic() - self._waits_since < self._wait:
            return ""
        return (
            f"no supervisor has come for {self._wait:g} s. Start it sooner, or raise "
            "run.start_timeout."
        )

    def poll(self) -> None:
        """Report failures, and connections while the supervisor waits for them."""
        for node in self._nodes:
            if failures := getattr(node, "failures", None):
                self.fail(failures[0])
            if events := getattr(node, "events", None):
                self._go_on(self._machine.take_events(events))
                events.clear()
        if self._machine.awaits_connections:
            self._go_on(self._machine.take_connections(self._endpoints()))

    def fail(self, reason: str) -> None:
        """Report a failure that ends the run."""
        self._go_on(self._machine.fail(reason))

    def close(self) -> None:
        """Report that the host is done and its part is closed."""
        self._go_on(self._machine.close())

    def _on_status(self, message: String) -> None:
        received = time.time_ns()
        try:
            status = RunStatus.from_json(message.data)
        except OtherVersionError as error:
            if not self._misunderstood:
                LOG.info("%sstatus: %s", self._prefix, error)
            self._misunderstood = True
            return
        except ProtocolError:
            return  # the supervisor sees in the graph who else publishes there
        if status.phase.ended and self._wait > self._start_timeout:  # that run will not come again
            self._wait, self._waits_since = self._start_timeout, time.monotonic()
        known = self._machine.status
        self._go_on(self._machine.take_status(status, time.monotonic(), received))
        if (start := self._machine.start) and not self._begun and self._is_heard():
            self._begin(start)
        if self._machine.status is status and (known is None or known.phase is not status.phase):
            LOG.info("run %s: %s", status.run, " ".join([status.phase, status.message]).strip())

    def _is_heard(self) -> bool:
        """Return whether those are connected that receive what is published, or never come.

        The other ends may see a connection somewhat later.
        """
        now = time.monotonic()
        resumed = self._journal and self._journal.resumed
        if not resumed or now - self._waits_since > CONNECTION_LIMIT:
            return True
        if missing_connections(self._endpoints(), Graph.of(self._scenario).followers):
            self._heard_since = math.inf
        self._heard_since = min(self._heard_since, now)
        return now - self._heard_since > CONNECTION_MARGIN

    def _begin(self, start: int) -> None:
        """Let the clocks of the nodes begin at a time [ns since 1970]."""
        self._begun = True
        now = time.monotonic_ns()
        steady = now + start - time.time_ns()
        if self._journal:
            self._journal.begin(int((now - steady) / 1e9 / self._scenario.run.clock_period))
        for node in self._nodes:
            if isinstance(node, PlatoonNode):
                node.begin(steady)

    def _go_on(self, machine: HostMachine) -> None:
        """Keep the new record, and publish its state when that is new."""
        before, self._machine = self._machine.state, machine
        if machine.state == before:
            return
        phase = machine.state.phase
        if phase is HostPhase.FAILED and phase is not before.phase:
            LOG.info("%s: %s", phase, machine.state.failure)
        elif phase is not before.phase:
            LOG.info("host %s: %s", self.host, phase)
        self._publish()

    def _publish(self) -> None:
        self._publisher.publish(String(data=self._machine.state.to_json()))

    def _endpoints(self) -> Iterator[Endpoint]:
        for node in self._nodes:
            name = self._relative(node)
            for end in node.publishers:
                yield Endpoint(name, end.topic_name, True, end.get_subscription_count())
            for end in node.subscriptions:
                yield Endpoint(name, end.topic_name, False, end.get_publisher_count())

    def _own_topics(self, kind: str) -> tuple[str, ...]:
        return tuple(
            endpoint.topic_name
            for node in self._nodes
            for endpoint in getattr(node, kind)
            if endpoint.topic_name.startswith(self._prefix)
        )

    def _parameters(self) -> dict[str, dict[str, Any]]:
        """Return the parameters of manually started nodes, which must be those of the run."""
        return {
            self._relative(node): shared_parameters(node.scenario, node.index, node.groups)
            for node in self._nodes
            if isinstance(node, PlatoonNode)
        }

    def _relative(self, node: Node) -> str:
        name: str = node.get_fully_qualified_name()
        return name.removeprefix(self._prefix)
