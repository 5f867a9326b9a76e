"""A follower: follows its predecessor's pose and twist and its own relay's acceleration."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from cacc_platoon.model import ControlLaw, Reception, State
from cacc_platoon.nodes.node import PlatoonNode
from cacc_platoon.scenario import Follower, Scenario


class VehicleNode(PlatoonNode):
    """A follower; see `PlatoonNode` for `scenario` and `index`.

    Parameters
    ----------
    law : callable, optional
        Makes another control law from the follower's parameters.
    reception : callable, optional
        Makes another reception from them, one for each of its links.
    initial : State, optional
        Where it begins; by default in equilibrium behind its predecessor.
    """

    changeable = "controller.time_headway"

    def __init__(
        self,
        scenario: Scenario | None = None,
        index: int | None = None,
        law: Callable[[Follower], ControlLaw] | None = None,
        initial: State[float] | None = None,
        *,
        reception: Callable[[Follower], Reception] | None = None,
    ) -> None:
        groups = ("platoon", "vehicle", "sensing", "controller", "v2v", "run", "record")
        super().__init__("vehicle", groups, scenario, index)
        record = self.scenario.record
        command = self.create_stream(self.topics.command) if record.command else None
        error = self.create_stream(self.topics.spacing_error) if record.spacing_error else None

        def publish_command(stamp: int, u: float, delta: float, gap_error: float) -> None:
            if command:
                command(stamp, u)
            if error:
                error(stamp, delta, gap_error)

        follower = self.scenario.follower(self.index).receiving(reception)
        stepper = self.steppers.follower(
            follower,
            self.create_motion_stream(),
            publish_command if command or error else None,
            publish_reception=self.create_stream(self.topics.reception)
            if follower.fallback_law()
            else None,
            publish_monitor=self.create_stream(self.topics.monitor) if follower.monitored else None,
            tell=self.events.append,
            law=law(follower) if law else None,
            initial=initial,
        )
        self.follow_stream(self.predecessor.pose, stepper.take_position)
        self.follow_stream(self.predecessor.twist, stepper.take_velocity)
        for number, link in enumerate(self.scenario.topology.links_to(self.index)):
            topics = self.topics.link(link.sender)
            take, count = stepper.take_acceleration, stepper.take_count
            if number:
                take, count = partial(take, link=number), partial(count, link=number)
            self.follow_stream(topics.accel, take)
            if follower.counted:
                self.follow_stream(topics.complete, count)
        own = follower.law_name or (law and law.__qualname__)
        self.let_change([stepper], f"is ignored by the control law {own}" if own else "")
