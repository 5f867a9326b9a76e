"""A follower: follows its predecessor's pose and twist and its own relay's acceleration."""

from __future__ import annotations

from collections.abc import Callable

from cacc_platoon.model import ControlLaw, State
from cacc_platoon.nodes.node import PlatoonNode
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.stepping.lockstep import LockstepFollower


class VehicleNode(PlatoonNode):
    """A follower; see `PlatoonNode` for `scenario` and `index`.

    Parameters
    ----------
    law : callable, optional
        Makes another control law from the follower's parameters.
    initial : State, optional
        Where it begins; by default in equilibrium behind its predecessor.
    """

    def __init__(
        self,
        scenario: Scenario | None = None,
        index: int | None = None,
        law: Callable[[Follower], ControlLaw] | None = None,
        initial: State[float] | None = None,
    ) -> None:
        groups = ("platoon", "vehicle", "controller", "v2v", "run", "record")
        super().__init__("vehicle", groups, scenario, index)
        pose = self.create_stream(self.topics.pose)
        twist = self.create_stream(self.topics.twist)
        accel = self.create_stream(self.topics.accel)

        def publish_state(stamp: int, state: State[float]) -> None:
            pose(stamp, state.position)
            twist(stamp, state.velocity)
            accel(stamp, state.acceleration)

        record = self.scenario.record
        command = self.create_stream(self.topics.command) if record.command else None
        error = self.create_stream(self.topics.spacing_error) if record.spacing_error else None

        def publish_command(stamp: int, u: float, delta: float, gap_error: float) -> None:
            if command:
                command(stamp, u)
            if error:
                error(stamp, delta, gap_error)

        follower = self.scenario.follower(self.index)
        core = LockstepFollower(
            follower,
            self.scenario,
            publish_state,
            publish_command if command or error else None,
            law(follower) if law else None,
            initial=initial,
        )
        self.follow_stream(self.predecessor.pose, core.take_position)
        self.follow_stream(self.predecessor.twist, core.take_velocity)
        self.follow_stream(self.topics.received, core.take_acceleration)
        if follower.counted:
            self.follow_stream(self.topics.complete, core.take_count)
