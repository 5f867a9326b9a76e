"""What a certificate says of packets that have a period of their own.

It is derived in docs/theory.md, section 7 (V2V latency).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from cacc_platoon.theory.certified_loop import CertifiedLoop
from cacc_platoon.theory.end_to_end import end_to_end_gain
from cacc_platoon.theory.lifted_hop import packet_interval
from cacc_platoon.theory.multirate import (
    HopGrowth,
    bears_v2v_period,
    critical_v2v_period,
    worst_multirate_growth,
)
from cacc_platoon.theory.phases import PhaseGrowth, worst_phase_growth

__all__ = ["CertifiedRate"]


@dataclass(frozen=True)
class CertifiedRate(CertifiedLoop):
    """Growth along the platoon with a packet every `v2v_period`, and how long that may be."""

    @property
    def _interval(self) -> int:
        """Control periods from packet to packet."""
        return packet_interval(self.v2v_period or self.period, self.period)

    @cached_property
    def v2v_growth(self) -> HopGrowth | None:
        """Growth per hop with a packet every `v2v_period`; None without one of its own."""
        if self.v2v_period is None:
            return None
        return worst_multirate_growth(
            self.gains,
            self.rho,
            self.tau_max,
            self.period,
            self._interval,
            latency=self.latency,
            **self.sampled_worst_case,
        )

    @cached_property
    def bears_v2v_period(self) -> bool:
        """Whether `v2v_growth` is none or one, at a fraction of its price."""
        return self.v2v_period is None or bears_v2v_period(
            self.gains,
            self.rho,
            self.tau_max,
            self.period,
            self._interval,
            latency=self.latency,
            **self.sampled_worst_case,
        )

    @cached_property
    def v2v_phase_growth(self) -> PhaseGrowth | None:
        """The same where each vehicle sends later than its predecessor, at `tau_max`."""
        if self.v2v_growth is None:
            return None
        found = [
            worst_phase_growth(
                self.gains,
                self.tau_max,
                k,
                self.period,
                self._interval,
                latency=self.latency,
                held=self.held,
            )
            for k in self.effective_gains
        ]
        return max(found, key=lambda one: one.growth.growth)

    @cached_property
    def critical_v2v_period(self) -> float:
        """Longest time [s] from packet to packet at which nothing grows."""
        kept = self.bears_v2v_period
        return critical_v2v_period(
            self.gains,
            self.rho,
            self.tau_max,
            self.period,
            latency=self.latency,
            kept_at=packet_interval(self.v2v_period, self.period)
            if kept and self.v2v_period
            else 0,
            **self.sampled_worst_case,
        )

    def v2v_end_to_end_gain(self, vehicles: int) -> float | None:
        """Largest ``|a_N|_2`` per ``|a_0|_2``, packets every `v2v_period`, where they grow most."""
        if self.v2v_growth is None:
            return None
        return end_to_end_gain(
            self.gains,
            max(self.v2v_growth.tau, 1e-6 * self.tau_max),
            self.v2v_growth.k_effective,
            self.period,
            self._interval,
            vehicles=vehicles,
            latency=self.latency,
            held=self.held,
        )
