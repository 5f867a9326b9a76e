"""Everything a design guarantees and tolerates: the one record that every judgement reads.

Each part is computed when it is first read and then kept, so that a search that needs four parts
of a thousand designs, and a report that needs all parts of one, read the same record. Which parts
are proven and which numerical: docs/theory.md, section 13 (What is proven and what is numerical).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

from cacc_platoon.theory.certified_rate import CertifiedRate
from cacc_platoon.theory.exact import L2Gain, is_string_stable, least_margins, worst_l2_gain
from cacc_platoon.theory.joint_loop import joint_critical_period, joint_latency_margin
from cacc_platoon.theory.lag_free_peaks import keeps_peaks_without_lag
from cacc_platoon.theory.latency import latency_margin
from cacc_platoon.theory.mean_square import (
    NoiseStatistics,
    leader_error_norm,
    worst_leader_error_gain,
)
from cacc_platoon.theory.noise_growth import worst_frozen_noise_margin, worst_mean_square_index
from cacc_platoon.theory.peak_gains import (
    WorstGain,
    linf_gain,
    sampled_sure_gain,
    sure_error_gain,
    sure_gain,
    worst_linf_gain,
    worst_sure_error_gain,
    worst_sure_gain,
)
from cacc_platoon.theory.region import stable_gain_range
from cacc_platoon.theory.ring import first_unstable_ring
from cacc_platoon.theory.sampled import is_sampled_string_stable
from cacc_platoon.theory.sampling_limits import critical_loss, critical_period
from cacc_platoon.theory.theorem2 import in_paper_region
from cacc_platoon.theory.transfer import is_internally_stable, slowest_time_constant

if TYPE_CHECKING:
    from collections.abc import Callable

    from cacc_platoon.model.control import Gains

__all__ = ["Certificate", "certify"]


@dataclass(frozen=True)
class Certificate(CertifiedRate):
    """What one design guarantees: worst over tau in (0, tau_max] and I unless stated otherwise.

    The fields are the question, two equal questions are equal certificates. The parts are its
    answers; a part that cannot be computed raises `DesignError` when it is read.
    """

    @cached_property
    def internally_stable(self) -> bool:
        """Routh's test at `tau_max`."""
        return is_internally_stable(self.gains, self.tau_max)

    @cached_property
    def in_paper_region(self) -> bool:
        """Whether the gains are in the paper's sufficient region S of I."""
        return in_paper_region(self.gains, self.rho, self.tau_max, reception=self.reception)

    @cached_property
    def _passes_exact_test(self) -> bool:
        return all(is_string_stable(self.gains, self.tau_max, k) for k in self.effective_gains)

    @property
    def string_stable(self) -> bool:
        """The exact test; where packets are held, that of the sampled mean system too."""
        return self._passes_exact_test and not self.fails_held

    @property
    def fails_held(self) -> bool:
        """Whether a loop that passes the exact test fails since it holds lost packets.

        It does where the loop without loss is string stable at `period`, or where no period keeps
        the one that holds; where a shorter one does, the loop is only sampled too slowly.
        """
        if self.held == 1.0 or not self._passes_exact_test or self.sampled_string_stable:
            return False
        return self.critical_period == 0.0 or replace(self, held=1.0).sampled_string_stable

    @cached_property
    def _worst_l2_gain(self) -> L2Gain:
        return worst_l2_gain(
            self.gains,
            self.rho,
            self.tau_max,
            **self.worst_case,
        )

    @property
    def l2_gain(self) -> float:
        """Worst ``sup |H|``."""
        return self._worst_l2_gain.gain

    @property
    def margins(self) -> tuple[float, float]:
        """`least_margins` at `tau_max`, where both are least."""
        return least_margins(self.gains, self.tau_max, self.effective_gains)

    @property
    def peak_frequency(self) -> float:
        """Frequency of `l2_gain` [rad/s]."""
        return self._worst_l2_gain.peak_omega

    @cached_property
    def worst_linf_gain(self) -> WorstGain:
        """Largest gain between peaks of the mean hop, over all lags and I."""
        if self.k_effective is not None:
            return self._alone(linf_gain(self.gains, self.tau_max, self.k_effective))
        return worst_linf_gain(self.gains, self.rho, self.tau_max, reception=self.reception)

    @property
    def linf_gain(self) -> float:
        """The gain of `worst_linf_gain`."""
        return self.worst_linf_gain.gain

    @property
    def keeps_peaks_without_lag(self) -> bool:
        """Whether peaks of the mean hop do not grow without lag, at both ends of I."""
        return all(keeps_peaks_without_lag(self.gains, k) for k in self.effective_gains)

    @property
    def _late(self) -> bool:
        return self.held < 1.0 or self.latency > 0.0 or self.rare

    @cached_property
    def worst_sure_gain(self) -> WorstGain:
        """Largest gain between peaks of ``a_i`` for every realisation of the noise."""
        return self._surely(sure_gain, worst_sure_gain)

    @cached_property
    def worst_sure_error_gain(self) -> WorstGain:
        """Largest ``|delta_i|`` per peak of ``a_{i-1}`` [s^2], likewise."""
        return self._surely(sure_error_gain, worst_sure_error_gain)

    def _surely(
        self, at_one_lag: Callable[..., float], over_lags: Callable[..., WorstGain]
    ) -> WorstGain:
        known = {"reception": self.reception, "late": self._late}
        if self.k_effective is None:
            return over_lags(self.gains, self.rho, self.tau_max, **known)
        return self._alone(at_one_lag(self.gains, self.rho, self.tau_max, **known))

    def _alone(self, gain: float) -> WorstGain:
        return WorstGain(gain, self.tau_max, gain)

    @cached_property
    def sampled_sure_gain(self) -> float:
        """`worst_sure_gain` of the loop sampled at `period`."""
        return sampled_sure_gain(
            self.gains,
            self.rho,
            self.tau_max,
            self.period,
            reception=self.reception,
            late=self._late,
            tau=None if self.k_effective is None else self.tau_max,
        )

    @cached_property
    def first_unstable_ring(self) -> int | None:
        """Fewest vehicles of an unstable ring, at `tau_max` and the ends of I; None for none."""
        found = [first_unstable_ring(self.gains, self.tau_max, k) for k in self.effective_gains]
        return min((number for number in found if number is not None), default=None)

    @cached_property
    def sampled_string_stable(self) -> bool:
        """Whether `period` keeps string stability: acceleration fresh, or held at `held`."""
        return is_sampled_string_stable(
            self.gains,
            self.rho,
            self.tau_max,
            self.period,
            **self.sampled_worst_case,
        )

    @cached_property
    def critical_period(self) -> float:
        """Control period at which `sampled_string_stable` is first lost [s]."""
        lost = self.held < 1.0 and not self.sampled_string_stable
        return critical_period(
            self.gains,
            self.rho,
            self.tau_max,
            **self.sampled_worst_case,
            lost_at=self.period if lost else math.inf,
        )

    @cached_property
    def critical_loss(self) -> float:
        """Share of lost packets at which a receiver that holds first loses it at `period`."""
        return critical_loss(
            self.gains,
            self.rho,
            self.tau_max,
            self.period,
            **self.worst_case,
            lost_at=1.0 if self.sampled_string_stable else 1.0 - self.held,
        )

    @cached_property
    def joint_latency_margin(self) -> float:
        """Largest V2V latency [s] of the loop sampled at `period`, with its losses."""
        return joint_latency_margin(
            self.gains,
            self.rho,
            self.tau_max,
            self.period,
            **self.sampled_worst_case,
        )

    @cached_property
    def joint_critical_period(self) -> float:
        """Control period [s] lost first with its losses and an age of `latency` and one period."""
        return joint_critical_period(
            self.gains,
            self.rho,
            self.tau_max,
            latency=self.latency,
            **self.sampled_worst_case,
        )

    @cached_property
    def latency_margin(self) -> float:
        """Largest V2V latency [s] of the loop in continuous time, held packets left aside."""
        return latency_margin(
            self.gains,
            self.rho,
            self.tau_max,
            **self.worst_case,
        )

    @cached_property
    def mean_square_index(self) -> float:
        """Growth of mean-square energy at the mean noise; below one it stays bounded.

        NaN where packets may be lost or late, which changes the noise that is received.
        """
        if self.reception < 1.0 or self._late:
            return math.nan
        return worst_mean_square_index(
            self.gains, self.tau_max, self._mean_gain, self.period, self.noise
        )

    @cached_property
    def frozen_noise_margin(self) -> float:
        """Margin against noise that is random but constant; NaN as `mean_square_index`."""
        if self.reception < 1.0 or self._late:
            return math.nan
        return worst_frozen_noise_margin(self.gains, self.tau_max, self._mean_gain, self.noise)

    @property
    def _mean_gain(self) -> float:
        return self.gains.k_a * self.noise.mean if self.k_effective is None else self.k_effective

    @cached_property
    def slowest_time_constant(self) -> float:
        """Slowest mode at `tau_max` [s]."""
        return slowest_time_constant(self.gains, self.tau_max)

    @cached_property
    def leader_error_norm(self) -> float:
        """``||Phi||_2``, largest over lags (its square is convex over linear: an end) and I."""
        lags = (self.tau_max,) if self.k_effective is not None else (0.0, self.tau_max)
        return max(leader_error_norm(self.gains, x, k) for x in lags for k in self.effective_gains)

    @cached_property
    def leader_error_gain(self) -> float:
        """Largest ``||delta_i||_2`` per ``||a_{i-1}||_2`` [s^2], in the mean, over lags and I."""
        return worst_leader_error_gain(self.gains, self.tau_max, self.effective_gains)

    @cached_property
    def gain_range(self) -> tuple[float, float] | None:
        """Effective gains ``k_a E[w]`` that these gains tolerate, None when there are none."""
        return stable_gain_range(self.gains, self.tau_max)

    def parts(self) -> dict[str, Any]:
        """Compute every part, and return them by name; with `held` not all can be."""
        return {
            name: getattr(self, name)
            for kind in type(self).__mro__
            for name, part in vars(kind).items()
            if isinstance(part, cached_property | property)
            and not name.startswith(("_", "fails"))
            and not name.endswith(("worst_case", "rare"))
        }


def certify(
    gains: Gains,
    rho: float,
    tau_max: float,
    *,
    period: float = 0.01,
    noise: NoiseStatistics | None = None,
    reception: float = 1.0,
    k_effective: float | None = None,
    held: float = 1.0,
    latency: float = 0.0,
    v2v_period: float | None = None,
) -> Certificate:
    """Certify one design.

    Parameters
    ----------
    gains, rho, tau_max, period, noise, reception, k_effective, held, latency, v2v_period
        The attributes of `Certificate`; no noise of its own by default, but every mean that `rho`
        permits.

    Returns
    -------
    Certificate
        All guarantees, each computed when it is read. A design that is not string stable is an
        answer, not an error.

    Raises
    ------
    DesignError
        If a value is out of its range or not finite.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> certificate = certify(Gains(0.95, 0.5, 0.63, 0.009), rho=5.0, tau_max=0.5)
    >>> certificate.string_stable, round(certificate.latency_margin, 4)
    (True, 0.0818)
    """
    noise = noise or NoiseStatistics(redraw_period=period)
    return Certificate(
        gains, rho, tau_max, period, noise, reception, k_effective, held, latency, v2v_period
    )
