"""One follower's own parameters, and the model objects made from them."""

from __future__ import annotations

from dataclasses import dataclass

from cacc_platoon.model import (
    BitChannel,
    Channel,
    ConstantChannel,
    ConstantTimeHeadway,
    Gains,
    ThirdOrderPlant,
    expected_factor,
)
from cacc_platoon.scenario.table import V2V


@dataclass(frozen=True)
class Follower:
    """One follower's own parameters, and the model objects made from them."""

    index: int
    tau: float
    tau_max: float
    gains: Gains
    standstill_distance: float
    v2v: V2V
    seed: int
    hold_steps: int

    def plant(self, step: float) -> ThirdOrderPlant:
        """Return the vehicle's dynamics at the control period `step` [s]."""
        return ThirdOrderPlant(self.tau, step)

    def law(self) -> ConstantTimeHeadway:
        """Return the vehicle's control law."""
        return ConstantTimeHeadway(self.gains, self.standstill_distance)

    @property
    def counted(self) -> bool:
        """Whether its channel may lose or delay packets, so that its relay counts them."""
        return False

    def channel(self, noise: str | None = None) -> Channel:
        """Return the channel of the link from the predecessor, with its own `noise` by default."""
        v2v = self.v2v
        match noise or v2v.noise:
            case "bits":
                return BitChannel(
                    v2v.rho, v2v.bit_probabilities, self.seed, self.index, self.hold_steps
                )
            case "expected":
                return ConstantChannel(expected_factor(v2v.rho, v2v.bit_probabilities))
        return ConstantChannel(1.0)
