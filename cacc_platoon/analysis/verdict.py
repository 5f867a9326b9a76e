"""String stable or not: a theorem about the run's parameters, never an impression of one run."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cacc_platoon.analysis.age import LinkReception
from cacc_platoon.analysis.basis import Bases, arrival, bases_of
from cacc_platoon.analysis.consistency import Consistency
from cacc_platoon.analysis.follower_verdict import FollowerVerdict
from cacc_platoon.analysis.guarantee import (
    guarantee_of,
    noise_statistics,
    of_alone,
    of_unequal,
)
from cacc_platoon.analysis.noise import LinkNoise
from cacc_platoon.analysis.packets import packet_times
from cacc_platoon.analysis.premises import (
    Conduct,
    broken_premises,
    holds_again,
    missed_by_the_loop,
    other_laws,
)
from cacc_platoon.errors import UserError
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.theory import (
    Guarantee,
    Hop,
    certify,
    certify_chain,
    explain_failure,
    guarantees,
    is_string_stable,
)

JUDGED_BY = (
    "l2_gain",
    "string_stable",
    "in_paper_region",
    "internally_stable",
    "sampled_string_stable",
    "v2v_growth",
)
"""The parts of a certificate that a verdict needs; where one cannot be computed it is undecided."""

_ABSURD = 100.0  # a mean of w that only damaged data can have


@dataclass(frozen=True)
class Verdict:
    """The judgement of a run's parameters, and whether the run kept what it rests on.

    Attributes
    ----------
    string_stable : bool
        Every follower passes the exact test.
    in_paper_region : bool
        Every follower passes the paper's sufficient test.
    bases : Bases
        What the statements rest on.
    equal_lags : bool
        Whether all vehicles have the same lag.
    equal_links : bool
        Whether delta_i = H delta_{i-1} holds; with unequal followers the test certifies
        a_i = H_i a_{i-1} instead.
    another_law : bool
        Whether some follower has another control law, of which nothing is certified.
    void : tuple of str
        Why the certificate does not apply to this run; empty when it does.
    holds_from : float or None
        When the last blackout ends, or the last vehicle that fell back comes back [s], from which
        on it holds again of what the leader does; None where that is not all that voids it, or the
        run ends before.
    followers : tuple of FollowerVerdict
        One by one.
    weakest : FollowerVerdict
        A follower that fails before one that is undecided, then one that grows once sampled or
        with its packets, then the one with the largest sup |H|, then the one that loses most
        packets, then the one with the smaller least margin.
    end_to_end_gain : float
        sup |H_1 ... H_N| at each follower's own tau and the realised k; NaN where w is unknown.
    """

    string_stable: bool
    in_paper_region: bool
    bases: Bases
    equal_lags: bool
    equal_links: bool
    another_law: bool
    void: tuple[str, ...]
    holds_from: float | None
    followers: tuple[FollowerVerdict, ...]
    weakest: FollowerVerdict
    end_to_end_gain: float

    @property
    def basis(self) -> str:
        """The test and the definition it decides."""
        return str(self.bases)

    @property
    def alone(self) -> bool:
        """Whether there is one follower, and no hop but that from the leader to it."""
        return len(self.followers) == 1

    @property
    def hop(self) -> str:
        """Which hops ratios are of, those from a leader that does as it likes left aside."""
        if self.alone:
            return "of a platoon of such followers"
        return "between followers" if self.equal_lags else "between followers of equal lags"

    @property
    def certified(self) -> bool:
        """Whether string stability is proven for this run: stable, and nothing void."""
        return self.string_stable and not self.void

    @property
    def apart(self) -> str:
        """What statements about every run leave out, after a comma; empty where nothing."""
        return ", what voids the certificate apart" if self.void else ""

    @property
    def of_law(self) -> str:
        """Of which law answers are, after a comma, where it is not everybody's; else empty."""
        return ", of the law of headway and gains" if self.another_law else ""

    @property
    def afterwards(self) -> str:
        """From when on it holds again, and of what; empty where it never was void or stays so."""
        if self.holds_from is None:
            return ""
        return (
            f"from {self.holds_from:g} s on, when that is over, the statement about the mean "
            "system holds again of what the leader does from then on; what was left of it comes on "
            "top, and dies away"
        )

    @property
    def undecided(self) -> bool:
        """Whether no follower fails the exact test, but some one's gains cannot be certified."""
        return not self.string_stable and not self.weakest.decided

    @property
    def linf_gain(self) -> float:
        """The largest ratio of peaks of a mean hop, NaN where one is unknown."""
        return float(np.max([one.linf_gain for one in self.followers]))

    @property
    def sure_gain(self) -> float:
        """The largest ratio of peaks of a_i at a hop for every realisation, NaN if unknown."""
        return float(np.max([one.sure_gain for one in self.followers]))

    @property
    def guarantee(self) -> str:
        """What is proven, of which signal, in which norm, for which noise and links."""
        good = self.string_stable and not self.another_law
        certificates = [one.certificate for one in self.followers if good and one.certificate]
        said = guarantee_of(
            certificates,
            equal_links=self.equal_links,
            equal_lags=self.equal_lags,
            alone=self.alone,
        )
        if self.another_law:
            return "nothing is guaranteed: not every vehicle follows the law of headway and gains"
        if said.startswith("nothing"):
            return said
        return f"{'by design, void for this run: ' * bool(self.void)}{said}{self.bases.if_so}"

    @property
    def guarantees(self) -> tuple[Guarantee, ...]:
        """What the weakest follower guarantees against which noise; nothing if undecided."""
        certificate = self.weakest.certificate
        if certificate is None or self.another_law:
            return ()
        rows = guarantees(certificate, equal_links=self.equal_links)
        if self.alone:
            return tuple(of_alone(row, certificate) for row in rows)
        if self.equal_links:
            return rows
        everyone = [one.certificate for one in self.followers if one.certificate]
        return tuple(of_unequal(row, everyone) for row in rows)

    @property
    def headline(self) -> str:
        """The verdict in a few words."""
        if self.undecided or self.another_law:
            return "NOT CERTIFIED"
        if not self.string_stable:
            return "NOT STRING STABLE"
        return "STRING STABLE" if not self.void else "STRING STABLE BY DESIGN, CERTIFICATE VOID"


