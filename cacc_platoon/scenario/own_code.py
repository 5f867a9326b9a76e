"""Custom channels and laws, tried once before anything starts: nodes have nobody to ask."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import chain

from cacc_platoon.errors import UserError
from cacc_platoon.model.channel import ChannelError, checked_delivery, packets_by_sample
from cacc_platoon.scenario.follower import Follower
from cacc_platoon.scenario.names import vehicle_name
from cacc_platoon.scenario.parameter import ScenarioError


def try_channel(receiver: Follower, samples: int) -> None:
    """Make the channel of a link, and ask it for the whole run, at once and block by block."""
    try:
        whole = checked_delivery(receiver.channel(), 0, samples)
        packets = chain.from_iterable(packets_by_sample(receiver.channel(), samples))
        if list(packets) != whole.packets():
            raise ChannelError(
                "what it delivers depends on how many samples it is asked for at a time, so that "
                "no two runs would agree"
            )
    except ChannelError as error:
        raise ChannelError(
            f"v2v.channel = {receiver.v2v.channel}: the channel from "
            f"{vehicle_name(receiver.link.sender)} to {vehicle_name(receiver.index)}: {error}; "
            "the run would end there. Correct it."
        ) from error


def try_reception(receiver: Follower) -> None:
    """Make the reception of a link, and have it use a packet and none."""
    reception = receiver.plain_reception()
    wrong = _wrong(lambda: [reception.use([(0, 1.0)]), reception.use([])])
    if wrong:
        raise ScenarioError(
            f"v2v.receiver = {receiver.v2v.receiver}: the reception of "
            f"{vehicle_name(receiver.index)} {wrong}; the run would end there. Let use return a "
            "finite number [m/s^2] whether a packet is delivered or not."
        )


def try_law(follower: Follower, speed: float, links: int) -> None:
    """Make the law of a follower, and ask it for a command in equilibrium.

    Parameters
    ----------
    follower : Follower
        Its parameters.
    speed : float
        Of the platoon at time 0 [m/s].
    links : int
        From how many vehicles it receives.
    """
    law = follower.law()
    spacing = follower.standstill_distance + follower.gains.time_headway * speed
    wrong = _wrong(lambda: [law.command(-spacing, speed, 0.0, speed, *[0.0] * links)])
    if wrong:
        raise ScenarioError(
            f"controller.law = {follower.law_name}: the law of {vehicle_name(follower.index)} "
            f"{wrong} in equilibrium at {speed:g} m/s with {links} received accelerations; the run "
            "would end there. Let command return a finite number [m/s^2]."
        )


def _wrong(ask: Callable[[], list[float]]) -> str:
    """Say what is wrong with what custom code returns, empty when nothing is."""
    try:
        for value in ask():
            if not math.isfinite(value):
                return f"returned {value}"
    except UserError:
        raise
    except (Exception, SystemExit) as error:  # custom code may fail in any way
        return f"raised {type(error).__name__}: {' '.join(str(error).split())}"
    return ""
