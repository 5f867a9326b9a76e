"""The V2V links to one follower: deliver its predecessors' accelerations as channels say."""

from __future__ import annotations

from collections.abc import Callable

from cacc_platoon.model import Channel
from cacc_platoon.nodes.node import PlatoonNode
from cacc_platoon.runs.journal import Journal
from cacc_platoon.scenario import Follower, Scenario
from msg_adapters.topics import VehicleTopics


class NoiseRelayNode(PlatoonNode):
    """The noise relay of one follower, in its namespace; see `PlatoonNode`.

    Parameters
    ----------
    channel : callable, optional
        Makes another channel from the follower's parameters, one for each of its links.
    """

    changeable = "v2v.loss"

    def __init__(
        self,
        scenario: Scenario | None = None,
        index: int | None = None,
        channel: Callable[[Follower], Channel] | None = None,
        *,
        journal: Journal | None = None,
    ) -> None:
        super().__init__("noise_relay", ("platoon", "v2v", "run"), scenario, index, journal)
        follower = self.scenario.follower(self.index)
        counts = follower.counted and not self.scenario.clocked
        steppers = []
        for link in self.scenario.topology.links_to(self.index):
            topics, receiver = self.topics.link(link.sender), follower.on(link)
            stepper = self.steppers.relay(
                receiver,
                self.create_stream(topics.accel),
                self.create_stream(topics.complete) if counts else None,
                channel=channel(receiver) if channel else None,
            )
            steppers.append(stepper)
            sender = VehicleTopics(self.scenario.platoon.namespace, link.sender)
            lossy = follower.v2v.best_effort
            self.follow_stream(sender.accel, stepper.take, best_effort=lossy)
            if follower.triggered:
                self.follow_stream(sender.pose, stepper.take_position)
                self.follow_stream(sender.twist, stepper.take_velocity)
        own = follower.v2v.channel or (channel and channel.__qualname__)
        self.let_change(steppers, f"is ignored by the channel {own}" if own else "")
