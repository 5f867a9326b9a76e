"""Refuse a request that no design can meet, before searching for one."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from cacc_platoon.theory.errors import require, require_positive, require_rho
from cacc_platoon.theory.noise_interval import checked_interval
from cacc_platoon.theory.region import infimum_headway, minimum_headway

if TYPE_CHECKING:
    from cacc_platoon.design.requirements import Requirements

__all__ = ["check_request"]


def check_request(rho: float, tau_max: float, ask: Requirements) -> None:
    """Check every value of a request, and its headway against the exact minimum.

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
    require_positive("period", ask.period, "s")
    require(
        0 <= ask.latency < math.inf,
        f"latency = {ask.latency:g} s is not a finite, nonnegative time: no margin can cover it. "
        "Give the largest V2V latency in seconds.",
    )
    for name in ("max_headway", "max_linf", "max_time_constant", "time_headway"):
        value = getattr(ask, name)
        if value is not None:
            require_positive(name, value, "" if name == "max_linf" else "s")
    require(
        ask.max_linf is None or ask.max_linf >= 1,
        f"max_linf = {ask.max_linf} is below 1: H(0) = 1, so no design has a smaller gain. Give "
        "max_linf >= 1.",
    )
    _check_headway(rho, tau_max, ask)


def _check_headway(rho: float, tau_max: float, ask: Requirements) -> None:
    if ask.k_a is not None:
        checked_interval(ask.k_a, rho)
        limit, rule = minimum_headway(ask.k_a, rho, tau_max), "2 tau_0/(1 + (1 - 1/rho) k_a)"
    else:
        limit, rule = infimum_headway(rho, tau_max), "tau_0 (1 + 1/rho)"
    for name in ("max_headway", "time_headway"):
        value = getattr(ask, name)
        require(
            value is None or value > limit,
            f"{name} = {value} s is not above {limit:.6g} s = {rule}: spacing errors grow along "
            f"the platoon for every choice of gains. Raise {name}, lower tau_max or raise rho.",
        )
