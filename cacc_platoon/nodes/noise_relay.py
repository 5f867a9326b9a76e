"""The V2V link to one follower: passes its predecessor's acceleration on, times the noise."""

from __future__ import annotations

from cacc_platoon.nodes.node import PlatoonNode
from cacc_platoon.scenario import Scenario
from cacc_platoon.stepping.lockstep import LockstepRelay


class NoiseRelayNode(PlatoonNode):
    """The noise relay of one link, in the receiver's namespace; see `PlatoonNode`."""

    def __init__(self, scenario: Scenario | None = None, index: int | None = None) -> None:
        super().__init__("noise_relay", ("platoon", "v2v", "run"), scenario, index)
        follower = self.scenario.follower(self.index)
        relay = LockstepRelay(follower, self.scenario, self.create_stream(self.topics.received))
        self.follow_stream(self.predecessor.accel, relay.take)
