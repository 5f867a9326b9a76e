"""What happens in a replay: a run of two hosts, with other words for what goes wrong."""

from __future__ import annotations

import os
from collections.abc import Sequence

from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import NodeName, host_name
from cacc_platoon.supervision.belief import Belief, OwnHost
from cacc_platoon.supervision.pausing import Asked
from cacc_platoon.supervision.run_events import ProcessEnded
from cacc_platoon.supervision.run_machine import RunMachine
from cacc_platoon.supervision.run_state import Run, Stage
from msg_adapters.topics import Graph

REPLAYED, REPLAYER = "replayed", "replayer"
"""The hosts: the process of the node, and the one that gives it what it gets."""
SPOKESMAN = f"{host_name(REPLAYED)}/spokesman"
"""The node of a host whose own node cannot be made."""


class ReplayMachine(RunMachine):
    """The rules of a replay; the answers of the node are the progress of the run.

    Parameters
    ----------
    scenario : Scenario
        What was run.
    node : NodeName
        The node that is replayed.
    topics : sequence of str
        What it answers on.
    samples : int
        How many answers there will be.
    """

    def __init__(
        self, scenario: Scenario, node: NodeName, topics: Sequence[str], samples: int
    ) -> None:
        super().__init__(
            scenario,
            topics,
            _belief(scenario, node, topics),
            nodes=[str(node), REPLAYER],
            samples=samples,
            newcomer_wait=0.0,
        )
        self._node = node

    def begin(self, run_id: str, now: float) -> Run:
        """Return the state of a replay that begins; it pauses nowhere."""
        return super().begin(run_id, now)._replace(held=None)

    def refuses(self, _run: Run, _asked: Asked) -> str:
        """Say that there is no pause."""
        return "a replay cannot be paused"

    def late(self, run: Run, missing: Sequence[str], limit: float) -> str:
        """Say what has not come in time."""
        if run.stage is Stage.STARTING:
            return f"{self._node} has not appeared for {limit:g} s"
        return f"{self._node} is not connected for {limit:g} s: {'; '.join(missing)}"

    def stalled(self, run: Run, limit: float) -> str:
        """Say that the node gives no more answers."""
        return (
            f"{self._node} gave no answer to sample {run.progress + 1} and has stopped, or what "
            f"it was given has for {limit:g} s"
        )

    def process_ended(self, run: Run, ended: ProcessEnded) -> str:
        """Say that the node's process is gone."""
        return f"{self._node} (process {ended.pid}) {ended.how}"


def _belief(scenario: Scenario, node: NodeName, answers: Sequence[str]) -> Belief:
    """Return whose word counts: the node answers, and the replayer is everybody else."""
    graph = Graph.of(scenario)
    publishers = {topic.name: REPLAYER for topic in graph.recorded}
    publishers |= {topic.name: str(node) for topic in graph.replayed(node).publishes}
    hosts = [
        OwnHost(REPLAYED, frozenset({str(node), SPOKESMAN}), frozenset()),
        OwnHost(REPLAYER, frozenset({REPLAYER}), frozenset(answers), "", os.getpid(), early=True),
    ]
    return Belief(graph, hosts, publishers=publishers)
