"""What leader, vehicle and relay nodes share: a scenario, an index, and streams of samples."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from geometry_msgs.msg import AccelStamped, PoseStamped, TwistStamped, Vector3Stamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter

from cacc_platoon.model import State
from cacc_platoon.nodes import qos, ros_parameters
from cacc_platoon.runs.journal import Journal, Receive
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import NodeKind, NodeName
from cacc_platoon.scenario.parameter import ScenarioError
from cacc_platoon.scenario.run_event import RunEvent
from cacc_platoon.scenario.table import TABLE
from cacc_platoon.scenario.timeline import Change
from cacc_platoon.stepping.deliveries import LockstepError
from cacc_platoon.stepping.lockstep import PublishState
from cacc_platoon.stepping.stepper import Changing, Clocked, Steppers
from msg_adapters.stamped import ACCEL, POSE, TWIST, VECTOR, LayoutError
from msg_adapters.topics import Topic, VehicleTopics

MESSAGE_TYPES = {
    POSE.type_name: PoseStamped,
    TWIST.type_name: TwistStamped,
    ACCEL.type_name: AccelStamped,
    VECTOR.type_name: Vector3Stamped,
}

RECORD_PARAMETER = "record"
MOST_CHANGES = 100
"""So often may the parameter of a node be changed in a run."""


class PlatoonNode(Node):  # type: ignore[misc]
    """A node of one vehicle.

    Parameters
    ----------
    name : str
        Node name.
    groups : tuple of str
        Groups of the parameter table that the node declares.
    scenario, index : Scenario and int, optional
        The run and the vehicle; a node started manually takes them from its parameters and its
        namespace.

    Attributes
    ----------
    steppers : Steppers
        What decides its samples.
    failures : list of str
        What went wrong with incoming messages; the first one ends the run.
    events : list of RunEvent
        What happened in this node and was not told yet.
    """

    changeable = ""
    """The parameter that ros2 param set may change, where the run is adjustable."""

    def __init__(
        self,
        name: str,
        groups: tuple[str, ...],
        scenario: Scenario | None = None,
        index: int | None = None,
        journal: Journal | None = None,
    ) -> None:
        if scenario is None or index is None:
            super().__init__(name, automatically_declare_parameters_from_overrides=True)
            index = ros_parameters.vehicle_index(self.get_namespace(), name)
            scenario = ros_parameters.scenario_of(self, RECORD_PARAMETER)
            ros_parameters.refuse_unknown_node(scenario, str(NodeName(NodeKind(name), index)))
        else:
            namespace = VehicleTopics(scenario.platoon.namespace, index).namespace
            super().__init__(name, namespace=namespace, use_global_arguments=False)
        self.scenario, self.index, self.groups = scenario, index, groups
        self.failures: list[str] = []
        self.events: list[RunEvent] = []
        self.changes = 0
        self.steppers = Steppers(scenario, time.monotonic_ns)
        self._clocked: Clocked | None = None
        self.journal = journal
        self.topics = VehicleTopics(scenario.platoon.namespace, index)
        self.predecessor = VehicleTopics(scenario.platoon.namespace, index - 1)
        own = scenario.overrides.get(index, {})
        changeable = self.changeable if scenario.run.adjustable else ""
        ros_parameters.declare(self, scenario, own, groups, changeable)

    def keep_time(self, stepper: object) -> None:
        """Let a stepper that needs a clock have one, once the run begins."""
        if isinstance(stepper, Clocked):
            self._clocked = stepper

    def begin(self, start: int) -> None:
        """Let the clock of the vehicle begin, if it has one.

        Parameters
        ----------
        start : int
            The start that all vehicles have in common, by `time.monotonic_ns` of this machine.
        """
        if self._clocked is None:
            return
        try:
            self._clocked.begin(start)
        except LockstepError as error:
            self.failures.append(str(error))
            return
        wait = (self._clocked.wait or 0) / 1e9
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(wait, self._tick, clock=steady)

    def _tick(self) -> None:
        """Take the samples that are due; the first failure of the node is noted.

        The timer is set anew each time, for one with a period would keep the phase at which it
        happened to be made.
        """
        assert self._clocked is not None
        wait = None
        try:
            self._clocked.tick()
            wait = self._clocked.wait
        except LockstepError as error:
            self.failures.append(str(error))
        if wait is None or self.failures:
            self._timer.cancel()
            return
        self._timer.timer_period_ns = wait
        self._timer.reset()

    def let_change(self, steppers: Sequence[Changing], ignores: str) -> None:
        """Let ros2 param set change `changeable` of steppers, where the run is adjustable.

        Parameters
        ----------
        steppers : sequence of Changing
            Who heeds it.
        ignores : str
            Custom code that would not; empty for none.
        """
        if not self.scenario.run.adjustable:
            return

        def check(parameters: Sequence[Parameter]) -> SetParametersResult:
            try:
                for parameter in parameters:
                    self._check_change(parameter, ignores, _next_sample(steppers))
            except ScenarioError as error:
                return SetParametersResult(successful=False, reason=str(error))
            return SetParametersResult(successful=True)

        def apply(parameters: Sequence[Parameter]) -> None:
            for parameter in parameters:
                change = Change(
                    _next_sample(steppers), self.index, parameter.name, float(parameter.value)
                )
                for stepper in steppers:
                    stepper.change(change)
                self.changes += 1
                self.events.append(change.event)

        self.add_on_set_parameters_callback(check)
        self.add_post_set_parameters_callback(apply)

    def _check_change(self, parameter: Parameter, ignores: str, sample: int) -> None:
        """Refuse a change that cannot be carried out."""
        name, node = parameter.name, self.get_fully_qualified_name()
        if name != self.changeable or ignores:
            raise ScenarioError(f"{node}: {name} {ignores or 'is not to be changed in a run'}")
        TABLE[name].check(parameter.value, node)
        if sample >= self.scenario.samples or self.changes >= MOST_CHANGES:
            raise ScenarioError(
                f"{node}: {name} stays: the run is over, or it was changed {MOST_CHANGES} times"
            )

    def create_motion_stream(self) -> PublishState:
        """Return a function that publishes stamp [ns] and state on pose, twist and accel."""
        pose, twist, accel = (self.create_stream(topic) for topic in self.topics.motion)

        def send(stamp: int, state: State[float]) -> None:
            pose(stamp, state.position)
            twist(stamp, state.velocity)
            accel(stamp, state.acceleration)

        return send

    def create_stream(self, topic: Topic) -> Callable[..., None]:
        """Return a function that publishes (stamp [ns], x[, y]) on a topic."""
        message_type = MESSAGE_TYPES[topic.kind.type_name]
        publisher = self.create_publisher(message_type, topic.name, qos.stream(self.scenario))
        publish: Receive = publisher.publish
        encode = topic.codec.encode
        if self.journal:
            publish = self.journal.sending(topic, publish)

        def send(stamp: int, x: float, y: float = 0.0) -> None:
            publish(encode(stamp, x, y))

        return send

    def follow_stream(
        self,
        topic: Topic,
        take: Callable[..., None],
        *,
        both: bool = False,
        best_effort: bool = False,
    ) -> None:
        """Call `take` with stamp [ns] and x, or x and y, of every message of a topic.

        With `best_effort` DDS may lose some of them. The first failure of the node is noted; from
        then on it is deaf.
        """
        receive: Receive = self._receiver(topic, take, both=both)
        if self.journal:
            receive = self.journal.receiving(topic, receive)
        message_type = MESSAGE_TYPES[topic.kind.type_name]
        profile = qos.stream(self.scenario, best_effort=best_effort)
        self.create_subscription(message_type, topic.name, receive, profile, raw=True)

    def recall_stream(self, topic: Topic, take: Callable[..., None]) -> None:
        """Call `take` with stamp [ns], x and y of what was recorded before a process was killed."""
        if self.journal:
            self.journal.recalling(topic, self._receiver(topic, take, both=True))

    def _receiver(
        self, topic: Topic, take: Callable[..., None], *, both: bool
    ) -> Callable[[bytes], None]:
        """Return what calls `take` with the content of each message, until the first failure."""
        codec, failures = topic.codec, self.failures
        decode = codec.decode_both if both else codec.decode

        def receive(data: bytes) -> None:
            if failures:
                return
            try:
                take(*decode(data))
            except LayoutError as error:
                failures.append(
                    f"{topic.name}: a message {error} (frame_id must be {topic.frame_id}): it "
                    "comes from another publisher"
                )
            except LockstepError as error:
                failures.append(str(error))

        return receive


def _next_sample(steppers: Sequence[Changing]) -> int:
    """Return the first sample that none of them has computed."""
    return max(stepper.next_sample for stepper in steppers)
