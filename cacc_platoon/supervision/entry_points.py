"""What `ros2 run` starts: single nodes, each a host of its own.

They listen to Ctrl-C before anything else is loaded, so that none is lost or ends in a traceback.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from cacc_platoon.stop_signal import STOP_SIGNALS, StopSignal

if TYPE_CHECKING:
    from cacc_platoon.model import Channel, ControlLaw
    from cacc_platoon.scenario import Follower


def leader() -> int:
    """Run the leader."""
    stop = StopSignal(*STOP_SIGNALS)
    from cacc_platoon.supervision import single_nodes  # noqa: PLC0415  (heavy)

    return single_nodes.leader(stop)


def vehicle(law: Callable[[Follower], ControlLaw] | None = None) -> int:
    """Run a follower; `law` may make another control law from its parameters."""
    stop = StopSignal(*STOP_SIGNALS)
    from cacc_platoon.supervision import single_nodes  # noqa: PLC0415  (heavy)

    return single_nodes.vehicle(stop, law)


def noise_relay(channel: Callable[[Follower], Channel] | None = None) -> int:
    """Run a noise relay; `channel` may make another channel from the follower's parameters."""
    stop = StopSignal(*STOP_SIGNALS)
    from cacc_platoon.supervision import single_nodes  # noqa: PLC0415  (heavy)

    return single_nodes.noise_relay(stop, channel)


def recorder() -> int:
    """Record a whole platoon for hosts that do not record themselves."""
    stop = StopSignal(*STOP_SIGNALS)
    from cacc_platoon.supervision import single_nodes  # noqa: PLC0415  (heavy)

    return single_nodes.recorder(stop)


def markers() -> int:
    """Draw a platoon for RViz until a signal ends it."""
    stop = StopSignal(*STOP_SIGNALS)
    from cacc_platoon.supervision import single_nodes  # noqa: PLC0415  (heavy)

    return single_nodes.markers(stop)
