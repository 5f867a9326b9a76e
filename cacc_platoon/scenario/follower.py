"""One follower's own parameters, and the model objects made from them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from cacc_platoon.model import (
    ISO_15622,
    ConstantTimeHeadway,
    ControlLaw,
    Gains,
    HoldReception,
    Limits,
    MonitoredReception,
    Reception,
    Sensing,
    ThirdOrderPlant,
)
from cacc_platoon.model.fallback import MARGIN, gains_without_v2v
from cacc_platoon.model.limits import Limit
from cacc_platoon.model.packets import Floats
from cacc_platoon.model.successive import moving_headway
from cacc_platoon.scenario.monitor import assumption_monitor
from cacc_platoon.scenario.plugin import make_plugin
from cacc_platoon.scenario.receiver import Receiver
from cacc_platoon.scenario.table import Sensing as SensingValues
from cacc_platoon.scenario.table import Vehicle

WHOLE = 1e-9
"""How far a number of control periods may be from a whole one, for rounding alone."""


@dataclass(frozen=True)
class Follower(Receiver):
    """One follower's own parameters, and the model objects made from them."""

    tau: float
    tau_max: float
    gains: Gains
    standstill_distance: float
    law_name: str = ""
    body: Vehicle = field(default_factory=Vehicle)
    sensors: SensingValues = field(default_factory=SensingValues)

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

    def headways(self, samples: int) -> Floats | None:
        """Return its time headway at each sample [s]; None where that does not change."""
        changes = [
            (change.sample, change.value)
            for change in self.course.changes
            if change.name == "controller.time_headway"
        ]
        if not changes:
            return None
        rate = self.course.headway_rate * self.step
        return moving_headway(self.gains.time_headway, changes, rate, samples)

    def law(self) -> ControlLaw:
        """Return the vehicle's control law; controller.law may name another one."""
        if self.law_name:
            made: ControlLaw = make_plugin(self.law_name, "controller.law", self, ("command",))
            return made
        return self.spacing_policy()

    @property
    def own_code(self) -> dict[str, str]:
        """What v2v.channel, v2v.receiver and controller.law name, as far as they name anything."""
        named = {
            "v2v.channel": self.v2v.channel,
            "v2v.receiver": self.v2v.receiver,
            "controller.law": self.law_name,
        }
        return {name: text for name, text in named.items() if text}

    def fallback_law(self) -> ConstantTimeHeadway | None:
        """Return the law that needs no V2V, where the vehicle falls back to one."""
        if self.asks_own_code or self.v2v.reception != "fallback":
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
        stages = [stage.v2v for _, stage in self.stages]
        monitor = assumption_monitor(stages, self.sensing(), self.step)
        return MonitoredReception(reception, monitor, acts=self.v2v.monitor == "fallback")
