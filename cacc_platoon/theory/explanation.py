"""Why a design holds or fails: by value, rule, consequence and remedy, and by its formulas.

The paper's formulas are those of docs/theory.md, section 2 (The paper's theorem, and its slips),
the exact ones those of docs/theory.md, section 3 (The exact test).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.theory.exact import is_string_stable, propagation_margins
from cacc_platoon.theory.noise_interval import effective_interval, k_a_max, snr_db_from_rho
from cacc_platoon.theory.region import exact_region, infimum_headway, minimum_headway
from cacc_platoon.theory.theorem2 import headway_bound, in_paper_region, optimum, paper_region
from cacc_platoon.theory.transfer import gamma, is_internally_stable

if TYPE_CHECKING:
    from cacc_platoon.model.control import Gains
    from cacc_platoon.theory.certificate import Certificate

__all__ = [
    "Failure",
    "explain_bounds",
    "explain_design",
    "explain_failure",
    "explain_verdict",
    "rounded_down",
]


def rounded_down(value: float) -> str:
    """Write a bound to stay below, not above its value, so that who heeds it is below it.

    Examples
    --------
    >>> rounded_down(0.0958683), rounded_down(0.0)
    ('0.09586', '0')
    """
    if not value > 0:
        return "0"
    unit = 10.0 ** (math.floor(math.log10(value)) - 3)
    return f"{math.floor(value / unit) * unit:.4g}"


def explain_bounds(rho: float, tau_max: float, k_a: float, *, reception: float = 1.0) -> list[str]:
    """Write out the bounds that do not need k_v and k_p.

    Examples
    --------
    >>> print(explain_bounds(5.0, 0.5, 0.5)[2])
    paper  h_lb = 2 tau_0 (1 - m k_a)/(1 - M^2 k_a^2) = 2*0.5*(1 - 0.4)/(1 - 0.36) = 0.9375 s
    """
    m, M = effective_interval(1.0, rho, reception=reception)
    low, high = effective_interval(k_a, rho, reception=reception)
    best = optimum(rho, tau_max, reception=reception)
    t = f"{tau_max:g}"
    smallest, least = "1 - 1/rho", f"tau_0 (1 + 1/rho) = {t}*{M:.6g}"
    if reception != 1.0:
        smallest = f"{reception:g} (1 - 1/rho)"
        least = f"2 tau_0/(1 + m/M) = 2*{t}/(1 + {m / M:.6g})"
    lines = [
        f"noise  m = {smallest} = {m:.6g}, M = 1 + 1/rho = {M:.6g} at rho = {rho:.6g} "
        f"({snr_db_from_rho(rho):.4g} dB); k_a E[w] in [m k_a, M k_a] = [{low:.6g}, {high:.6g}]",
        f"cap    k_a < 1/M = {k_a_max(rho):.6g}, excluded (Theorem 2b)",
    ]
    if high < 1:
        paper = headway_bound(k_a, rho, tau_max, reception=reception)
        exact = minimum_headway(k_a, rho, tau_max, reception=reception)
        lines += [
            f"paper  h_lb = 2 tau_0 (1 - m k_a)/(1 - M^2 k_a^2) = 2*{t}*(1 - {low:.6g})/"
            f"(1 - {high * high:.6g}) = {paper:.6g} s",
            f"exact  minimum 2 tau_0/(1 + m k_a) = 2*{t}/(1 + {low:.6g}) = "
            f"{exact:.6g} s, attained with k_p large enough",
        ]
    return [
        *lines,
        f"best   k_a* = {best.k_a:.9g}, h* = {best.time_headway:.9g} s (Theorem 2c, excluded)",
        f"limit  {least} = {infimum_headway(rho, tau_max, reception=reception):.6g} s over all "
        "k_a, not attained",
    ]


def explain_design(
    gains: Gains, rho: float, tau_max: float, *, reception: float = 1.0
) -> list[str]:
    """Write out the paper's region and the exact test for one design.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> print(explain_design(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5)[0])
    Routh  gamma = k_v + h_w k_p = 0.63855 > tau_0 k_p = 0.0045 and k_p > 0: internally stable
    """
    h, k_a, k_v, k_p = gains
    interval = effective_interval(k_a, rho, reception=reception)
    stable = is_internally_stable(gains, tau_max)
    lines = [
        f"Routh  gamma = k_v + h_w k_p = {gamma(gains):.6g} {'>' if stable else 'not >'} "
        f"tau_0 k_p = {tau_max * k_p:.6g} and k_p > 0: "
        f"{'internally stable' if stable else 'NOT internally stable'}"
    ]
    if k_a < k_a_max(rho):
        region = paper_region(k_a, h, rho, tau_max, reception=reception)
        first, second = k_v / region.a1 + k_p / region.b1, k_v / region.a2 + k_p / region.b2
        inside = in_paper_region(gains, rho, tau_max, reception=reception)
        lines += [
            f"paper  S1: k_v/a1 + k_p/b1 = {first:.6g} (must be <= 1), a1 = {region.a1:.6g}, "
            f"b1 = {region.b1:.6g}",
            f"paper  S2: k_v/a2 + k_p/b2 = {second:.6g} (must be >= 1), a2 = {region.a2:.6g}, "
            f"b2 = {region.b2:.6g}: {'in S' if inside else 'not in S'}"
            f"{'' if region.nonempty else ', which is empty (a1 <= a2)'}",
        ]
    for name, k in zip(("m k_a", "M k_a"), interval, strict=True):
        B, C, margin = propagation_margins(gains, tau_max, k)
        good = is_string_stable(gains, tau_max, k)
        lines.append(
            f"exact  k = {name} = {k:.6g}: B = {B:.6g}, C = {C:.6g}, "
            f"B + 2 tau_0 sqrt(C) = {margin:.6g}: {'sup|H| <= 1' if good else 'AMPLIFIES'}"
        )
    return lines


class Failure(NamedTuple):
    """Why a design is not string stable.

    Attributes
    ----------
    condition : str
        The value and the rule it breaks.
    consequence : str
        What then happens to the platoon.
    remedy : str
        What to change.
    """

    condition: str
    consequence: str
    remedy: str

    def __str__(self) -> str:
        """All of it in one line."""
        return f"{self.condition}: {self.consequence}. {self.remedy}."


def explain_verdict(certificate: Certificate) -> str:
    """Say in one line whether a design is string stable; if not, why and what to change.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> from cacc_platoon.theory.certificate import certify
    >>> print(explain_verdict(certify(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5, k_effective=0.524)))
    string stable at tau = 0.5 s and k_a E[w] = 0.524 alone: sup|H| = 1
    """
    failure = explain_failure(certificate)
    if failure is not None:
        return str(failure)
    if certificate.k_effective is not None:
        known = f"string stable {_where(certificate)}: sup|H| = 1"
        return f"{known}{_holding(certificate)}{_sampling(certificate)}{_rate(certificate)}"
    basis = "in the paper's region S" if certificate.in_paper_region else "exact test"
    return (
        f"robustly string stable ({basis}): sup|H| = 1 for every lag up to "
        f"{certificate.tau_max:g} s and all noise of rho >= {certificate.rho:g}"
        f"{_losses(certificate)}; in the mean the energy of a_i, and of delta_i where all links "
        "are equal, does not grow along a platoon."
        f"{_holding(certificate)}{_sampling(certificate)}{_rate(certificate)}"
    )


def _sampling(certificate: Certificate) -> str:
    """Say what a control period takes away from that, where no packets are held."""
    if certificate.held < 1.0 or certificate.sampled_string_stable:
        return ""
    return (
        f" All that in continuous time alone: sampled every {certificate.period:g} s it is not "
        "string stable."
    )


def _rate(certificate: Certificate) -> str:
    """Say what a V2V period of its own takes away from that."""
    grown = certificate.v2v_growth
    if grown is None or grown.growth <= 1.0:
        return ""
    return (
        f" All that with a packet every control period; with one every {certificate.v2v_period:g} "
        f"s accelerations grow by {grown.growth:.6g} per hop."
    )


def explain_failure(certificate: Certificate) -> Failure | None:
    """Name what keeps a design from string stability, None when nothing does.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> from cacc_platoon.theory.certificate import certify
    >>> print(explain_failure(certify(Gains(0.65, 0.5, 0.63, 0.009), 5.0, 0.5)).condition)
    time_headway = 0.65 s is below 0.714286 s = 2 tau_0/(1 + (1 - 1/rho) k_a)
    """
    if certificate.string_stable:
        return None
    if certificate.fails_held:
        return _failure_of_held(certificate)
    failure = _failure_without_loss(certificate)
    if certificate.held == 1.0:
        return failure
    note = "which mends the loop without loss; the one that holds packets is judged after it"
    return failure._replace(remedy=f"{failure.remedy}, {note}")


def _failure_of_held(certificate: Certificate) -> Failure:
    """Explain a loop that fails since it holds lost packets."""
    whole = replace(certificate, held=1.0)
    loop = f"{_received(certificate)}, the mean loop"
    grows = "disturbances grow along a platoon in the mean"
    if not whole.sampled_string_stable:
        longest = whole.critical_period
        also = f" below {rounded_down(longest)} s" if longest else " and raise time_headway"
        return Failure(
            f"{loop} is not string stable at any control period",
            grows,
            f"Lose no packets, lower the control period{also}",
        )
    share = certificate.critical_loss
    fewer = f"less than a share {rounded_down(share)} of the packets" if share else "no packets"
    period = rounded_down(certificate.critical_period)
    slower = "" if period == "0" else f", or lower the control period below {period} s"
    return Failure(
        f"{loop} sampled every {certificate.period:g} s has sup|H_T| > 1",
        grows,
        f"Lose {fewer}{slower}",
    )


def _failure_without_loss(certificate: Certificate) -> Failure:
    """Explain a design that fails the exact test."""
    if certificate.k_effective is not None:
        return _failure_of_one_gain(certificate)
    if certificate.interval.high >= 1:
        cap = k_a_max(certificate.rho)
        return Failure(
            f"k_a = {certificate.gains.k_a:g} is not below {cap:.6g} = 1/(1 + 1/rho)",
            "the noise may raise k_a E[w] to 1, and spacing errors grow along a platoon",
            f"Lower k_a below {cap:.6g} or raise rho",
        )
    return _failure_of_headway(certificate) or _failure_of_gains(certificate)


def _where(certificate: Certificate) -> str:
    return f"at tau = {certificate.tau_max:g} s and k_a E[w] = {certificate.k_effective:.6g} alone"


def _losses(certificate: Certificate) -> str:
    share = certificate.reception
    return "" if share == 1.0 else f" with at least {share:g} of all packets received"


def _received(certificate: Certificate) -> str:
    return f"with a share {certificate.held:.6g} of all packets received and the last one held"


def _holding(certificate: Certificate) -> str:
    """Say what the statement about the loop without loss becomes where packets are held."""
    if certificate.held == 1.0:
        return ""
    stays = "is" if certificate.sampled_string_stable else "is not"
    return (
        f" So much without loss; {_received(certificate)}, the mean loop sampled every "
        f"{certificate.period:g} s {stays} string stable."
    )


def _failure_of_one_gain(certificate: Certificate) -> Failure:
    gains, tau = certificate.gains, certificate.tau_max
    if not certificate.internally_stable:
        return Failure(
            f"gamma = k_v + h_w k_p = {gamma(gains):.6g} is not above tau k_p = "
            f"{tau * gains.k_p:.6g} > 0 {_where(certificate)}",
            "the loop is not internally stable and errors grow in every vehicle",
            "Raise k_v or lower k_p",
        )
    return Failure(
        f"sup|H| = {certificate.l2_gain:.9g} {_where(certificate)} is above 1",
        f"errors near {certificate.peak_frequency:.6g} rad/s grow at every hop",
        "Raise time_headway, or take k_v and k_p from the exact region",
    )


def _failure_of_headway(certificate: Certificate) -> Failure | None:
    """Explain a headway that no k_v and k_p can serve, None where some can."""
    (h, k_a, _, _), rho, tau_max = certificate.gains, certificate.rho, certificate.tau_max
    share = certificate.reception
    shortest = minimum_headway(k_a, rho, tau_max, reception=share)
    if h >= shortest * (1.0 - 1e-12):
        return None
    paper = headway_bound(k_a, rho, tau_max, reception=share)
    loss = "" if share == 1.0 else f"{share:g} "
    rule = f"2 tau_0/(1 + {loss}(1 - 1/rho) k_a)" if share else "2 tau_0, the least without V2V"
    return Failure(
        f"time_headway = {h:g} s is below {shortest:.6g} s = {rule}",
        "spacing errors grow along a platoon whatever k_v and k_p are",
        f"Raise time_headway, above {paper:.6g} s for the paper's gains, or lower tau_max",
    )


def _failure_of_gains(certificate: Certificate) -> Failure:
    """Explain gains outside the exact region at a headway that has one."""
    (h, k_a, k_v, k_p), rho, tau_max = certificate.gains, certificate.rho, certificate.tau_max
    share = certificate.reception
    region = exact_region(k_a, h, rho, tau_max, reception=share)
    if not k_p > 0:
        return Failure(
            f"k_p = {k_p:g} 1/s^2 is not positive",
            "nothing closes the gap and the spacing error stays",
            f"Give k_p > {region.k_p_min:.6g}",
        )
    if k_p < region.k_p_min:
        paper = headway_bound(k_a, rho, tau_max, reception=share)
        return Failure(
            f"k_p = {k_p:g} 1/s^2 is below {region.k_p_min:.6g}, the least that string stability "
            f"needs at time_headway = {h:g} s",
            "no k_v serves both ends of the noise interval, and spacing errors grow along a "
            "platoon",
            f"Raise k_p or raise time_headway above {paper:.6g} s",
        )
    low, high = (float(x) for x in region.bounds(np.float64(k_p)))
    if not math.isfinite(high) or k_v < low:
        condition, remedy = f"below {low:.6g}", f"Raise k_v into [{low:.6g}, {high:.6g}]"
    else:
        condition, remedy = f"above {high:.6g}", f"Lower k_v into [{low:.6g}, {high:.6g}]"
    return Failure(f"k_v = {k_v:g} 1/s is {condition}", _what_grows(certificate), remedy)


def _what_grows(certificate: Certificate) -> str:
    """Name the disturbances that grow, and the condition of the exact test that is broken."""
    gains, tau_max = certificate.gains, certificate.tau_max
    k = next(k for k in certificate.interval if not is_string_stable(gains, tau_max, k))
    _, C, margin = propagation_margins(gains, tau_max, k)
    which, broken = (
        ("slow disturbances", f"C = {C:.4g}")
        if C < 0
        else ("disturbances near the bandwidth", f"B + 2 tau_0 sqrt(C) = {margin:.4g}")
    )
    return f"{which} grow along a platoon ({broken} < 0 at k_a E[w] = {k:.6g})"
