"""What `ros2 run` starts: single nodes, each a host of its own.

They listen to Ctrl-C before anything else is loaded, so that none is lost or ends in a traceback.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

from cacc_platoon.dds.environment import check_loading
from cacc_platoon.errors import UserError
from cacc_platoon.stop_signal import STOP_SIGNALS, StopSignal

if TYPE_CHECKING:
    from cacc_platoon.model import Channel, ControlLaw, Reception
    from cacc_platoon.scenario import Follower

BAD_INPUT = 2


def leader() -> int:
    """Run the leader."""
    return _run("leader")


def vehicle(
    law: Callable[[Follower], ControlLaw] | None = None,
    reception: Callable[[Follower], Reception] | None = None,
) -> int:
    """Run a follower; `law` and `reception` may make others from its parameters."""
    return _run("vehicle", law, reception)


def noise_relay(channel: Callable[[Follower], Channel] | None = None) -> int:
    """Run a noise relay; `channel` may make another channel from the follower's parameters."""
    return _run("noise_relay", channel)


def recorder() -> int:
    """Record a whole platoon for hosts that do not record themselves."""
    return _run("recorder")


def markers() -> int:
    """Draw a platoon for RViz until a signal ends it."""
    return _run("markers")


def _run(name: str, *own_code: object) -> int:
    """Run the function of this name of `single_nodes`, which is loaded only now."""
    stop = StopSignal(*STOP_SIGNALS)
    try:
        check_loading()
    except UserError as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    from cacc_platoon.supervision import single_nodes  # noqa: PLC0415  (heavy)

    return int(getattr(single_nodes, name)(stop, *own_code))
