"""Why a run stands still: from the last sample of every topic to the node that did not answer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cacc_platoon.scenario import Scenario
from msg_adapters.topics import VehicleTopics


def diagnose(scenario: Scenario, hosts: Mapping[str, Mapping[str, Any]], progress: int) -> str:
    """Name the nodes that stopped, their last sample and what was missing.

    Parameters
    ----------
    scenario : Scenario
        The run.
    hosts : mapping of str to mapping
        The last word of each host; one that closed says how many samples each topic has.
    progress : int
        Last sample that was recorded everywhere.
    """
    at = f"the last complete sample was {progress} ({max(progress, 0) * scenario.run.step:g} s)"
    silent = [
        f"host {name} (process {host['pid']}: {', '.join(host['nodes'][:6])}) does not answer"
        for name, host in hosts.items()
        if host["state"] != "closed"
    ]
    samples: dict[str, int] = {}
    for host in hosts.values():
        samples.update(host.get("samples", {}))
    stopped = _first_stopped(scenario, samples)
    return "; ".join([*silent, *([stopped] if stopped else []), at])


def _first_stopped(scenario: Scenario, samples: Mapping[str, int]) -> str:
    """Return the first node that had all its inputs for a sample and did not publish the next."""
    prefix = scenario.platoon.namespace
    for index in range(1, scenario.platoon.followers + 1):
        own, ahead = VehicleTopics(prefix, index), VehicleTopics(prefix, index - 1)
        names = (own.pose.name, own.received.name, ahead.pose.name, ahead.accel.name)
        if not all(name in samples for name in names):
            continue
        done, received, pose, accel = (samples[name] for name in names)
        if received < accel and received <= done:
            return (
                f"vehicle_{index}/noise_relay stopped: {own.received.name} ends at sample "
                f"{received - 1} while {ahead.accel.name} has {accel - 1}"
            )
        inputs = min(received, pose)
        if 0 < done <= inputs and done < scenario.samples:
            return (
                f"vehicle_{index}/vehicle stopped: its topics end at sample {done - 1} while "
                f"its inputs have sample {inputs - 1}"
            )
    return ""
