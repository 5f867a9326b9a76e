"""An answer as text for a terminal."""

from __future__ import annotations

import math
from typing import Any

__all__ = ["render"]

_TABLE = (
    ("h_w [s]", "time_headway"),
    ("k_a", "k_a"),
    ("k_v [1/s]", "k_v"),
    ("k_p [1/s2]", "k_p"),
    ("latency [s]", "latency_margin"),
    ("period [s]", "critical_period"),
    ("L-inf", "linf_gain"),
    ("slowest [s]", "slowest_time_constant"),
)


def render(data: dict[str, Any]) -> str:
    """Lay out an answer of `cacc_platoon.design.question`.

    Examples
    --------
    >>> from cacc_platoon.design import Question, Requirements, answer
    >>> data, _ = answer(Question(5.0, 0.5, Requirements(k_a=0.5), recommend=False))
    >>> print(render(data).splitlines()[0])
    Question     rho = 5 (13.98 dB), tau_0 = 0.5 s, k_a = 0.5 (cap 0.833333)
    """
    lines = _bound_lines(data)
    if "known_gain" in data:
        known = data["known_gain"]
        lines.append(
            f"One gain     at k_a E[w] = {known['k_effective']:.6g} alone: headway >= "
            f"{_number(known['headway'])} s = 2 tau_0/(1 + k_a E[w]); all above is for every gain "
            "in I"
        )
    if "certificate" in data:
        lines += ["", *_certificate_lines(data)]
        alone = data.get("known_gain")
        lines += _guarantee_lines(
            data["certificate"],
            f"at tau = {data['tau0']:g} s and k_a E[w] = {alone['k_effective']:.6g} alone"
            if alone
            else "for every lag up to tau_0 and all links alike",
        )
        lines += _chance_lines(data.get("chance"))
        missed = data["unmet"]
        lines += [f"Requirements {'; '.join(missed) if missed else 'all met'}"]
    if "mixed_traffic" in data:
        lines += _mixed_lines(data["mixed_traffic"])
    if "extensions" in data:
        lines += ["", *_extension_lines(data["extensions"])]
    if "recommended" in data:
        lines += ["", *_recommendation_lines(data["recommended"])]
    return "\n".join(lines)


def _number(value: float | None) -> str:
    return "inf" if value is None else f"{value:.6g}"


def _bound_lines(data: dict[str, Any]) -> list[str]:
    bound, best, region = data["headway_bound"], data["optimal"], data["region"]
    exact, given_away = data["exact_region"], data["conservatism"]
    headway = f"at h_w = {data['time_headway']:.6g} s"
    area = f", area {region['area']:.4e} 1/s^3" if region["nonempty"] else ""
    return [
        f"Question     rho = {data['rho']:.6g} ({data['snr_db']:.4g} dB), tau_0 = "
        f"{data['tau0']:g} s, k_a = {data['k_a']:.6g} (cap {data['k_a_max']:.6g})",
        f"Headway      paper > {bound['paper']:.6g} s, exact >= {bound['exact']:.6g} s "
        f"(paper/exact {given_away['headway']:.4g}); without V2V {data['fallback_headway']:g} s",
        f"Best         k_a* = {best['k_a']:.6g}, h* = {best['headway']:.6g} s; infimum over all "
        f"k_a {data['infimum_headway']:.6g} s",
        f"Paper's S    {'not empty' if region['nonempty'] else 'empty'} {headway}: a1 "
        f"{region['a1']:.6g}, b1 {region['b1']:.6g}, a2 {region['a2']:.6g}, b2 "
        f"{region['b2']:.6g}{area}",
        f"Exact region {'not empty' if exact['nonempty'] else 'empty'} {headway}"
        + (
            f": k_p >= {exact['k_p_min']:.6g} 1/s^2, S is {100 * given_away['area']:.3g} % of it"
            if exact["nonempty"] and region["nonempty"]
            else f": k_p >= {exact['k_p_min']:.6g} 1/s^2"
            if exact["nonempty"]
            else ""
        ),
    ]


