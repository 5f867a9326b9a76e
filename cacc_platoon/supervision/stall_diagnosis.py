"""Why a run stands still: from the last sample of every topic to the node that did not answer."""

from __future__ import annotations

from collections.abc import Mapping
from operator import itemgetter

from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import NodeKind, NodeName
from msg_adapters.topics import Graph

IN_TRANSIT = 2
"""Samples that a node may be behind its inputs while everything runs."""


def diagnose(scenario: Scenario, samples: Mapping[str, int]) -> str:
    """Name the node that stopped first, its last sample and what it had.

    Parameters
    ----------
    scenario : Scenario
        The run.
    samples : mapping of str to int
        How many samples of each topic were recorded.
    """
    complete = min(samples.values(), default=0) - 1
    time = max(complete, 0) * scenario.run.step
    last = f"the last complete sample is {complete} ({time:g} s)"
    return "; ".join([*_furthest_behind(scenario, samples), last])


def _furthest_behind(scenario: Scenario, samples: Mapping[str, int]) -> list[str]:
    """Say which node is furthest behind what it has received, when it is more than in transit."""
    found: list[tuple[int, str]] = []
    vehicles = Graph.of(scenario).vehicles
    for follower in scenario.followers:
        index = follower.index
        own, ahead = vehicles[index], vehicles[index - 1]
        done, received, pose, accel = (
            samples.get(topic.name, 0)
            for topic in (own.pose, own.received, ahead.pose, ahead.accel)
        )
        inputs = min(received, pose)
        found += [
            (accel - received, _stopped(NodeName(NodeKind.NOISE_RELAY, index), received, accel)),
            (inputs + 1 - done, _stopped(NodeName(NodeKind.VEHICLE, index), done, inputs)),
        ]
    behind, text = max(found, key=itemgetter(0))
    return [text] if behind > IN_TRANSIT else []


def _stopped(node: NodeName, samples: int, inputs: int) -> str:
    return f"{node} stopped at sample {samples - 1} while its inputs have sample {inputs - 1}"