def judge(
    scenario: Scenario,
    noise: list[LinkNoise] | None = None,
    consistency: Consistency | None = None,
    reception: list[LinkReception] | None = None,
    conduct: Conduct | None = None,
) -> Verdict:
    """Judge a scenario, and with what its run showed, the run.

    Parameters
    ----------
    scenario : Scenario
        The parameters.
    noise : list of LinkNoise, optional
        Realised noise of the links.
    consistency : Consistency, optional
        Whether the run obeys the equations.
    reception : list of LinkReception, optional
        What arrived over the links.
    conduct : Conduct, optional
        Who fell back to a law without V2V, and on whom limits acted.

    Examples
    --------
    >>> judge(Scenario.from_values({})).string_stable
    True
    >>> judge(Scenario.from_values({"controller.time_headway": 0.65})).string_stable
    False
    """
    conduct, first = conduct or Conduct(), scenario.at_first
    means = {(link.sender, link.follower): link.mean for link in noise or []}
    seen: dict[object, FollowerVerdict] = {}
    verdicts: list[FollowerVerdict] = []
    for follower in first.followers:
        mean = means.get(follower.link, math.nan)
        key = (
            follower.gains,
            follower.tau_max,
            follower.v2v.rho,
            *arrival(follower),
            packet_times(follower, scenario.run.step),
            noise_statistics(follower, scenario.run.step),
        )
        if key not in seen:
            seen[key] = _judge_follower(follower, scenario.run.step)
        verdicts.append(_realised(seen[key], follower, mean))
    stable = all(verdict.string_stable for verdict in verdicts)
    equal = len(seen) == 1 and len({(f.tau, f.v2v, f.law_name) for f in first.followers}) == 1
    void = (
        *missed_by_the_loop(first, verdicts, equal=equal),
        *broken_premises(scenario, noise or [], reception or [], consistency, conduct),
    )
    return Verdict(
        stable,
        all(verdict.in_paper_region for verdict in verdicts),
        bases_of(first, equal=equal),
        len({follower.tau for follower in scenario.followers}) == 1,
        equal,
        bool(other_laws(scenario)),
        void,
        holds_again(scenario, conduct, void) if stable else None,
        tuple(verdicts),
        _weakest(first, verdicts),
        _end_to_end(first, verdicts),
    )