def _certificate_lines(data: dict[str, Any]) -> list[str]:
    c, gains = data["certificate"], data["gains"]
    sampled, joint = c["sampled"], c["joint"]
    late = f"{joint['latency']:g} s and " if joint["latency"] else ""
    aged = f"with an acceleration {late}one period old"
    tolerated = c["gain_range"]
    names = ", ".join(f"{name} = {value:.6g}" for name, value in gains.items())
    return [
        f"Design       {names}",
        f"Verdict      {data['verdict']}",
        f"  internally stable {_yes(c['internally_stable'])}, in the paper's S "
        f"{_yes(c['in_paper_region'])}, string stable {_yes(c['string_stable'])}",
        f"  L2 gain {_number(c['l2_gain'])} at {_number(c['peak_frequency'])} rad/s, in the mean; "
        f"margins C = {_number(c['margins']['C'])} 1/s^2, B + 2 tau_0 sqrt(C) = "
        f"{_number(c['margins']['margin'])}",
        f"  sampled at {sampled['period']:g} s: string stable {_yes(sampled['string_stable'])}; "
        f"lost at {sampled['critical_period']:.4g} s",
        f"  constant V2V latency margin {_number(c['latency_margin'])} s in continuous time, "
        f"{_number(joint['latency_margin'])} s at period {joint['period']:g} s; {aged} the "
        f"period is lost at {joint['critical_period']:.4g} s",
        *_rate_lines(c.get("v2v_period")),
        *_ring_lines(c, alone="known_gain" in data),
        f"  slowest mode {_number(c['slowest_time_constant'])} s; tolerated k_a E[w] "
        + (f"{tolerated[0]:.6g} to {tolerated[1]:.6g}" if tolerated else "none"),
        f"  |delta_i(t)| <= {_number(c['leader_error_norm'])} ||a_0||_2 "
        + ("for every i" if c["string_stable"] else "for i = 1 alone, as it is not string stable")
        + ", in the mean, in continuous time with fresh packets",
    ]


def _rate_lines(rate: dict[str, Any] | None) -> list[str]:
    """Say what becomes of a platoon whose packets have a period of their own."""
    if rate is None:
        return []
    grows = rate["growth_per_hop"]
    grown = (
        "accelerations do not grow"
        if grows == 1
        else f"accelerations GROW by {_number(grows)} per hop at {rate['frequency']:.4g} rad/s"
    )
    phases, longest = rate["phases"], rate["critical_period"]
    shifted = (
        f"{_number(phases['growth_per_hop'])} per hop when each vehicle sends {phases['step']} "
        "control periods after its predecessor"
        if phases["step"]
        else "no more when each vehicle sends later than its predecessor, by any of the numbers of "
        "control periods tried"
    )
    until = f"they begin to above {_number(longest)} s" if longest != 0 else "they do at any period"
    return [
        f"  a packet every {rate['period']:g} s, held: {grown}, in the mean, all sent at the same "
        f"instants; {until}",
        f"    they grow by {shifted}" if phases["step"] else f"    they grow {shifted}",
        f"  |a_12|_2 <= {_number(rate['end_to_end_gain'])} |a_0|_2, also of signals so fast that "
        "they fall between packets",
    ]


def _ring_lines(certificate: dict[str, Any], *, alone: bool) -> list[str]:
    """Say with how many vehicles a ring of them is unstable."""
    if not certificate["internally_stable"]:
        return []
    ring = "  a ring of vehicles, in continuous time with fresh packets:"
    first = certificate["ring"]["first_unstable"]
    if first is None:
        return [f"{ring} stable with every number of them"]
    which = "this k_a E[w]" if alone else "the worse end of I"
    return [f"{ring} UNSTABLE with {first}, stable with fewer, at tau_0 and {which}"]


def _mixed_lines(mixed: dict[str, Any]) -> list[str]:
    """Say which share of connected vehicles is enough among human drivers."""
    human, share = mixed["human"], mixed["least_share"]
    drivers = (
        f"human drivers (k_v = {human['k_v']:g} 1/s, k_p = {human['k_p']:g} 1/s^2, headway "
        f"{human['time_headway']:g} s, delay {human['delay']:g} s)"
    )
    if share is None:
        return [f"Mixed        with {drivers}: no share is enough, connected vehicles amplify too"]
    omega = mixed["frequency"]
    slow = f"motions of {omega:.4g} rad/s" if omega else "slow motions"
    enough = (
        "any share"
        if share == 0.0
        else f"every share of connected vehicles from {math.ceil(1e4 * share) / 1e4:.4f} on "
        f"({slow} ask for it)"
    )
    return [
        f"Mixed        in random order with {drivers}: nothing grows, almost surely, for {enough}"
    ]


