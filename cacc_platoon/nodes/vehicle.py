"""A follower: follows its predecessor's pose and twist and its own relay's acceleration."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock, ClockType

from cacc_platoon.model import ControlLaw, Reception, State
from cacc_platoon.nodes.node import PlatoonNode
from cacc_platoon.runs.journal import Journal
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.stepping.recorded import ResumedFollower
from cacc_platoon.stepping.stepper import FollowerStepper

if TYPE_CHECKING:
    from cacc_platoon.nodes.diagnostics import ClockDiagnostics


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
    replayed : bool, optional
        Whether it is told when to take its samples, where others have clocks.
    journal : Journal, optional
        Records what it sends and receives, where it may be started again.
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
        replayed: bool = False,
        journal: Journal | None = None,
    ) -> None:
        groups = ("platoon", "vehicle", "sensing", "controller", "v2v", "run", "record")
        super().__init__("vehicle", groups, scenario, index, journal)
        record = self.scenario.record
        command = self.create_stream(self.topics.command) if record.command else None
        error = self.create_stream(self.topics.spacing_error) if record.spacing_error else None

        def publish_command(stamp: int, u: float, delta: float, gap_error: float) -> None:
            if command:
                command(stamp, u)
            if error:
                error(stamp, delta, gap_error)

        follower = self.scenario.follower(self.index).receiving(reception)
        links = self.scenario.topology.links_to(self.index)
        options: dict[str, Any] = {
            "publish_command": publish_command if command or error else None,
            "publish_reception": self.create_stream(self.topics.reception)
            if follower.fallback_law()
            else None,
            "publish_monitor": self.create_stream(self.topics.monitor)
            if follower.monitored
            else None,
            "tell": self.events.append,
            "law": law(follower) if law else None,
            "initial": initial,
        }
        stepper = self._stepper(follower, options, replayed=replayed)
        self.follow_stream(self.predecessor.pose, stepper.take_position)
        self.follow_stream(self.predecessor.twist, stepper.take_velocity)
        told = follower.counted and (replayed or not self.scenario.clocked)
        for number, link in enumerate(links):
            topics = self.topics.link(link.sender)
            take, count = stepper.take_acceleration, stepper.take_count
            if number:
                take, count = partial(take, link=number), partial(count, link=number)
            self.follow_stream(topics.accel, take)
            if told:
                self.follow_stream(topics.complete, count, both=True)
            else:
                self.recall_stream(topics.complete, count)
        own = follower.law_name or (law and law.__qualname__)
        self.let_change([stepper], f"is ignored by the control law {own}" if own else "")

    def _stepper(
        self, follower: Follower, options: dict[str, Any], *, replayed: bool
    ) -> FollowerStepper:
        """Return what decides the samples; by clocks, with a clock or with what is recorded."""
        motion = self.create_motion_stream()
        if not self.scenario.clocked:
            return self.steppers.follower(follower, motion, **options)
        if replayed:
            recorded = self.steppers.recorded_follower(follower, motion, **options)
            self.follow_stream(self.topics.timing, recorded.take_timing, both=True)
            return recorded
        links = self.scenario.topology.links_to(self.index)
        counts = [self.create_stream(self.topics.link(link.sender).complete) for link in links]
        timing = self.create_stream(self.topics.timing)
        if said := self._diagnostics():
            counts = [_both(one, partial(_noted, said, n)) for n, one in enumerate(counts)]
            timing = _both(timing, said.take_timing)
        stepper = self.steppers.clocked_follower(
            follower,
            motion,
            counts,
            timing,
            resumed=self.journal is not None and self.journal.resumed,
            **options,
        )
        self.keep_time(stepper)
        if isinstance(stepper, ResumedFollower):
            self.recall_stream(self.topics.timing, stepper.take_timing)
        return stepper

    def _diagnostics(self) -> ClockDiagnostics | None:
        """Return what is told of the samples on /diagnostics from now on, once a second.

        Without the package of its messages nothing is: what samples were like is recorded anyway.
        """
        try:
            from diagnostic_msgs.msg import DiagnosticArray  # noqa: PLC0415  (by clocks alone)

            from cacc_platoon.nodes.diagnostics import (  # noqa: PLC0415
                PERIOD,
                TOPIC,
                ClockDiagnostics,
            )
        except ModuleNotFoundError as error:
            self.get_logger().warning(f"nothing is said on /diagnostics: {error}")
            return None
        run = self.scenario.run
        said = ClockDiagnostics(self.get_namespace(), run.step, run.clock_period)
        publisher = self.create_publisher(DiagnosticArray, TOPIC, 10)

        def tell() -> None:
            stamp = self.get_clock().now().to_msg()
            publisher.publish(said.message(stamp.sec, stamp.nanosec))

        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(max(PERIOD, 2.0 * run.clock_period), tell, clock=steady)
        return said


def _noted(said: ClockDiagnostics, link: int, stamp: int, count: int, more: int) -> None:
    said.take_count(link, count)


def _both(*functions: Callable[..., None]) -> Callable[..., None]:
    """Return a function that calls all of these."""

    def call(*arguments: float) -> None:
        for function in functions:
            function(*arguments)

    return call
