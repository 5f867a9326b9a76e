"""What a recorded vehicle would have done with other parameters, beside what it did."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from cacc_platoon.bags.decode import Floats
from cacc_platoon.errors import UserError
from cacc_platoon.figures.motion import plot_compared_errors
from cacc_platoon.figures.style import draw_svg, standalone
from cacc_platoon.replay.node_record import NodeRecord
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario, parse_scenario
from cacc_platoon.scenario.names import vehicle_name

CHANGEABLE = ("vehicle.", "controller.", "platoon.standstill_distance")
"""Parameters, or beginnings of their names, that a vehicle node reads and a replay may change."""


class Motion(NamedTuple):
    """What a vehicle did in a few numbers.

    Attributes
    ----------
    max_abs_spacing_error : float
        max |delta| [m], by the parameters it drove with.
    min_gap : float
        Smallest distance to its predecessor, bumper to bumper alike [m].
    max_abs_acceleration : float
        Peak acceleration [m/s^2].
    """

    max_abs_spacing_error: float
    min_gap: float
    max_abs_acceleration: float


class WhatIf(NamedTuple):
    """A recorded vehicle and the same one with other parameters, given the same inputs.

    Attributes
    ----------
    recorded, replayed : Motion
        In numbers.
    time, recorded_error, replayed_error : ndarray, shape (samples,)
        Spacing errors [m] over time [s].
    """

    recorded: Motion
    replayed: Motion
    time: Floats
    recorded_error: Floats
    replayed_error: Floats


def changed_scenario(record: NodeRecord, settings: Iterable[str]) -> Scenario:
    """Return the scenario in which the replayed node has other parameters.

    Parameters
    ----------
    record : NodeRecord
        The node.
    settings : iterable of str
        `key=value` texts, such as "controller.time_headway=0.8".

    Raises
    ------
    UserError
        For a parameter that the node does not read, or a bad value.
    """
    own = f"{vehicle_name(record.index)}."
    changes = []
    if record.node != "vehicle":
        raise UserError(
            f"--set: asks what a follower would have done, and "
            f"{vehicle_name(record.index)}/{record.node} is none. Give a follower with --vehicle."
        )
    for setting in settings:
        name = setting.partition("=")[0].removeprefix(own)
        if not name.startswith(CHANGEABLE):
            readable = ", ".join(f"{key}*" if key.endswith(".") else key for key in CHANGEABLE)
            raise UserError(
                f"--set {setting}: is nothing that {vehicle_name(record.index)}/vehicle reads, the "
                f"replay would not change. Set one of {readable}."
            )
        changes.append(setting if name.startswith("platoon.") else own + setting.removeprefix(own))
    return parse_scenario(format_scenario(record.scenario), str(record.run.bag), settings=changes)


def what_if(
    record: NodeRecord, scenario: Scenario, replayed: Mapping[str, Sequence[bytes]]
) -> WhatIf:
    """Compare a vehicle's recorded motion with that under another scenario.

    Parameters
    ----------
    record : NodeRecord
        What was recorded.
    scenario : Scenario
        With the parameters of the replay.
    replayed : mapping of str to sequence of bytes
        By topic the CDR bytes of `record.samples` messages.
    """
    samples = record.samples
    again = {
        stream.topic.name: np.frombuffer(b"".join(replayed[stream.topic.name]), np.uint8)
        for stream in record.outputs
    }
    before = [stream.values(samples) for stream in record.outputs]
    after = [
        stream.topic.codec.values(again[stream.topic.name].reshape(samples, -1))
        for stream in record.outputs
    ]
    ahead = record.inputs[0].values(samples)  # a vehicle moves to k + 1 on its inputs of k
    seen = len(ahead)

    def judge(parameters: Scenario, motion: Sequence[Floats]) -> tuple[Motion, Floats]:
        position, velocity, acceleration = motion[:3]
        follower = parameters.follower(record.index)
        law, headway = follower.spacing_policy(), follower.headways(seen)
        if headway is not None:
            law = law.with_headway(headway)
        error = law.spacing_error(position[:seen], velocity[:seen], ahead)
        gap = ahead - position[:seen] - parameters.length_ahead(record.index)
        return Motion(
            *map(float, (np.max(np.abs(error)), np.min(gap), np.max(np.abs(acceleration))))
        ), error

    recorded, recorded_error = judge(record.scenario, before)
    other, replayed_error = judge(scenario, after)
    time = np.asarray(np.arange(seen) * scenario.run.step, np.float64)
    return WhatIf(recorded, other, time, recorded_error, replayed_error)


def what_if_figure(answer: WhatIf, vehicle: int, settings: Sequence[str]) -> str:
    """Return the spacing errors over time, recorded and replayed, as an SVG file's text."""
    label = f"with {', '.join(settings)}"
    errors = {"recorded": answer.recorded_error, label: answer.replayed_error}
    title = f"Spacing error of vehicle {vehicle}, recorded and replayed"
    return standalone(
        draw_svg(title, lambda axes: plot_compared_errors(axes, answer.time, errors, vehicle))
    )