def _guarantee_lines(certificate: dict[str, Any], where: str) -> list[str]:
    """Say what is guaranteed in the mean, in the mean square, and whatever the noise does."""
    rows, period = certificate["guarantees"], certificate["sampled"]["period"]
    but = "but for the energy of a_i in the mean square and packet rates"
    lines = [f"Guaranteed, {where}, in continuous time {but}"]
    for row in rows:
        lines.append(f"  {row['signal']}")
        lines += [
            f"    {how:24s}{row[key]}"
            for how, key in (
                ("in the mean", "mean"),
                ("in the mean square", "mean_square"),
                ("whatever the noise does", "sure"),
            )
            if row[key] != "-"
        ]
    peaks = certificate["peaks"]["sure_sampled"]
    return [
        *lines,
        f"  sampled at {period:g} s, peaks of a_i grow between followers by a factor of at most "
        f"{_number(peaks)} per hop whatever the noise does",
    ]


def _chance_lines(chance: dict[str, Any] | None) -> list[str]:
    """Say how likely a link amplifies whose noise is drawn once, and what headway that takes."""
    if chance is None:
        return []
    return [
        f"Noise drawn once per link (16 bits, the paper's probabilities; in continuous time, each "
        f"packet used at once): a link amplifies with "
        f"probability {chance['amplifying']:.4g}; with at most {chance['probability']:g} from a "
        f"headway of {_number(chance['headway'])} s on, never from "
        f"{_number(chance['worst_headway'])} s on"
    ]


def _yes(value: bool) -> str:
    return "yes" if value else "NO"


def _extension_lines(data: dict[str, Any]) -> list[str]:
    lines = []
    if "predecessors" in data:
        r = data["predecessors"]
        lines.append(
            f"Predecessors {r['count']}, k_a = {r['k_a']:.6g} each (cap {r['k_a_max']:.6g}): "
            f"headway paper > {r['paper']:.6g} s, by sum |H_j| <= 1 >= {r['exact']:.6g} s; "
            f"k_a* = {r['optimal_k_a']:.6g}, h* = {r['optimal_headway']:.6g} s"
        )
        if "growth" in r:
            lines.append(
                f"             growth per vehicle {_number(r['growth'])} (exact, equal E[w_j]); "
                f"sum of |H_j| at most {_number(r['sum_of_gains'])} (1 is sufficient, also where "
                "E[w_j] differ)"
            )
            heard = [f"{i} heard {_number(x)}" for i, x in enumerate(r["first_followers"], start=1)]
            if any(x is None or x > 1.0 for x in r["first_followers"]):
                lines.append(
                    "             the first followers hear fewer and amplify with these gains: "
                    f"sup|H| with {', '.join(heard)}; give them gains of their own"
                )
        lines.append(
            "             all else is for the equivalent one-predecessor platoon, but recommended "
            "gains are per predecessor"
        )
    if "reception" in data:
        p = data["reception"]
        held = "= {:g}, the last packet held" if p["lost"] == "hold" else ">= {:g}, lost is zero"
        held = held.format(p["probability"])
        stable = f"; string stable {_yes(p['string_stable'])}" if "string_stable" in p else ""
        lines.append(
            f"Reception    p {held}: k_a E[w] from {p['effective_gain'][0]:.6g}, "
            f"exact headway >= {p['minimum_headway']:.6g} s{stable}"
        )
    return lines


def _recommendation_lines(designs: list[dict[str, Any]]) -> list[str]:
    rate = "critical_v2v_period" in designs[0]
    table = (*_TABLE[:6], ("V2V [s]", "critical_v2v_period"), *_TABLE[6:]) if rate else _TABLE
    header = f"{'Recommended':12s}" + "".join(f"{title:>13s}" for title, _ in table)
    lines = [header]
    for design in designs:
        values = {**design, **design["gains"]}
        row = "".join(
            f"{'inf' if values[key] is None else format(values[key], '.4g'):>13s}"
            for _, key in table
        )
        lines.append(f"{design['name']:12s}{row}")
    lines.append(
        "(latency, constant, and period: where the loop with all that is asked is lost, the period "
        "with an acceleration one period older than the latency"
        + ("; V2V: the longest time between packets at which nothing grows)" if rate else ")")
    )
    for design in designs:
        unmet = f". MISSES: {'; '.join(design['unmet'])}" if design["unmet"] else ""
        lines.append(f"  {design['name']}: {design['reason']}{unmet}")
    return lines
