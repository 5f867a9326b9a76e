"""One follower's own parameters, and the model objects made from them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from cacc_platoon.model import (
    ISO_15622,
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
    ConstantTimeHeadway,
    ContentNoise,
    ControlLaw,
    FallbackReception,
    FalseData,
    Forgery,
    Gains,
    HoldReception,
    Impairment,
    IndependentLoss,
    InOrder,
    Lattice,
    Limits,
    Link,
    MonitoredReception,
    Noise,
    PacketSource,
    RandomLatency,
    Reception,
    SendTimes,
    Sensing,
    ThirdOrderPlant,
    TriggeredChannel,
    ZeroReception,
    expected_factor,
)
from cacc_platoon.model.fallback import MARGIN, gains_without_v2v
from cacc_platoon.model.keyed_random import PHASE, keyed_uniform
from cacc_platoon.model.latency import gamma_delay, uniform_delay
from cacc_platoon.model.limits import Limit
from cacc_platoon.model.send_rule import MOST_TIME
from cacc_platoon.scenario.false_data import forgery
from cacc_platoon.scenario.monitor import assumption_monitor
from cacc_platoon.scenario.plugin import make_plugin
from cacc_platoon.scenario.table import TABLE, Vehicle
from cacc_platoon.scenario.table import Sensing as SensingValues
from cacc_platoon.scenario.v2v_parameters import V2V

WHOLE = 1e-9
"""How far a number of control periods may be from a whole one, for rounding alone."""


@dataclass(frozen=True)
class Follower:
    """One follower's own parameters, and the model objects made from them.

    Attributes
    ----------
    link : Link
        The link that noise and channel are those of, from its predecessor unless `on` says.
    step : float
        Control period [s].
    """

    link: Link
    tau: float
    tau_max: float
    gains: Gains
    standstill_distance: float
    v2v: V2V
    seed: int
    step: float
    law_name: str = ""
    body: Vehicle = field(default_factory=Vehicle)
    sensors: SensingValues = field(default_factory=SensingValues)

    @property
    def index(self) -> int:
        """Its index."""
        return self.link.receiver

    def on(self, link: Link) -> Follower:
        """Return the same follower as the receiver of another of its links."""
        return replace(self, link=link)

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
        late = self._jitter()
        return late.longest_delay if late else self._constant_latency

    @property
    def _constant_latency(self) -> int:
        return math.ceil(self.v2v.latency / self.step - WHOLE)

    @property
    def errs(self) -> bool:
        """Whether what its packets say is more than noise times the sender's acceleration."""
        v2v = self.v2v
        return bool(v2v.bias or v2v.noise_std or v2v.quantum or v2v.saturation)

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

    @property
    def length(self) -> float:
        """Its length [m]."""
        return self.body.length

    def limits(self) -> Limits | None:
        """Return what its actuator can do; None for anything."""
        body = self.body
        match body.limits:
            case "none":
                return None
            case "constant":
                values = body.max_acceleration, body.max_deceleration, body.max_jerk
                return Limits(*(Limit(value, value) for value in values))
            case "iso15622":
                return ISO_15622
            case other:
                raise ValueError(f"vehicle.limits = {other} has no branch here")

    @property
    def stops(self) -> bool:
        """Whether it stands where it would drive backwards."""
        return self.body.stops

    def sensing(self) -> Sensing:
        """Return how it measures the vehicle ahead."""
        sensors = self.sensors
        delay = math.ceil(sensors.delay / self.step - WHOLE)
        return Sensing(
            delay, sensors.range_std, sensors.range_rate_std, seed=self.seed, vehicle=self.index
        )

    def plant(self, step: float) -> ThirdOrderPlant:
        """Return the vehicle's dynamics at the control period `step` [s]."""
        return ThirdOrderPlant(self.tau, step)

    def spacing_policy(self) -> ConstantTimeHeadway:
        """Return the law of headway and gains, by which spacing errors are measured."""
        return ConstantTimeHeadway(self.gains, self.standstill_distance)

    def law(self) -> ControlLaw:
        """Return the vehicle's control law; controller.law may name another one."""
        if self.law_name:
            made: ControlLaw = make_plugin(self.law_name, "controller.law", self, ("command",))
            return made
        return self.spacing_policy()

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

    def timing(self) -> ComposedChannel:
        """Return when the packets of the link come, in the mean, and what false data they carry."""
        late = ConstantLatency(self.latency_steps)
        return ComposedChannel([*self._false_data(), late], self.send_times)

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
        return [late, InOrder(late.longest_delay)] if self.v2v.in_order else [late]

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
        return self._composed(noise)

    def triggered_channel(self, noise: str | None = None) -> TriggeredChannel:
        """Return the channel of the link from its first packet on, sent as the sender moves."""
        return TriggeredChannel(self.send_rule(), self._composed(noise))

    def _composed(self, noise: str | None = None) -> ComposedChannel:
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
        return ComposedChannel([*impairments, *self._latency()], self.send_times, self.lattice)

    @property
    def own_code(self) -> dict[str, str]:
        """What v2v.channel, v2v.receiver and controller.law name, as far as they name anything."""
        named = {
            "v2v.channel": self.v2v.channel,
            "v2v.receiver": self.v2v.receiver,
            "controller.law": self.law_name,
        }
        return {name: text for name, text in named.items() if text}

    @property
    def counted(self) -> bool:
        """Whether its relay counts packets: they may be lost or late, or its receiver may ask."""
        custom = self.v2v.channel or self.v2v.receiver
        watched = self.v2v.monitor != "none"
        return bool(custom) or watched or self.triggered or not self._composed().prompt

    @property
    def _longest_interval(self) -> int:
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

    def fallback_law(self) -> ConstantTimeHeadway | None:
        """Return the law that needs no V2V, where the vehicle falls back to one."""
        if self.v2v.receiver or self.v2v.reception != "fallback":
            return None
        headway = self.v2v.fallback_headway or 2.0 * (1.0 + MARGIN) * self.tau_max
        return ConstantTimeHeadway(
            gains_without_v2v(self.tau_max, headway), self.standstill_distance
        )

    @property
    def monitored(self) -> bool:
        """Whether it compares the packets of the link with what it measures of their sender."""
        return self.v2v.monitor != "none" and self.link.sender == self.link.receiver - 1

    def reception(self) -> Reception:
        """Return what the vehicle makes of packets, with its monitor if it has one."""
        return self._watching(self.plain_reception())

    def watching_reception(self) -> Reception:
        """Return one that does no more than `reception` to say what its monitor says."""
        return self._watching(HoldReception())

    def _watching(self, reception: Reception) -> Reception:
        if not self.monitored:
            return reception
        monitor = assumption_monitor(self.v2v, self.sensing(), self.step)
        return MonitoredReception(reception, monitor, acts=self.v2v.monitor == "fallback")

    def plain_reception(self) -> Reception:
        """Return that without a monitor; v2v.receiver may name something else."""
        if self.v2v.receiver:
            made: Reception = make_plugin(self.v2v.receiver, "v2v.receiver", self, ("use",))
            return made
        match self.v2v.reception:
            case "hold":
                return HoldReception()
            case "zero":
                return ZeroReception(self._longest_interval)
            case "fallback":
                times = self.v2v.fallback_after, self.v2v.fallback_blend, self.v2v.fallback_return
                return FallbackReception(*(max(1, round(time / self.step)) for time in times))
            case other:
                raise ValueError(f"v2v.reception = {other} has no branch here")


def packet_source(
    follower: Follower,
    samples: int,
    channel: Channel | None = None,
    noise: str | None = None,
) -> PacketSource:
    """Return the packets of a link from its first one on, of another channel where one is given.

    Raises
    ------
    ChannelError
        When a channel, which may be anybody's, says nothing sensible of itself.
    """
    if channel is None and follower.triggered:
        return follower.triggered_channel(noise)
    return ChannelSource(channel or follower.channel(noise), samples)