def _judge_follower(follower: Follower, step: float) -> FollowerVerdict:
    """Judge by the parameters alone; gains too extreme to compute with are left undecided."""
    try:
        with np.errstate(all="ignore"):  # what overflows is refused or fails its test
            return _decide(follower, step)
    except UserError as error:
        why = str(error)
    except (ArithmeticError, ValueError) as error:
        why = f"the equations overflow ({error}). Choose gains nearer to 1/tau and 1/tau^2."
    return FollowerVerdict(follower.index, None, undecided=why)


def _decide(follower: Follower, step: float) -> FollowerVerdict:
    share, packets = arrival(follower), packet_times(follower, step)
    certificate = certify(
        follower.gains,
        follower.v2v.rho,
        follower.tau_max,
        period=step,
        reception=share.zero,
        held=share.held,
        noise=noise_statistics(follower, step),
        latency=packets.latency,
        v2v_period=packets.period,
    )
    for part in JUDGED_BY:  # what cannot be computed shows here, not when the verdict is read
        getattr(certificate, part)
    return FollowerVerdict(follower.index, certificate, explain_failure(certificate))


def _weakest(scenario: Scenario, verdicts: list[FollowerVerdict]) -> FollowerVerdict:
    def weakness(one: FollowerVerdict) -> tuple[bool, bool, bool, float, float, float]:
        loss, sampled = scenario.follower(one.follower).v2v.loss, one.lost_with_packets
        return not one.string_stable, one.decided, sampled, one.l2_gain, loss, -min(one.margins)

    return max(verdicts, key=weakness)


def _realised(verdict: FollowerVerdict, follower: Follower, mean: float) -> FollowerVerdict:
    """Fill in what holds for the mean w that this run had."""
    share = arrival(follower)
    several = verdict.holds or verdict.rare_or_late  # no one gain describes such a receiver
    if not verdict.decided or several or not abs(mean) < _ABSURD:
        return verdict._replace(follower=follower.index)
    k = follower.gains.k_a * mean * share.zero
    return verdict._replace(
        follower=follower.index,
        realised_k=k,
        realised_stable=is_string_stable(follower.gains, follower.tau, k),
    )


def _end_to_end(scenario: Scenario, verdicts: list[FollowerVerdict]) -> float:
    links = [
        Hop(follower.gains, follower.tau, verdict.realised_k)
        for follower, verdict in zip(scenario.followers, verdicts, strict=True)
    ]
    if not all(math.isfinite(link.k_effective) for link in links):
        return math.nan
    try:
        return certify_chain(links).end_to_end_gain
    except UserError:  # one link's own lag is out of reach though tau0 was not
        return math.nan


def warn_if_not_string_stable(scenario: Scenario) -> str | None:
    """Return the one-line warning for gains that are not string stable, None when they are.

    Examples
    --------
    >>> warn_if_not_string_stable(Scenario.from_values({})) is None
    True
    """
    verdict = judge(scenario)
    if verdict.another_law or (verdict.void and verdict.string_stable):
        return f"{scenario.name}: {verdict.void[0]}"
    if verdict.string_stable:
        return None
    if verdict.undecided:
        return f"the gains cannot be certified: {verdict.weakest.reason}"
    weakest = verdict.weakest
    who = "" if verdict.equal_links else f" (vehicle {weakest.follower})"
    gain = f"sup|H| = {weakest.l2_gain:.6g}{weakest.of_loop}"
    return f"{scenario.name} is not string stable{who}, {gain}: {weakest.failure}"
