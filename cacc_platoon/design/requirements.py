"""What a design must meet, and designs with their certificate and what they miss."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from cacc_platoon.model.control import Gains
from cacc_platoon.theory.certificate import Certificate, certify
from cacc_platoon.theory.errors import (
    DesignError,
    require,
    require_positive,
    require_reception,
    require_rho,
)
from cacc_platoon.theory.exact import TOLERANCE
from cacc_platoon.theory.lifted_hop import packet_interval
from cacc_platoon.theory.mean_square import NoiseStatistics
from cacc_platoon.theory.noise_interval import checked_interval
from cacc_platoon.theory.region import infimum_headway, minimum_headway
from cacc_platoon.theory.theorem2 import optimum, paper_region
from cacc_platoon.theory.worst_braking import SHARES, worst_spacing

__all__ = ["Design", "Recommendation", "Requirements", "assess", "paper_design"]

_FOLLOWERS = 12


@dataclass(frozen=True)
class Requirements:
    """What the user insists on, all of it at once; None leaves the choice to the designer.

    Attributes
    ----------
    period : float
        Control period [s].
    latency : float
        V2V latency [s]. The loop sampled at `period` must be string stable with an acceleration
        that is older by one period, the time a message may wait.
    reception : float
        Smallest packet reception probability.
    hold : bool
        Whether the receiver holds the last packet, with just this reception; else a lost packet
        counts as zero, and any reception from this to 1 is covered.
    max_headway : float or None
        Longest headway [s]; default ``2.5 tau_max``.
    v2v_period : float or None
        Time from packet to packet [s], a whole multiple of `period`, with the acceleration held in
        between; None for a packet every control period.
    min_gap : float or None
        Least gap [m] over all brakings of the leader with up to `braking` from `speed` to rest, in
        the mean and in continuous time; `latency`, `v2v_period` and held packets are left out.
    braking, speed, standstill_gap : float
        Deceleration [m/s^2], speed [m/s], and gap at rest [m]: ``d`` less the vehicle's length.
    max_linf : float or None
        Largest L-infinity gain of the mean hop over all lags, >= 1.
    max_time_constant : float or None
        Slowest mode allowed [s].
    k_a, time_headway : float or None
        Values that are given.
    """

    period: float = 0.01
    latency: float = 0.0
    reception: float = 1.0
    hold: bool = False
    v2v_period: float | None = None
    min_gap: float | None = None
    braking: float = 8.0
    speed: float = 25.0
    standstill_gap: float = 5.0
    max_headway: float | None = None
    max_linf: float | None = None
    max_time_constant: float | None = None
    k_a: float | None = None
    time_headway: float | None = None

    @property
    def latency_margin(self) -> float:
        """Latency margin [s] that the requirements amount to."""
        return self.latency + self.period

    @property
    def counted_as_zero(self) -> float:
        """Least reception that shrinks I; 1 where packets are held."""
        return 1.0 if self.hold else self.reception

    @property
    def held(self) -> float:
        """Reception of a receiver that holds, as `certify` takes it."""
        return self.reception if self.hold else 1.0

    def certify(
        self,
        gains: Gains,
        rho: float,
        tau_max: float,
        *,
        noise: NoiseStatistics | None = None,
        k_effective: float | None = None,
    ) -> Certificate:
        """Certify a design for the period, latency and reception asked for."""
        return certify(
            gains,
            rho,
            tau_max,
            period=self.period,
            noise=noise,
            reception=self.counted_as_zero,
            k_effective=k_effective,
            held=self.held,
            latency=self.latency,
            v2v_period=self.v2v_period,
        )

    def unmet(self, certificate: Certificate) -> tuple[str, ...]:
        """Say which requirements a design misses that `certify` has certified for them.

        Examples
        --------
        >>> from cacc_platoon.model.control import Gains
        >>> ask = Requirements(latency=0.07)
        >>> ask.unmet(ask.certify(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5))[0]
        'latency margin 0.07336 s at period 0.01 s is below 0.08 s = latency + period'
        """
        missed = []
        if not certificate.string_stable:
            missed.append("not robustly string stable" + self._losing())
        margin = certificate.joint_latency_margin
        if margin < self.latency_margin:
            missed.append(
                f"latency margin {margin:.4g} s at period {self.period:g} s{self._losing()} is "
                f"below {self.latency_margin:.4g} s = latency + period"
            )
        critical = certificate.joint_critical_period
        if critical <= self.period:
            late = f" with a latency of {self.latency:g} s" if self.latency else ""
            missed.append(
                f"critical period {critical:.4g} s{late}{self._losing()} is not above "
                f"{self.period:.4g} s"
            )
        missed += self._missed_rate(certificate)
        if self.min_gap is not None:
            gap = self.worst_gap(certificate)
            if gap < self.min_gap:
                missed.append(
                    f"worst gap {gap:.4g} m of {_FOLLOWERS} followers, in the mean and in "
                    f"continuous time{self._left_out_of_gap()}, is below {self.min_gap:.4g} m"
                )
        for name in ("k_a", "time_headway"):
            given, own = getattr(self, name), getattr(certificate.gains, name)
            if given is not None and own != given:
                missed.append(f"{name} {own:.6g} is not {given:.6g}")
        for value, limit, text, unit in (
            (certificate.gains.time_headway, self.max_headway, "headway", " s"),
            (certificate.linf_gain, self.max_linf, "L-infinity gain", ""),
            (
                certificate.slowest_time_constant,
                self.max_time_constant,
                "slowest time constant",
                " s",
            ),
        ):
            if limit is not None and value > limit * (1.0 + TOLERANCE):
                missed.append(f"{text} {value:.6g}{unit} is above {limit:.6g}{unit}")
        return tuple(missed)

    def meets(self, certificate: Certificate) -> bool:
        """Whether `unmet` has nothing to say, without asking how much packets make grow."""
        return certificate.bears_v2v_period and not self.unmet(certificate)

    def _missed_rate(self, certificate: Certificate) -> list[str]:
        grown = None if certificate.bears_v2v_period else certificate.v2v_growth
        if grown is None:
            return []
        late = f" that comes {self.latency:g} s late" if self.latency else ""
        critical = certificate.critical_v2v_period
        until = f"; up to {critical:.4g} s they do not" if critical else ""
        return [
            f"with a packet every {self.v2v_period:g} s{late}{self._losing()}, all sent at the "
            f"same instants, accelerations grow by {grown.growth:.6g} per hop at "
            f"{grown.omega:.4g} rad/s{until}"
        ]

    def worst_gap(self, certificate: Certificate) -> float:
        """Least gap [m] of the first 12 followers over all brakings, as `min_gap` says.

        Of both ends of I, which losses that count as zero lower, and the lags of `SHARES`.
        """
        gaps = worst_spacing(
            certificate.gains,
            [share * certificate.tau_max for share in SHARES for _ in certificate.interval],
            [*certificate.interval] * len(SHARES),
            standstill_distance=self.standstill_gap,
            speed=self.speed,
            deceleration=self.braking,
            vehicles=_FOLLOWERS,
            steps=10.0,
        )
        return float(np.min(gaps))

    def _left_out_of_gap(self) -> str:
        """Name what is asked for and does not count in the worst gap."""
        parts = {
            "latency": self.latency > 0.0,
            "V2V period": self.v2v_period is not None,
            "losses": self.hold and self.reception < 1.0,
        }
        names = [name for name, asked in parts.items() if asked]
        return f" without {', '.join(names)}" if names else ""

    def _losing(self) -> str:
        if self.reception == 1.0:
            return ""
        return f" at reception {self.reception:g}" + (" with the last packet held" * self.hold)

    def check(self, rho: float, tau_max: float) -> None:
        """Refuse what no design can meet, before one is searched for.

        Raises
        ------
        DesignError
            If a value is out of its range, or a headway below what any gains allow.
        """
        require_rho(rho)
        require(
            math.isfinite(rho),
            "rho = inf leaves the front unbounded. Give a finite SNR, however large.",
        )
        require_positive("tau_max", tau_max, "s")
        require_positive("period", self.period, "s")
        require_reception(self.reception)
        require(
            self.reception > 0 or not self.hold,
            "reception = 0 leaves nothing to hold: no design has V2V then. Give reception > 0, or "
            "count lost packets as zero.",
        )
        require(
            0 <= self.latency < math.inf,
            f"latency = {self.latency:g} s is not a finite, nonnegative time: no margin can cover "
            "it. Give the largest V2V latency in seconds.",
        )
        if self.v2v_period is not None:
            packet_interval(self.v2v_period, self.period)
        require_positive("braking", self.braking, "m/s^2")
        require_positive("speed", self.speed, "m/s")
        require(
            math.isfinite(self.standstill_gap)
            and (self.min_gap is None or 0 <= self.min_gap < self.standstill_gap),
            f"min_gap = {self.min_gap} m is not from 0 to below {self.standstill_gap:g} m, the gap "
            "at rest, to which every stop leads: no design keeps it. Lower min_gap or raise the "
            "standstill gap.",
        )
        for name in ("max_headway", "max_linf", "max_time_constant", "time_headway"):
            value = getattr(self, name)
            if value is not None:
                require_positive(name, value, "" if name == "max_linf" else "s")
        require(
            self.max_linf is None or self.max_linf >= 1,
            f"max_linf = {self.max_linf} is below 1: H(0) = 1, so no design has a smaller gain. "
            "Give max_linf >= 1.",
        )
        self._check_headway(rho, tau_max)

    def _check_headway(self, rho: float, tau_max: float) -> None:
        p = self.counted_as_zero
        share = "" if p == 1.0 else f"{p:g} "
        if self.k_a is not None:
            checked_interval(self.k_a, rho)
            limit = minimum_headway(self.k_a, rho, tau_max, reception=p)
            rule = f"2 tau_0/(1 + {share}(1 - 1/rho) k_a)"
        else:
            limit = infimum_headway(rho, tau_max, reception=p)
            rule = f"2 tau_0/(1 + {share}m/M)" if share else "tau_0 (1 + 1/rho)"
        for name in ("max_headway", "time_headway"):
            value = getattr(self, name)
            require(
                value is None or value > limit,
                f"{name} = {value} s is not above {limit:.6g} s = {rule}: spacing errors grow "
                f"along a platoon for every choice of gains. Raise {name}, lower tau_max or "
                "raise rho.",
            )


@dataclass(frozen=True)
class Design:
    """A design with its certificate, of which the Pareto set trades five or six quantities.

    Attributes
    ----------
    name : str
        Name among the recommended designs, empty on the front.
    certificate : Certificate
        The gains and all they guarantee.
    reason : str
        Why it is recommended.
    unmet : tuple of str
        Requirements it misses, in words.
    """

    name: str
    certificate: Certificate
    reason: str = ""
    unmet: tuple[str, ...] = ()

    @property
    def gains(self) -> Gains:
        """The controller."""
        return self.certificate.gains

    @property
    def costs(self) -> tuple[float, ...]:
        """Headway, -latency margin, -critical period, L-infinity gain, slowest mode.

        With a V2V period of its own, minus the critical one too.
        """
        one = self.certificate
        rate = () if one.v2v_period is None else (-one.critical_v2v_period,)
        return (
            one.gains.time_headway,
            -one.joint_latency_margin,
            -one.joint_critical_period,
            one.linf_gain,
            one.slowest_time_constant,
            *rate,
        )


@dataclass(frozen=True)
class Recommendation:
    """Named designs and the front they were taken from.

    Attributes
    ----------
    rho, tau_max : float
        The question.
    requirements : Requirements
        What was insisted on.
    designs : tuple of Design
        ``paper``, ``shortest``, ``robust``, ``balanced``.
    front : tuple of Design
        Pareto set over headway, latency margin, critical period, L-infinity gain, slowest mode,
        and the critical V2V period where packets have a period of their own.
    """

    rho: float
    tau_max: float
    requirements: Requirements
    designs: tuple[Design, ...]
    front: tuple[Design, ...] = field(repr=False)

    def __getitem__(self, name: str) -> Design:
        """Return the design of that name."""
        for design in self.designs:
            if design.name == name:
                return design
        names = ", ".join(design.name for design in self.designs)
        raise DesignError(
            f"{name!r} is not a recommended design: nothing to return. Take one of {names}."
        )


def assess(
    gains: Gains,
    rho: float,
    tau_max: float,
    requirements: Requirements | None = None,
    *,
    name: str = "",
    reason: str = "",
) -> Design:
    """Certify a design for what is asked, and say which requirements it misses.

    Examples
    --------
    >>> assess(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5, Requirements(max_headway=0.9)).unmet
    ('headway 0.95 s is above 0.9 s',)
    """
    ask = requirements or Requirements()
    certificate = ask.certify(gains, rho, tau_max)
    return Design(name, certificate, reason, ask.unmet(certificate))


def paper_design(rho: float, tau_max: float, *, reception: float = 1.0) -> Gains:
    """Design at the centre of S for ``k_a*`` and a headway 1 % above ``h*``.

    Examples
    --------
    >>> gains = paper_design(5.0, 0.5)
    >>> round(gains.time_headway, 4), round(gains.k_a, 4)
    (0.8814, 0.3183)
    """
    best = optimum(rho, tau_max, reception=reception)
    headway = 1.01 * best.time_headway
    corners = paper_region(best.k_a, headway, rho, tau_max, reception=reception).polygon
    k_p, k_v = np.mean(corners, axis=0).tolist()
    return Gains(headway, best.k_a, k_v, k_p)
