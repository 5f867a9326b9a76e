"""The receiving end of a V2V link: what is sent, what happens to packets, what is made of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

from cacc_platoon.model import (
    AdditiveNoise,
    BitNoise,
    Blackouts,
    BurstLoss,
    CamRule,
    Channel,
    ChannelSource,
    ComposedChannel,
    ConstantLatency,
    ConstantNoise,
    ContentNoise,
    FallbackReception,
    FalseData,
    Forgery,
    HoldReception,
    Impairment,
    IndependentLoss,
    InOrder,
    Lattice,
    Link,
    Noise,
    PacketSource,
    RandomLatency,
    Reception,
    SendTimes,
    TriggeredChannel,
    ZeroReception,
    expected_factor,
)
from cacc_platoon.model.keyed_random import PHASE, keyed_uniform
from cacc_platoon.model.latency import gamma_delay, uniform_delay
from cacc_platoon.model.send_rule import MOST_TIME
from cacc_platoon.model.successive import Successive
from cacc_platoon.scenario.false_data import forgery
from cacc_platoon.scenario.parameter import ScenarioError
from cacc_platoon.scenario.plugin import make_plugin
from cacc_platoon.scenario.table import TABLE
from cacc_platoon.scenario.timeline import Change
from cacc_platoon.scenario.v2v_parameters import V2V

WHOLE = 1e-9
"""How far a number of control periods may be from a whole one, for rounding alone."""


class Course(NamedTuple):
    """What changes for a follower in the course of a run.

    Attributes
    ----------
    changes : tuple of Change
        The planned changes, in order.
    headway_rate : float
        How fast its time headway changes [s/s].
    adjustable : bool
        Whether more may change that is not planned.
    clocked : bool
        Whether nodes keep time by clocks, so that nobody knows before when a packet comes.
    """

    changes: tuple[Change, ...] = ()
    headway_rate: float = 1.0
    adjustable: bool = False
    clocked: bool = False


@dataclass(frozen=True)
class Receiver:
    """The receiving end of a V2V link.

    Attributes
    ----------
    link : Link
        The link that noise and channel are those of, from its predecessor unless `on` says.
    v2v : V2V
        What is sent, what happens to it and what is made of it.
    seed : int
        Of all noise.
    step : float
        Control period [s].
    course : Course
        What changes in the course of the run.
    given : callable or None
        Makes a reception of one's own from it, in place of that of v2v.
    """

    link: Link
    v2v: V2V
    seed: int
    step: float
    course: Course = field(default_factory=Course, kw_only=True)
    given: Callable[[Any], Reception] | None = field(default=None, kw_only=True, compare=False)

    @property
    def index(self) -> int:
        """Its index."""
        return self.link.receiver

    def on(self, link: Link) -> Self:
        """Return the same follower as the receiver of another of its links."""
        return replace(self, link=link)

    def changed(self, change: Change) -> Self:
        """Return the follower with a change more."""
        changes = sorted([*self.course.changes, change], key=lambda one: one.sample)
        return replace(self, course=self.course._replace(changes=tuple(changes)))

    @property
    def hold_steps(self) -> int:
        """For how many control periods one draw of the noise is held."""
        return max(1, round(self.v2v.hold / self.step))

    @property
    def latency_steps(self) -> int:
        """By how many control periods packets come later, in the mean where that differs."""
        late = self._jitter()
        return round(late.mean_delay) if late else self._constant_latency

    @property
    def longest_latency_steps(self) -> int:
        """By how many control periods packets come later at most."""
        return max(stage.longest_stage_latency_steps for _, stage in self.stages)

    @property
    def longest_stage_latency_steps(self) -> int:
        """The same as long as nothing changes."""
        late = self._jitter()
        return late.longest_delay if late else self._constant_latency

    @property
    def _constant_latency(self) -> int:
        return math.ceil(self.v2v.latency / self.step - WHOLE)

    @property
    def errs(self) -> bool:
        """Whether what its packets say is more than noise times the sender's acceleration."""
        said = [stage.v2v for _, stage in self.stages]
        return any(v2v.bias or v2v.noise_std or v2v.quantum or v2v.saturation for v2v in said)

    @property
    def send_times(self) -> SendTimes:
        """At which samples its sender sends a packet."""
        interval = max(1, round(self.v2v.period / self.step))
        return SendTimes(interval, self._phase(interval))

    def _phase(self, interval: int) -> int:
        """Return the first sample of those that are `interval` apart."""
        match self.v2v.phase:
            case "aligned":
                return 0
            case "random":
                drawn = keyed_uniform(self.seed, self.link.key, PHASE)(0, 1)[0]
                return int(drawn * interval)
            case float(seconds):
                return round(seconds / self.step)
            case other:
                raise ValueError(f"v2v.phase = {other} has no branch here")

    def noise(self, kind: str | None = None) -> Noise:
        """Return the content noise of the link, of its own v2v.noise by default.

        Raises
        ------
        ScenarioError
            For a kind that there is not.
        """
        v2v = self.v2v
        match TABLE["v2v.noise"].check(v2v.noise if kind is None else kind, "noise"):
            case "bits":
                return BitNoise(
                    v2v.rho, v2v.bit_probabilities, self.seed, self.link.key, self.hold_steps
                )
            case "expected":
                return ConstantNoise(expected_factor(v2v.rho, v2v.bit_probabilities))
            case "none":
                return ConstantNoise(1.0)
            case other:
                raise ValueError(f"v2v.noise = {other} has no branch here")

    def bursts(self) -> BurstLoss:
        """Return the losses of the link in good and in bad times."""
        v2v = self.v2v
        probabilities = v2v.burst_begin, v2v.burst_end, v2v.loss, v2v.burst_loss
        return BurstLoss(*probabilities, seed=self.seed, link=self.link.key)

    @property
    def mean_loss(self) -> float:
        """Share of its packets that are lost outside of blackouts."""
        return self.bursts().mean_loss if self.v2v.burst_begin else self.v2v.loss

    @property
    def blackouts(self) -> list[tuple[int, int]]:
        """The samples of each blackout: its first, and the first after it."""
        ends = [math.ceil(time / self.step - WHOLE) for time in self.v2v.blackouts]
        return list(zip(ends[::2], ends[1::2], strict=True))

    @property
    def stages(self) -> list[tuple[int, Self]]:
        """The link as it is from sample 0 on, and from each sample on at which it changes."""
        found = {0: self}
        for change in self.course.changes:
            group, _, name = change.name.partition(".")
            if group == "v2v":
                latest, new = [*found.values()][-1], {name: change.value}
                v2v = replace(latest.v2v, **new)  # type: ignore[arg-type]
                found[change.sample] = replace(latest, v2v=v2v)
        return list(found.items())

    def timing(self) -> ComposedChannel:
        """Return when the packets of the link come, in the mean, and what false data they carry."""
        stages = [
            (start, [*stage._false_data(), ConstantLatency(stage.latency_steps)])
            for start, stage in self.stages
        ]
        return ComposedChannel(self._in_turn(stages), self.send_times)

    def _jitter(self) -> RandomLatency | None:
        """Return the latency of packets that take different times."""
        v2v = self.v2v
        if not v2v.jitter:
            return None
        match v2v.jitter_law:
            case "uniform":
                chances = uniform_delay(v2v.latency, v2v.jitter, self.step)
            case "gamma":
                chances = gamma_delay(v2v.latency, v2v.jitter, v2v.jitter_shape, self.step)
            case other:
                raise ValueError(f"v2v.jitter_law = {other} has no branch here")
        return RandomLatency(chances, self.seed, self.link.key)

    def _latency(self) -> list[Impairment]:
        late = self._jitter()
        if late is None:
            return [ConstantLatency(self._constant_latency)]
        return [late]

    def _false_data(self) -> list[Impairment]:
        forgeries = self.forgeries
        return [FalseData(forgeries)] if forgeries else []

    @property
    def forgeries(self) -> list[Forgery]:
        """The times of false data, in order."""
        return sorted(forgery(text, self.step) for text in self.v2v.false_data)

    @property
    def lattice(self) -> Lattice:
        """The accelerations that its packets can say."""
        return Lattice(self.v2v.quantum, self.v2v.saturation)

    def channel(self, noise: str | None = None) -> Channel:
        """Return the channel of the link; v2v.channel may name another one.

        Raises
        ------
        ValueError
            Where its sender sends as it moves: what arrives is known of `triggered_channel` alone.
        """
        if self.triggered:
            raise ValueError("the packets of this link follow the motion of its sender")
        if self.v2v.channel:
            members = ("prompt", "longest_delay", "delivery")
            made: Channel = make_plugin(self.v2v.channel, "v2v.channel", self, members)
            return made
        return self.composed(noise)

    def triggered_channel(self, noise: str | None = None) -> TriggeredChannel:
        """Return the channel of the link from its first packet on, sent as the sender moves."""
        return TriggeredChannel(self.send_rule(), self.composed(noise), in_order=self.v2v.in_order)

    def composed(self, noise: str | None = None) -> ComposedChannel:
        """Return what v2v says of the link, whatever custom channel it names."""
        stages = [(start, stage._impairments(noise)) for start, stage in self.stages]
        return ComposedChannel(self._in_turn(stages), self.send_times, self.lattice)

    def _in_turn(self, stages: list[tuple[int, list[Impairment]]]) -> Sequence[Impairment]:
        """Return the impairments of all stages as those of one channel."""
        after: list[Impairment] = []
        if self.v2v.in_order and (stages[1:] or self.v2v.jitter):
            after = [InOrder(self.longest_latency_steps)]
        return [*(stages[0][1] if len(stages) == 1 else [Successive(stages)]), *after]

    def _impairments(self, noise: str | None) -> list[Impairment]:
        """Return what happens to packets as long as nothing changes."""
        v2v, key = self.v2v, self.link.key
        impairments: list[Impairment] = [ContentNoise(self.noise(noise))]
        if v2v.bias or v2v.noise_std:
            impairments.append(AdditiveNoise(v2v.noise_std, v2v.bias, self.seed, key))
        impairments += self._false_data()
        if v2v.burst_begin:
            impairments.append(self.bursts())
        elif v2v.loss:
            impairments.append(IndependentLoss(v2v.loss, self.seed, key))
        if v2v.blackouts:
            impairments.append(Blackouts(self.blackouts))
        return [*impairments, *self._latency()]

    @property
    def counted(self) -> bool:
        """Whether packets are counted: they may be lost or late, or its receiver may ask."""
        custom = self.v2v.channel or self.v2v.receiver or self.course.adjustable
        said = custom or self.course.clocked or self.v2v.monitor != "none"
        return bool(said) or self.triggered or not self.composed().prompt

    @property
    def asks_own_code(self) -> bool:
        """Whether code of one's own decides what the vehicle makes of packets."""
        return bool(self.v2v.receiver or self.given)

    def receiving(self, given: Callable[[Any], Reception] | None) -> Self:
        """Return the same follower with a reception of one's own, where one is given.

        Raises
        ------
        ScenarioError
            Where packets are not counted, so that nobody would ask it.
        """
        if given and not self.counted:
            raise ScenarioError(
                f"vehicle {self.index}: a reception of one's own is asked only where packets are "
                "counted, and the scenario says that all come at once. Set run.adjustable, or "
                "name it in v2v.receiver."
            )
        return replace(self, given=given)

    @property
    def longest_interval(self) -> int:
        """The most samples from packet to packet."""
        if self.triggered:
            return round(MOST_TIME / self.step)
        return self.send_times.interval

    @property
    def triggered(self) -> bool:
        """Whether its sender sends as it moves."""
        return self.v2v.send_rule == "cam" and not self.v2v.channel

    def send_rule(self) -> CamRule:
        """Return when its sender sends, where that is as it moves."""
        check = max(1, round(self.v2v.cam_check / self.step))
        return CamRule(self.step, check, self._phase(check))

    @property
    def holds(self) -> bool:
        """Whether it uses the last packet while others are lost."""
        return self.v2v.reception != "zero"

    def plain_reception(self) -> Reception:
        """Return what the vehicle makes of packets, as v2v says unless another one is given."""
        if self.given:
            return self.given(self)
        if self.v2v.receiver:
            made: Reception = make_plugin(self.v2v.receiver, "v2v.receiver", self, ("use",))
            return made
        match self.v2v.reception:
            case "hold":
                return HoldReception()
            case "zero":
                return ZeroReception(self.longest_interval)
            case "fallback":
                times = self.v2v.fallback_after, self.v2v.fallback_blend, self.v2v.fallback_return
                return FallbackReception(*(max(1, round(time / self.step)) for time in times))
            case other:
                raise ValueError(f"v2v.reception = {other} has no branch here")


def packet_source(
    receiver: Receiver,
    samples: int,
    channel: Channel | None = None,
    noise: str | None = None,
    *,
    start: int = 0,
) -> PacketSource:
    """Return the packets of a link from a sample on, of another channel where one is given.

    Raises
    ------
    ChannelError
        When a channel, which may be anybody's, says nothing sensible of itself.
    """
    if channel is None and receiver.triggered:
        return receiver.triggered_channel(noise)
    return ChannelSource(channel or receiver.channel(noise), samples, start)
