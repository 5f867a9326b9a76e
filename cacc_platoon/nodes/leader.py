"""Vehicle 0: publishes its profile as far as the supervisor's horizon lets it."""

from __future__ import annotations

import dataclasses

from std_msgs.msg import Int64

from cacc_platoon.nodes import qos
from cacc_platoon.nodes.node import PlatoonNode
from cacc_platoon.runs.journal import Journal
from cacc_platoon.scenario import Scenario
from cacc_platoon.stepping.wall import WallLeader
from msg_adapters.topics import PlatoonTopics


class LeaderNode(PlatoonNode):
    """The leader; see `PlatoonNode` for its arguments."""

    def __init__(
        self,
        scenario: Scenario | None = None,
        index: int | None = None,
        *,
        journal: Journal | None = None,
    ) -> None:
        super().__init__("leader", ("platoon", "leader", "run"), scenario, index, journal)
        steppers = dataclasses.replace(self.steppers, scenario=_with_motion(self.scenario))
        stepper = steppers.leader(self.create_motion_stream())
        self.keep_time(stepper)
        if isinstance(stepper, WallLeader):
            return
        self.create_subscription(
            Int64,
            PlatoonTopics(self.scenario.platoon.namespace).horizon,
            lambda message: stepper.take_horizon(message.data),
            qos.latched(),
        )


def _with_motion(scenario: Scenario) -> Scenario:
    """Return the scenario with the motion of a recorded leader, if it has one."""
    if scenario.leader.profile != "bag":
        return scenario
    from cacc_platoon.runs.recorded_leader import with_recorded_leader  # noqa: PLC0415  (heavy)

    return with_recorded_leader(scenario)
