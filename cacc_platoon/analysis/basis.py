"""What each statement of a verdict rests on, in words: which test, of which loop, of whom."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from cacc_platoon.analysis.follower_verdict import PROMPT, WITHOUT_LOSS
from cacc_platoon.analysis.packets import PacketRate, packet_times
from cacc_platoon.analysis.premises import IF_INDEPENDENT, blackouts, holds_in_bursts
from cacc_platoon.scenario import Follower, Scenario

L2_NAME = "L2 string stability (H-infinity norm of H, paper's condition (3))"

_EXACT_TEST = (
    "exact test: C >= 0 and B + 2 tau sqrt(C) >= 0 at both ends of I = {} and tau0, equivalent to "
    "sup|H(jw)| <= 1 for every tau in (0, tau0] and every {} in I"
)
_PAPER_TEST = "paper's Theorem 2: h_w > h_lb(k_a) and (k_p, k_v) in S = S1 and S2, sufficient only"
_LINF_NAME = (
    "L-infinity: L1 norm of the impulse response of H, largest over every tau in (0, tau0] by a "
    "scan, whose bound for the lags between is above, and at both ends of I; bounds the ratio of "
    "peaks of a_i, and of delta_i between followers that are equal, E[w] too, in the mean system "
    "in continuous time: of no noisy run, and of no sampled one, whose peaks grow a little more"
)
_SURE_NAME = (
    "L-infinity: sum of max |h[n]| over {}, of the loop sampled at the control period; largest of "
    "22 lags up to tau0 and the plant without lag; bounds the ratio of peaks of a_i in every run "
    "from follower to follower of equal lags, at control instants, however w changes in time; not "
    "from the leader, whose acceleration may change in between"
)
_ANY_FACTOR = "every w in [1 - 1/rho, 1 + 1/rho] that the noise may have at any instant"
_OR_LOST = f"w = 0, which is a lost packet, and {_ANY_FACTOR}"
_LATE = f"{_ANY_FACTOR}, of any packet sent until then (the last one is held)"
_EQUAL = "delta_i = H delta_{i-1} for i >= 2, equal followers"
_ALONE = "a_i = H a_{i-1} of the only follower"
_UNEQUAL = "a_i = H_i a_{i-1} for every follower's own H_i, unequal followers"
_IF_SO = f", {IF_INDEPENDENT}"
_ZERO = (
    "lost packets count as zero{}: judged is the mean system of every packet reception "
    "probability from p{} to 1, k in [p m k_a, M k_a]"
)
_HOLD = (
    "the last packet is held{} while others are lost: judged is the mean system too, at the packet "
    "reception probability p{} and the control period of the run, by the exact test of the "
    "sampled loop with k filtered by p/(1 - (1 - p)/z), at 22 lags up to tau0, without "
    "lag, and at the worst lags between"
)
_PACKETS = (
    "packets come {}: judged is the mean system too, sampled at the control period of the run, "
    "by the largest growth per hop in the long run over frequency, both ends of I and 5 lags up to "
    "tau0, all links sending at the same instants; numerical "
    "(docs/theory.md, section 7 (V2V latency))"
)
_MOST_NAMED = 6  # vehicles


class Arrival(NamedTuple):
    """Packet reception probability of a follower where losses count as zero, and where one holds.

    Attributes
    ----------
    zero, held : float
        One of them is 1.
    """

    zero: float
    held: float


class LinkBasis(NamedTuple):
    """What is judged of followers that lose packets, and do one thing about it, or get them late.

    Attributes
    ----------
    followers : tuple of int
        Their indices.
    text : str
        The test.
    if_so : str
        What it takes for granted although it is not so, after a comma; empty where nothing is.
    """

    followers: tuple[int, ...]
    text: str
    if_so: str


class Bases(NamedTuple):
    """What the statements of one verdict rest on.

    Attributes
    ----------
    exact : str
        The exact test, with the interval that is judged.
    law : str
        What H carries from one vehicle to the next.
    losses, packets : tuple of LinkBasis
        What is judged of followers that lose packets, and of those that get them rarely or late.
    paper, linf, sure : str
        The paper's test and the gains between peaks, in the mean and for every realisation, and of
        which loop they are.
    of_loop : str
        " of the loop without loss" or "with packets that are prompt", and of whom when not of all;
        empty where nobody holds lost packets and all packets are prompt.
    if_so, apart : str
        ", if losses did not depend on each other" where they come in bursts and the last packet is
        held, and ", blackouts apart" where there are any; else empty.
    """

    exact: str
    law: str
    losses: tuple[LinkBasis, ...]
    packets: tuple[LinkBasis, ...]
    paper: str
    linf: str
    sure: str
    of_loop: str
    if_so: str
    apart: str

    def __str__(self) -> str:
        """Return the exact test and what it decides."""
        return "; ".join(
            (self.exact, self.law, L2_NAME, *(one.text for one in (*self.losses, *self.packets)))
        )


def arrival(follower: Follower) -> Arrival:
    """Return the share of packets that a follower receives, by what it does about lost ones."""
    arrives = 1.0 - follower.mean_loss
    return Arrival(1.0, arrives) if follower.holds else Arrival(arrives, 1.0)


def bases_of(scenario: Scenario, *, equal: bool) -> Bases:
    """Say what the verdict about a scenario rests on.

    Examples
    --------
    >>> lossy = Scenario.from_values({"v2v.loss": 0.3, "v2v.reception": "zero"})
    >>> "I = [p m k_a, M k_a]" in bases_of(lossy, equal=True).exact
    True
    """
    everyone = scenario.indices
    shares = {follower.index: arrival(follower) for follower in scenario.followers}
    zero = {index: share.zero for index, share in shares.items() if share.zero < 1.0}
    held = {index: share.held for index, share in shares.items() if share.held < 1.0}
    bursts = {f.index: held[f.index] for f in scenario.followers if holds_in_bursts(f)}
    steady = {index: share for index, share in held.items() if index not in bursts}
    losses = tuple(
        LinkBasis(
            tuple(some), f"{text.format(_at(tuple(some), everyone), _share(some))}{if_so}", if_so
        )
        for text, some, if_so in ((_ZERO, zero, ""), (_HOLD, steady, ""), (_HOLD, bursts, _IF_SO))
        if some
    )
    packets = _packets(scenario)
    late = [index for basis in packets for index in basis.followers]
    parts = ((WITHOUT_LOSS, held), (PROMPT, late))
    loops = [f"{what}{_at(tuple(some), everyone)}" for what, some in parts if some]
    of_loop = f" of the loop {' and '.join(loops)}" if loops else ""
    interval = ", with the I of the exact test" if zero else ""
    return Bases(
        _exact_test(zero, everyone),
        _ALONE if len(everyone) == 1 else _EQUAL if equal else _UNEQUAL,
        losses,
        packets,
        f"{_PAPER_TEST}{interval}{of_loop and ',' + of_loop}",
        f"{_LINF_NAME}{of_loop and ';' + of_loop}",
        _SURE_NAME.format(_LATE if held or late else _OR_LOST if zero else _ANY_FACTOR),
        of_loop,
        _IF_SO if bursts else "",
        ", blackouts apart" if blackouts(scenario) else "",
    )


def _packets(scenario: Scenario) -> tuple[LinkBasis, ...]:
    """Say what is judged of followers whose packets are rare or late, those alike together."""
    found: dict[tuple[PacketRate, bool], list[int]] = {}
    for follower in scenario.followers:
        times = packet_times(follower, scenario.run.step)
        if times.period is not None:
            found.setdefault((times, follower.triggered), []).append(follower.index)
    bases = []
    for (times, triggered), some in found.items():
        if_so = _IF_SO if any(holds_in_bursts(scenario.follower(index)) for index in some) else ""
        text = _PACKETS.format(f"{_rate(times, triggered)}{_at(tuple(some), scenario.indices)}")
        bases.append(LinkBasis(tuple(some), f"{text}{if_so}", if_so))
    return tuple(bases)


def _rate(times: PacketRate, triggered: bool) -> str:
    taken = " (so they are taken here: they are sent as the sender moves)" if triggered else ""
    return str(times).removeprefix("a packet ") + taken


def _exact_test(zero: dict[int, float], everyone: Sequence[int]) -> str:
    if not zero:
        return _EXACT_TEST.format("[m k_a, M k_a]", "k_a E[w]")
    whose = _at(tuple(zero), everyone)
    rest = f"{whose}, and p = 1 elsewhere" if whose else ""
    return (
        _EXACT_TEST.format("[p m k_a, M k_a]", "k")
        + f", with the packet reception probability p{_share(zero)}{rest}"
    )


def _share(shares: dict[int, float]) -> str:
    least = min(shares, key=shares.__getitem__)
    if len(set(shares.values())) == 1:
        return f" = {shares[least]:.6g}"
    return f" of each (least {shares[least]:.6g}, vehicle {least})"


def _at(some: Sequence[int], everyone: Sequence[int]) -> str:
    """Name some of the followers, by nothing when they are all."""
    if len(some) == len(everyone):
        return ""
    if len(some) == 1:
        return f" at vehicle {some[0]}"
    named = ", ".join(str(index) for index in some[:_MOST_NAMED])
    more = f" and {len(some) - _MOST_NAMED} more" if len(some) > _MOST_NAMED else ""
    return f" at vehicles {named}{more}"
