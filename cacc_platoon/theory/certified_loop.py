"""The loop that a certificate is about: a design, its noise and lag, and how packets come.

The symbols are those of docs/theory.md, section 1 (Setting).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, TypedDict

from cacc_platoon.theory.errors import require, require_positive, require_reception
from cacc_platoon.theory.lifted_hop import packet_interval
from cacc_platoon.theory.mean_square import NoiseStatistics
from cacc_platoon.theory.noise_interval import (
    EffectiveInterval,
    effective_gains,
    effective_interval,
)

if TYPE_CHECKING:
    from cacc_platoon.model.control import Gains

__all__ = ["CertifiedLoop"]


class Tried(TypedDict):
    """What decides the effective gains that are tried."""

    reception: float
    k_effective: float | None


class TriedSampled(Tried):
    """What decides them, and packets that are held."""

    held: float


@dataclass(frozen=True)
class CertifiedLoop:
    """What a certificate is asked about; two equal ones are one question.

    Attributes
    ----------
    gains : Gains
        Controller.
    rho, tau_max : float
        Linear signal-to-noise ratio and largest actuation lag ``tau_0`` [s].
    period : float
        Control period [s] of the sampled loop.
    noise : NoiseStatistics
        For the mean-square index.
    reception : float
        Smallest packet reception probability, losses counted as zero.
    held : float
        Packet reception probability of a receiver that holds the last packet. `string_stable`
        and what is sampled are judged with it; gains, margins and the paper's test are those of
        the loop without loss.
    k_effective : float or None
        The one effective gain at `tau_max` that is asked for instead of the worst case.
    latency : float
        V2V latency [s] of the joint loop.
    v2v_period : float or None
        Time from packet to packet [s], a whole multiple of `period`; None for one every period.
    """

    gains: Gains
    rho: float
    tau_max: float
    period: float = 0.01
    noise: NoiseStatistics = field(default_factory=NoiseStatistics)
    reception: float = 1.0
    k_effective: float | None = None
    held: float = 1.0
    latency: float = 0.0
    v2v_period: float | None = None

    def __post_init__(self) -> None:
        """Refuse a question that has no meaning; a design that fails is an answer."""
        require_positive("tau_max", self.tau_max, "s")
        require_positive("period", self.period, "s")
        require_positive("time_headway", self.gains.time_headway, "s")
        k = 0.0 if self.k_effective is None else self.k_effective
        for name, value in {**self.gains._asdict(), "k_effective": k}.items():
            require(
                math.isfinite(value) and value >= 0,
                f"{name} = {value:g} is not a finite, nonnegative number: the control law would "
                f"push the wrong way. Give {name} >= 0.",
            )
        require(
            0 <= self.latency < math.inf,
            f"latency = {self.latency:g} s is not a finite, nonnegative time: no margin can cover "
            "it. Give the largest V2V latency in seconds.",
        )
        _ = self.interval  # refuses rho and reception
        require_reception(self.held, "held")
        if self.v2v_period is not None:
            packet_interval(self.v2v_period, self.period)

    @cached_property
    def interval(self) -> EffectiveInterval:
        """The interval I of ``k = k_a E[w]``, with losses ``p k_a E[w]``."""
        return effective_interval(self.gains.k_a, self.rho, reception=self.reception)

    @cached_property
    def effective_gains(self) -> tuple[float, ...]:
        """The effective gains that decide: both ends of I, or `k_effective`."""
        return effective_gains(
            self.gains.k_a, self.rho, reception=self.reception, k_effective=self.k_effective
        )

    @property
    def worst_case(self) -> Tried:
        """Reception and known gain, as the worst cases of the theory take them."""
        return {"reception": self.reception, "k_effective": self.k_effective}

    @property
    def sampled_worst_case(self) -> TriedSampled:
        """Those and the packets that are held."""
        return {**self.worst_case, "held": self.held}

    @property
    def rare(self) -> bool:
        """Whether packets come less often than once a control period."""
        return self.v2v_period is not None and packet_interval(self.v2v_period, self.period) > 1
