"""What happens in a replay: a run of two hosts, with other words for what goes wrong."""

from __future__ import annotations

from collections.abc import Sequence

from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import NodeName
from cacc_platoon.supervision.run_events import ProcessEnded
from cacc_platoon.supervision.run_machine import RunMachine
from cacc_platoon.supervision.run_state import Run, Stage

REPLAYED, REPLAYER = "replayed", "replayer"
"""The hosts: the process of the node, and the one that gives it what it gets."""


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
            scenario, topics, nodes=[str(node), REPLAYER], samples=samples, newcomer_wait=0.0
        )
        self._node = node

    def late(self, run: Run, missing: Sequence[str]) -> str:
        """Say what has not come in time."""
        limit = self.scenario.run.start_timeout
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
