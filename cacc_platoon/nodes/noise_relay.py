"""The V2V link to one follower: delivers its predecessor's acceleration as the channel says."""

from __future__ import annotations

from collections.abc import Callable

from cacc_platoon.model import Channel
from cacc_platoon.nodes.node import PlatoonNode
from cacc_platoon.scenario import Follower, Scenario


class NoiseRelayNode(PlatoonNode):
    """The noise relay of one link, in the receiver's namespace; see `PlatoonNode`.

    Parameters
    ----------
    channel : callable, optional
        Makes another channel from the follower's parameters.
    """

    def __init__(
        self,
        scenario: Scenario | None = None,
        index: int | None = None,
        channel: Callable[[Follower], Channel] | None = None,
    ) -> None:
        super().__init__("noise_relay", ("platoon", "v2v", "run"), scenario, index)
        follower = self.scenario.follower(self.index)
        stepper = self.steppers.relay(
            follower,
            self.create_stream(self.topics.received),
            self.create_stream(self.topics.complete) if follower.counted else None,
            channel=channel(follower) if channel else None,
        )
        self.follow_stream(self.predecessor.accel, stepper.take)
