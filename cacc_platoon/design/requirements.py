"""Designs with the quantities that a choice trades, and the requirements they must meet."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from cacc_platoon.model.control import Gains
from cacc_platoon.theory.errors import DesignError
from cacc_platoon.theory.exact import is_robustly_string_stable, linf_gain
from cacc_platoon.theory.latency import latency_margin
from cacc_platoon.theory.noise_interval import effective_interval
from cacc_platoon.theory.sampled import critical_period
from cacc_platoon.theory.theorem2 import optimum, paper_region
from cacc_platoon.theory.transfer import slowest_time_constant

__all__ = ["Design", "Recommendation", "Requirements", "assess", "paper_design"]


@dataclass(frozen=True)
class Requirements:
    """What the user insists on; None leaves the choice to the designer.

    Attributes
    ----------
    period : float
        Control period [s]. The loop must be string stable at it with an acceleration one period
        old.
    latency : float
        V2V latency [s]. The margin must cover it plus the one period a message may wait.
    max_headway : float or None
        Longest headway [s]; default ``2.5 tau_max``.
    max_linf : float or None
        Largest L-infinity gain, >= 1.
    max_time_constant : float or None
        Slowest mode allowed [s].
    k_a, time_headway : float or None
        Values that are given.
    """

    period: float = 0.01
    latency: float = 0.0
    max_headway: float | None = None
    max_linf: float | None = None
    max_time_constant: float | None = None
    k_a: float | None = None
    time_headway: float | None = None

    @property
    def latency_margin(self) -> float:
        """Latency margin [s] that the requirements amount to."""
        return self.latency + self.period


@dataclass(frozen=True)
class Design:
    """A design with the five quantities that the Pareto set trades.

    Attributes
    ----------
    name : str
        Name among the recommended designs, empty on the front.
    gains : Gains
        The design.
    string_stable : bool
        Exact robust test.
    latency_margin, critical_period : float
        Worst case [s]; the period with an acceleration one period old.
    linf_gain : float
        Largest at `tau_max` over both ends of I.
    slowest_time_constant : float
        At `tau_max` [s].
    reason : str
        Why it is recommended.
    unmet : tuple of str
        Requirements it misses, in words.
    """

    name: str
    gains: Gains
    string_stable: bool
    latency_margin: float
    critical_period: float
    linf_gain: float
    slowest_time_constant: float
    reason: str = ""
    unmet: tuple[str, ...] = ()

    @property
    def costs(self) -> tuple[float, float, float, float, float]:
        """Headway, -latency margin, -critical period, L-infinity gain, slowest mode."""
        return (
            self.gains.time_headway,
            -self.latency_margin,
            -self.critical_period,
            self.linf_gain,
            self.slowest_time_constant,
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
        Pareto set over headway, latency margin, critical period, L-infinity gain, slowest mode.
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
    """Certify what the Pareto set trades, and say which requirements are missed.

    Examples
    --------
    >>> design = assess(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5, Requirements(latency=0.1))
    >>> design.unmet
    ('latency margin 0.08175 s is below 0.11 s = latency + period',)
    """
    ask = requirements or Requirements()
    linf = max(linf_gain(gains, tau_max, k) for k in effective_interval(gains.k_a, rho))
    design = Design(
        name,
        gains,
        is_robustly_string_stable(gains, rho, tau_max),
        latency_margin(gains, rho, tau_max),
        critical_period(gains, rho, tau_max, stale=True),
        linf,
        slowest_time_constant(gains, tau_max),
        reason,
    )
    return replace(design, unmet=tuple(_unmet(design, ask)))


def _unmet(design: Design, ask: Requirements) -> list[str]:
    missed = [] if design.string_stable else ["not robustly string stable"]
    headway = design.gains.time_headway
    if design.latency_margin < ask.latency_margin:
        missed.append(
            f"latency margin {design.latency_margin:.4g} s is below {ask.latency_margin:.4g} s "
            "= latency + period"
        )
    if design.critical_period <= ask.period:
        missed.append(
            f"critical period {design.critical_period:.4g} s is not above {ask.period:.4g} s"
        )
    for value, limit, text, unit in (
        (headway, ask.max_headway, "headway", " s"),
        (design.linf_gain, ask.max_linf, "L-infinity gain", ""),
        (design.slowest_time_constant, ask.max_time_constant, "slowest time constant", " s"),
    ):
        if limit is not None and value > limit:
            missed.append(f"{text} {value:.6g}{unit} is above {limit:.6g}{unit}")
    return missed


def paper_design(rho: float, tau_max: float) -> Gains:
    """Design at the centre of S for ``k_a*`` and a headway 1 % above ``h*``.

    Examples
    --------
    >>> gains = paper_design(5.0, 0.5)
    >>> round(gains.time_headway, 4), round(gains.k_a, 4)
    (0.8814, 0.3183)
    """
    best = optimum(rho, tau_max)
    headway = 1.01 * best.time_headway
    corners = paper_region(best.k_a, headway, rho, tau_max).polygon
    k_p, k_v = np.mean(corners, axis=0).tolist()
    return Gains(headway, best.k_a, k_v, k_p)
