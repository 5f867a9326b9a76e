"""Why a run stands still: from the last sample of every topic to the node that did not answer."""

from __future__ import annotations

from collections.abc import Mapping
from operator import itemgetter

from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import NodeKind, NodeName
from msg_adapters.topics import Graph

IN_TRANSIT = 2
"""Samples that a node may be behind its inputs while everything runs."""


def last_sample(scenario: Scenario, samples: Mapping[str, int]) -> str:
    """Say up to which sample everything was recorded.

    Parameters
    ----------
    scenario : Scenario
        The run.
    samples : mapping of str to int
        How many samples of each topic were recorded.
    """
    complete = min(samples.values(), default=0) - 1
    time = max(complete, 0) * scenario.run.step
    return f"the last complete sample is {complete} ({time:g} s)"


def stopped_first(scenario: Scenario, samples: Mapping[str, int]) -> list[str]:
    """Name the node that is furthest behind what it has received, with its last sample.

    Parameters
    ----------
    scenario : Scenario
        The run.
    samples : mapping of str to int
        How many samples of each topic were recorded.

    Returns
    -------
    list of str
        One line, or none where everybody is as far as messages in transit allow.
    """
    found: list[tuple[int, str]] = []
    graph = Graph.of(scenario)
    for index in graph.topology.followers:
        done = samples.get(graph.vehicles[index].pose.name, 0)
        inputs = samples.get(graph.vehicles[index - 1].pose.name, 0)
        for link in graph.topology.links_to(index):
            sent = samples.get(graph.vehicles[link.sender].accel.name, 0)
            received = samples.get(graph.links[link].accel.name, 0)
            inputs = min(inputs, received)
            relay = NodeName(NodeKind.NOISE_RELAY, index)
            found.append((sent - received, _stopped(relay, received, sent)))
        vehicle = NodeName(NodeKind.VEHICLE, index)
        found.append((inputs + 1 - done, _stopped(vehicle, done, inputs)))
    behind, text = max(found, key=itemgetter(0))
    return [text] if behind > IN_TRANSIT else []


def stopped_together(scenario: Scenario, samples: Mapping[str, int]) -> list[str]:
    """Say what a run stood still for in which no node is behind what it has received.

    Then the leader stopped, or whoever records, by which the horizon goes, or the supervisor, who
    tells it; and with them all nodes of their process.

    Parameters
    ----------
    scenario : Scenario
        The run.
    samples : mapping of str to int
        How many samples of each topic were recorded.

    Returns
    -------
    list of str
        One line, or none where the leader was through.
    """
    index = scenario.leader_index
    done = samples.get(Graph.of(scenario).vehicles[index].pose.name, 0)
    if done >= scenario.samples:
        return []
    leader = NodeName(NodeKind.LEADER, index)
    return [
        f"no node is behind what it has received: {leader}, the recorder of a host or the "
        f"supervisor stopped, at sample {done - 1}"
    ]


def _stopped(node: NodeName, samples: int, inputs: int) -> str:
    return f"{node} stopped at sample {samples - 1} while its inputs have sample {inputs - 1}"
