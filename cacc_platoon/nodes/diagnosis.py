"""Why a run stands still: from the last sample of every topic to the node that did not answer."""

from __future__ import annotations

from collections.abc import Mapping

from cacc_platoon.scenario import Scenario
from msg_adapters.topics import VehicleTopics


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
    return "; ".join(filter(None, [_first_stopped(scenario, samples), last]))


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
