"""What becomes of the parts that hosts on other machines have recorded, when a run is over."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

from rclpy.executors import Executor
from rclpy.node import Node

from cacc_platoon.runs.part_stream import PartSink
from cacc_platoon.runs.parts import run_of_part
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import host_name
from cacc_platoon.supervision.belief import inside
from cacc_platoon.supervision.log import LOG
from cacc_platoon.supervision.part_transfer import PartRequest, fetch
from cacc_platoon.supervision.protocol import HostPhase, HostState
from cacc_platoon.supervision.run_state import Run
from msg_adapters.topics import Graph, PlatoonTopics


def is_here(scenario: Scenario, run: Run, state: HostState) -> bool:
    """Return whether what a host recorded can be read where it is.

    What a host of another machine says of its folder counts only below record.parts, and where the
    part there says that it is of this run: a path of the same name may be another one here.
    """
    if state.host not in {host.name for host in scenario.remote_hosts}:
        return True
    parts = scenario.record.parts
    return bool(parts) and inside(state.part, parts) and run_of_part(Path(state.part)) == run.id


def fetch_parts(
    scenario: Scenario,
    run: Run,
    folder: Path,
    node: Node,
    executor: Executor,
    *,
    observe: Callable[[int, int], None],
    given_up: Callable[[], bool],
) -> Mapping[str, str]:
    """Fetch the parts that are elsewhere, and return those that stay there, by host.

    Parameters
    ----------
    scenario : Scenario
        What was run.
    run : Run
        As it has ended.
    folder : Path
        Where the parts go.
    node : Node
        Carries the messages.
    executor : Executor
        Spins it.
    observe : callable
        Called with how far that is, in samples of the run.
    given_up : callable
        Returns whether to wait no longer.
    """
    topics = {topic.name: topic for topic in Graph.of(scenario).recorded}
    platoon = PlatoonTopics(scenario.platoon.namespace)
    names = {host.name for host in scenario.remote_hosts}
    states = [state for name, state in run.hosts.items() if name in names and state.part]
    there = [state for state in states if not is_here(scenario, run, state)]
    requests = {}
    for state in states:
        if state.phase is not HostPhase.CLOSED:
            continue
        sink, trouble = None, ""
        if state in there:
            records = [topics[name] for name in state.records]
            try:
                sink = PartSink(folder / host_name(state.host), records, scenario.samples)
            except OSError as error:
                trouble = f"it cannot be written: {error.strerror}"
        requests[state.host] = PartRequest(node, platoon, state.host, sink)
        requests[state.host].trouble = trouble
    size = sum(topics[name].codec.size for state in there for name in state.records) or 1
    fetch(
        executor, requests, lambda received: observe(received // size, scenario.samples), given_up
    )
    left = {}
    for state in there:
        request = requests.get(state.host)
        if request is None or request.trouble:
            left[state.host] = state.part
            shutil.rmtree(folder / host_name(state.host), ignore_errors=True)
            why = request.trouble if request else "the host did not take leave"
            LOG.info("the part of host %s stays where it is: %s", state.host, why)
    return left
