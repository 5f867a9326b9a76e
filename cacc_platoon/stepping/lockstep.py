"""Lockstep without ROS: what a follower, a relay and a leader do with each sample, in order.

A follower steps to sample k + 1 as soon as it holds the predecessor's position and velocity of
sample k and knows what its channel has delivered up to k, whatever order they arrive in. All
objects here take and give stamped values [ns]; publishing is a function they are given.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from cacc_platoon.model import (
    Channel,
    ControlLaw,
    LeaderProfile,
    MonitoredReception,
    Sensor,
    State,
    TriggeredChannel,
)
from cacc_platoon.model.channel import ChannelError
from cacc_platoon.scenario import Follower, Scenario, ScenarioError
from cacc_platoon.scenario.names import NodeKind, NodeName, vehicle_name
from cacc_platoon.scenario.receiver import packet_source
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.scenario.timeline import Change
from cacc_platoon.stepping.deliveries import (
    CountedInbox,
    Counts,
    Inbox,
    JointInbox,
    LockstepError,
    PromptInbox,
    Sequence,
    doubtful_from,
    seconds,
)
from cacc_platoon.stepping.turns import (
    PublishMonitor,
    PublishReception,
    Tell,
    reception_turns,
    saying,
    telling_body,
)

PublishState = Callable[[int, State[float]], None]
PublishCommand = Callable[[int, float, float, float], None]
PublishAcceleration = Callable[[int, float], None]
PublishCount = Callable[[int, int, int], None]
_Motion = tuple[float, float, float, float]


class LockstepFollower:
    """One follower: pairs its inputs by sample, applies the law, steps the plant.

    Parameters
    ----------
    follower : Follower
        Its parameters.
    scenario : Scenario
        The run it belongs to.
    publish_state : callable
        Called with stamp [ns] and state for every sample, in order.
    publish_command : callable, optional
        Called with stamp [ns], u [m/s^2], delta [m] and e [m] for every step.
    law : ControlLaw, optional
        Replaces the constant time headway law.
    publish_reception : callable, optional
        Called with stamp [ns], state of the reception and share of the law for every step.
    publish_monitor : callable, optional
        Called with stamp [ns], alarm and excess [m/s] of the monitor, if there is one, likewise.
    tell : callable, optional
        Called with what happens to it.
    initial : State, optional
        State at sample 0; by default in equilibrium behind the predecessor.
    """

    def __init__(
        self,
        follower: Follower,
        scenario: Scenario,
        publish_state: PublishState,
        publish_command: PublishCommand | None = None,
        law: ControlLaw | None = None,
        *,
        publish_reception: PublishReception | None = None,
        publish_monitor: PublishMonitor | None = None,
        tell: Tell | None = None,
        initial: State[float] | None = None,
    ) -> None:
        self._step_ns = scenario.step_ns
        self._end = (scenario.samples - 1) * self._step_ns
        plant = follower.plant(scenario.run.step)
        self._tell = tell = tell or (lambda event: None)
        self._body = telling_body(follower, plant, tell, own_law=law is not None)
        self._advance_plant = self._body.advance if self._body else plant.advance
        self._spacing_policy = follower.spacing_policy()
        self._law: ControlLaw = law or follower.law()
        self._fallback = follower.fallback_law()
        self._follower = follower
        sensing = follower.sensing()
        self._sensor = None if sensing.perfect else Sensor(sensing)
        speed = scenario.platoon.initial_speed
        spacing = follower.standstill_distance + follower.gains.time_headway * speed

        def begin(ahead: float) -> State[float]:
            return initial or State(ahead - spacing, speed, 0.0)

        self._begin = begin
        self._publish_state, self._publish_command = publish_state, publish_command
        ahead = scenario.length_ahead(follower.index)
        self._length_ahead = ahead if scenario.run.stop_on_collision else -math.inf
        self._state: State[float] | None = None
        self._stamp = 0
        predecessor = vehicle_name(follower.index - 1)
        self._name = vehicle_name(follower.index)
        self._position_sequence = Sequence(f"{self._name}: pose of {predecessor}", self._step_ns)
        self._velocity_sequence = Sequence(f"{self._name}: twist of {predecessor}", self._step_ns)
        self._positions: deque[float] = deque()
        self._velocities: deque[float] = deque()
        self._counted = follower.counted
        links = scenario.topology.links_to(follower.index)
        receptions = [follower.on(link).reception() for link in links]
        watching = [one for one in receptions if isinstance(one, MonitoredReception)]
        self._watching = watching[0] if watching else None
        turns = reception_turns(follower, tell) if self._fallback else None
        self._say_reception = saying(
            self._step_ns, publish_reception, publish_monitor, self._watching, turns
        )
        self._move_headway()
        self._inboxes: list[Inbox] = [
            CountedInbox(one, self._step_ns, self._name) if self._counted else PromptInbox()
            for one in receptions
        ]
        self._inbox: Inbox | JointInbox = JointInbox(self._inboxes)
        if len(links) == 1:
            (self._inbox,) = self._inboxes
        self._counts = [
            Counts(f"{self._name}: v2v/complete of {vehicle_name(link.sender)}", scenario)
            for link in links
        ]

    def take_position(self, stamp: int, position: float) -> None:
        """Accept the predecessor's position [m]; the first one places this vehicle behind it."""
        self._position_sequence.take(stamp)
        if self._state is None:
            self._state = self._begin(position)
            self._publish_state(0, self._state)
        self._positions.append(position)
        self._advance()

    def take_velocity(self, stamp: int, velocity: float) -> None:
        """Accept the predecessor's velocity [m/s]."""
        self._velocity_sequence.take(stamp)
        self._velocities.append(velocity)
        self._advance()

    def take_acceleration(self, stamp: int, acceleration: float, link: int = 0) -> None:
        """Accept an acceleration [m/s^2] received over one of its links, w a_{i-1} by default."""
        inbox = self._inboxes[link]
        again = not self._counted and (stamp < self._stamp or stamp in inbox)
        if again or stamp % self._step_ns:
            raise LockstepError(
                f"{self._name}: v2v/accel is stamped {seconds(stamp)}, which it has already or "
                "which is no sample: it comes from another publisher; "
                f"{doubtful_from(max(0, min(stamp, self._stamp)) // self._step_ns)}"
            )
        inbox.take(stamp, acceleration)
        self._advance()

    def take_count(self, stamp: int, count: float, more: float = 0.0, link: int = 0) -> None:
        """Accept that the relay is done with a sample and has published `count` messages in all.

        At the `more` samples that follow it publishes nothing.
        """
        counts = self._counts[link]
        if not counts.fits(stamp, count, more):
            none = f", none at {more:g} samples more" if more else ""
            raise LockstepError(
                f"{self._name}: v2v/complete of {seconds(stamp)} counts {count:g} messages after "
                f"{counts.published}{none}: it comes from another publisher; "
                f"{doubtful_from(stamp // self._step_ns)}"
            )
        counts.take(stamp, int(more))
        counts.published = int(count)
        self._inboxes[link].count(stamp, int(count), counts.due - self._step_ns)
        self._advance()

    @property
    def next_sample(self) -> int:
        """The sample from which on a change can take effect."""
        return self._stamp // self._step_ns

    def change(self, change: Change) -> None:
        """Take a change that is not planned."""
        self._follower = self._follower.changed(change)
        self._move_headway()

    def _move_headway(self) -> None:
        headways = self._follower.headways(self._end // self._step_ns + 1)
        self._headways = None if headways is None else headways.tolist()
        self._prepares = bool(self._headways or self._sensor or self._watching)

    def _advance(self) -> None:
        while self._positions and self._velocities and self._stamp in self._inbox:
            self._step(self._positions.popleft(), self._velocities.popleft())

    def _step(self, position: float, velocity: float) -> None:
        state = self._state
        assert state is not None
        stamp = self._stamp
        self._stamp = stamp + self._step_ns
        motion = state.position, state.velocity, position, velocity
        if self._prepares:
            motion = self._prepare(stamp, motion)
        received, share, reception = self._inbox.pop(stamp)
        if self._say_reception:
            self._say_reception(stamp, reception, share)
        command = self._decide(stamp, motion, received, share)
        if self._body:
            command = self._body.command(command, state)
        if self._publish_command:
            delta = self._spacing_policy.spacing_error(state.position, state.velocity, position)
            gap_error = state.position - position + self._spacing_policy.standstill_distance
            self._publish_command(stamp, command, delta, gap_error)
        if position - state.position <= self._length_ahead:
            node = str(NodeName(NodeKind.VEHICLE, self._follower.index))
            self._tell(RunEvent(EventKind.COLLISION, stamp // self._step_ns, node))
            self._inbox = PromptInbox()  # in which nothing comes
        elif stamp < self._end:
            self._state = self._advance_plant(state, command)
            self._publish_state(self._stamp, self._state)

    def _decide(
        self, stamp: int, motion: _Motion, received: tuple[float, ...], share: float
    ) -> float:
        """Return the command of the law, or of its share with that of the law without V2V."""
        try:
            command = self._law.command(*motion, *received)
            if share < 1.0 and self._fallback:
                alone = self._fallback.command(*motion, 0.0)
                command = share * command + (1.0 - share) * alone
            finite = math.isfinite(command)
        except (Exception, SystemExit) as error:  # a custom law may fail in any way
            raise LockstepError(
                f"{self._name}: its control law raised {type(error).__name__} at "
                f"{seconds(stamp)}: {error}"
            ) from error
        if not finite:
            raise LockstepError(
                f"{self._name}: command at {seconds(stamp)} is {command}: position and velocity "
                f"{motion[0]} m and {motion[1]} m/s, predecessor's {motion[2]} m and {motion[3]} "
                f"m/s, received acceleration {', '.join(map(str, received))} m/s^2"
            )
        return command

    def _prepare(self, stamp: int, motion: _Motion) -> _Motion:
        """Move the time headway, watch the vehicle ahead, and return the motion as measured."""
        if self._headways:
            headway = self._headways[stamp // self._step_ns]
            self._law = self._spacing_policy = self._spacing_policy.with_headway(headway)
        if self._sensor:
            motion = (*motion[:2], *self._sensor.ahead(motion[:2], motion[2:]))
        if self._watching:
            self._watching.measure(motion[1], motion[3])
        return motion


class LockstepRelay:
    """The channel of one link: delivers what the predecessor sends as the channel says.

    Parameters
    ----------
    follower : Follower
        The receiver, on this link.
    scenario : Scenario
        The run it belongs to.
    publish : callable
        Called with source stamp [ns] and received acceleration of every packet delivered.
    publish_count : callable, optional
        Called with stamp [ns] of a sample, the number of packets delivered so far, and the number
        of samples after it at which none is delivered, which it then is not called for.
    channel : Channel, optional
        Replaces the channel of the scenario.

    Raises
    ------
    ScenarioError
        When the channel may lose or delay packets and the scenario does not say so.
    """

    def __init__(
        self,
        follower: Follower,
        scenario: Scenario,
        publish: PublishAcceleration,
        publish_count: PublishCount | None = None,
        channel: Channel | None = None,
    ) -> None:
        name = self._name = str(NodeName(NodeKind.NOISE_RELAY, follower.index))
        try:
            self._packets = packet_source(follower, scenario.samples, channel)
        except ChannelError as error:
            raise ScenarioError(f"{name}: its channel: {error}. Correct it.") from error
        if not (self._packets.prompt or follower.counted):
            raise ScenarioError(
                f"{name}: its channel may lose or delay packets and the scenario does not say so: "
                "receiver and recorder would wait for every packet. Set v2v.loss or v2v.channel."
            )
        self._follower, self._samples = follower, scenario.samples
        self._step_ns, self._follows_motion = scenario.step_ns, follower.triggered
        sender = vehicle_name(follower.link.sender)
        self._inputs = [
            Sequence(f"{vehicle_name(follower.index)}: {quantity} of {sender}", scenario.step_ns)
            for quantity in (("accel", "pose", "twist") if follower.triggered else ("accel",))
        ]
        self._waiting: tuple[deque[float], ...] = (deque(), deque(), deque())
        self._sent: deque[float] = deque(maxlen=min(self._packets.memory, scenario.samples) + 1)
        self._sample = self._count = 0
        self._quiet, self._window = -1, scenario.run.window
        self._looks_ahead = follower.triggered or not scenario.run.adjustable
        self._publish, self._publish_count = publish, publish_count

    def take(self, stamp: int, acceleration: float) -> None:
        """Accept the predecessor's acceleration [m/s^2] and deliver what is due."""
        if self._follows_motion:
            self._accept(0, stamp, acceleration)
        else:
            self._inputs[0].take(stamp)
            self._deliver(acceleration)

    def take_position(self, stamp: int, position: float) -> None:
        """Accept the predecessor's position [m], where it sends as it moves."""
        self._accept(1, stamp, position)

    def take_velocity(self, stamp: int, velocity: float) -> None:
        """Accept the predecessor's velocity [m/s], where it sends as it moves."""
        self._accept(2, stamp, velocity)

    @property
    def next_sample(self) -> int:
        """The sample from which on a change can take effect."""
        return self._sample

    def change(self, change: Change) -> None:
        """Take a change that is not planned, of what happens to packets sent from then on."""
        self._follower = self._follower.changed(change)
        if isinstance(self._packets, TriggeredChannel):
            self._packets.change(self._follower.composed())
        else:
            self._packets = packet_source(self._follower, self._samples, start=self._sample)

    def _accept(self, number: int, stamp: int, value: float) -> None:
        self._inputs[number].take(stamp)
        self._waiting[number].append(value)
        accelerations, positions, velocities = self._waiting
        while accelerations and positions and velocities:
            self._deliver(accelerations.popleft(), positions.popleft(), velocities.popleft())

    def _deliver(self, acceleration: float, position: float = 0.0, velocity: float = 0.0) -> None:
        sample, sent = self._sample, self._sent
        self._sample = sample + 1
        sent.append(acceleration)
        if sample <= self._quiet:
            return
        try:
            packets = self._packets.deliver(sample, position, velocity)
        except ChannelError as error:
            raise LockstepError(f"{self._name}: its channel: {error}") from error
        for packet in packets:
            carried = sent[packet.content - sample - 1]
            self._publish(packet.source * self._step_ns, packet.value(carried))
        if self._publish_count:
            self._count += len(packets)
            if self._looks_ahead:
                furthest = min(sample + self._window, self._samples - 1)
                self._quiet = min(self._packets.quiet_until(sample), furthest)
            more = max(0, self._quiet - sample)
            self._publish_count(sample * self._step_ns, self._count, more)


class LockstepLeader:
    """Vehicle 0: follows its profile as far as the horizon lets it."""

    def __init__(self, scenario: Scenario, publish_state: PublishState) -> None:
        self._profile: LeaderProfile = scenario.leader_profile()
        self._step, self._step_ns = scenario.run.step, scenario.step_ns
        self._samples = scenario.samples
        self._publish_state = publish_state
        self._sample = 0

    def take_horizon(self, horizon: int) -> None:
        """Publish every sample up to and including `horizon`."""
        for k in range(self._sample, min(horizon + 1, self._samples)):
            self._publish_state(k * self._step_ns, self._profile.at(k * self._step))
            self._sample = k + 1
