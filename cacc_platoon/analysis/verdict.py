"""String stable or not: a theorem about the run's parameters, never an impression of one run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cacc_platoon.analysis.consistency import Consistency
from cacc_platoon.analysis.noise import LinkNoise
from cacc_platoon.analysis.reasons import (
    broken_premises,
    failing_condition,
    paper_bound_hint,
    sampled_too_slowly,
)
from cacc_platoon.errors import UserError
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.theory import (
    Link,
    certify_chain,
    in_paper_region,
    is_internally_stable,
    is_robustly_string_stable,
    is_sampled_string_stable,
    is_string_stable,
    linf_gain,
    worst_l2_gain,
)
from cacc_platoon.theory.noise_interval import effective_interval

EXACT_TEST = (
    "exact test: C >= 0 and B + 2 tau sqrt(C) >= 0 at both ends of I = [m k_a, M k_a] and tau0, "
    "equivalent to sup|H(jw)| <= 1 for every tau in (0, tau0] and every k_a E[w] in I"
)
PAPER_TEST = "paper's Theorem 2: h_w > h_lb(k_a) and (k_p, k_v) in S = S1 and S2, sufficient only"
L2_NAME = "L2 string stability (H-infinity norm of H, paper's condition (3))"
LINF_NAME = (
    "L-infinity: L1 norm of the impulse response of H, at tau0 and both ends of I; bounds the "
    "ratio of peaks of a_i, and of delta_i between equal followers"
)

_ABSURD = 100.0  # a mean of w that only damaged data can have


class FollowerVerdict(NamedTuple):
    """What holds for one follower's own parameters.

    Attributes
    ----------
    follower : int
        Index.
    string_stable, in_paper_region, internally_stable, sampled : bool
        Exact test, paper's test, Routh, and the exact test of the sampled loop at period T; all
        worst over I and tau in (0, tau0].
    l2_gain, peak_frequency : float
        sup |H| over them and where [rad/s].
    linf_gain : float
        Largest L1 norm of the impulse response at tau0 and both ends of I.
    realised_k : float
        k_a times the mean w of this run's link; NaN when w could not be told.
    realised_stable : bool or None
        The exact test for that k and the follower's own tau; None when w could not be told.
    reason : str
        Which condition fails, empty when none does.
    decided : bool
        Whether the numbers above could be computed; when not, nothing is certified and `reason`
        says why.
    """

    follower: int
    string_stable: bool
    in_paper_region: bool
    internally_stable: bool
    sampled: bool
    l2_gain: float
    peak_frequency: float
    linf_gain: float
    realised_k: float
    realised_stable: bool | None
    reason: str
    decided: bool = True


@dataclass(frozen=True)
class Verdict:
    """The judgement of a run's parameters, and whether the run kept what it rests on.

    Attributes
    ----------
    string_stable : bool
        Every follower passes the exact test.
    in_paper_region : bool
        Every follower passes the paper's sufficient test.
    basis : str
        The test and the definition it decides.
    equal_links : bool
        Whether delta_i = H delta_{i-1} holds; with unequal followers the test certifies
        a_i = H_i a_{i-1} instead.
    void : tuple of str
        Why the certificate does not apply to this run; empty when it does.
    followers : tuple of FollowerVerdict
        One by one.
    weakest : FollowerVerdict
        A follower that fails before one that is undecided, then the one with the largest sup |H|.
    end_to_end_gain : float
        sup |H_1 ... H_N| at each follower's own tau and the realised k; NaN where w is unknown.
    """

    string_stable: bool
    in_paper_region: bool
    basis: str
    equal_links: bool
    void: tuple[str, ...]
    followers: tuple[FollowerVerdict, ...]
    weakest: FollowerVerdict
    end_to_end_gain: float

    @property
    def certified(self) -> bool:
        """Whether string stability is proven for this run: stable, and nothing void."""
        return self.string_stable and not self.void

    @property
    def undecided(self) -> bool:
        """Whether no follower fails the exact test, but some one's gains cannot be certified."""
        return not self.string_stable and not self.weakest.decided

    @property
    def linf_gain(self) -> float:
        """The largest L-infinity gain of a hop, NaN where one is unknown."""
        return float(np.max([one.linf_gain for one in self.followers]))

    @property
    def headline(self) -> str:
        """The verdict in a few words."""
        if self.undecided:
            return "NOT CERTIFIED"
        if not self.string_stable:
            return "NOT STRING STABLE"
        return "STRING STABLE" if not self.void else "STRING STABLE BY DESIGN, CERTIFICATE VOID"


def judge(
    scenario: Scenario,
    noise: list[LinkNoise] | None = None,
    consistency: Consistency | None = None,
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

    Examples
    --------
    >>> judge(Scenario.from_values({})).string_stable
    True
    >>> judge(Scenario.from_values({"controller.time_headway": 0.65})).string_stable
    False
    """
    means = {link.follower: link.mean for link in noise or []}
    seen: dict[object, FollowerVerdict] = {}
    verdicts = []
    for follower in scenario.followers:
        mean = means.get(follower.index, math.nan)
        key = (follower.gains, follower.tau_max, follower.v2v.rho)
        if key not in seen:
            seen[key] = _judge_follower(follower, scenario.run.step)
        verdicts.append(_realised(seen[key], follower, mean))
    stable = all(verdict.string_stable for verdict in verdicts)
    lost = [one.follower for one in verdicts if one.string_stable and not one.sampled]
    equal = len(seen) == 1 and len({(f.tau, f.v2v) for f in scenario.followers}) == 1
    law = (
        "delta_i = H delta_{i-1} for i >= 2, equal followers"
        if equal
        else "a_i = H_i a_{i-1} for every follower's own H_i, unequal followers"
    )
    return Verdict(
        stable,
        all(verdict.in_paper_region for verdict in verdicts),
        f"{EXACT_TEST}; {law}; {L2_NAME}",
        equal,
        (*sampled_too_slowly(scenario, lost), *broken_premises(noise or [], consistency)),
        tuple(verdicts),
        max(verdicts, key=lambda one: (not one.string_stable, one.decided, one.l2_gain)),
        _end_to_end(scenario, verdicts),
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
    unknown = (math.nan, math.nan, math.nan, math.nan)
    return FollowerVerdict(
        follower.index, False, False, False, False, *unknown, None, why, decided=False
    )


def _decide(follower: Follower, step: float) -> FollowerVerdict:
    gains, rho, tau_max = follower.gains, follower.v2v.rho, follower.tau_max
    worst = worst_l2_gain(gains, rho, tau_max)
    ends = effective_interval(gains.k_a, rho)
    return FollowerVerdict(
        follower.index,
        is_robustly_string_stable(gains, rho, tau_max),
        in_paper_region(gains, rho, tau_max),
        is_internally_stable(gains, tau_max),
        is_sampled_string_stable(gains, rho, tau_max, step),
        worst.gain,
        worst.peak_omega,
        max(linf_gain(gains, tau_max, k) for k in ends),
        math.nan,
        None,
        failing_condition(follower),
    )


def _realised(verdict: FollowerVerdict, follower: Follower, mean: float) -> FollowerVerdict:
    """Fill in what holds for the mean w that this run had."""
    if not verdict.decided or not abs(mean) < _ABSURD:
        return verdict._replace(follower=follower.index)
    k = follower.gains.k_a * mean
    return verdict._replace(
        follower=follower.index,
        realised_k=k,
        realised_stable=is_string_stable(follower.gains, follower.tau, k),
    )


def _end_to_end(scenario: Scenario, verdicts: list[FollowerVerdict]) -> float:
    links = [
        Link(follower.gains, follower.tau, verdict.realised_k)
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
    if verdict.string_stable:
        return f"{scenario.name}: {verdict.void[0]}. Lower run.step." if verdict.void else None
    if verdict.undecided:
        return f"the gains cannot be certified: {verdict.weakest.reason}"
    failing = [one.follower for one in verdict.followers if one.decided and not one.string_stable]
    followers = scenario.followers
    place = scenario.indices.index(failing[0])
    bound = paper_bound_hint(followers[place])
    who = "" if len(failing) == len(followers) else f" (vehicle {failing[0]})"
    return (
        f"{scenario.name} is not string stable{who}: {verdict.followers[place].reason}; "
        f"disturbances may grow along the platoon, sup|H| = {verdict.weakest.l2_gain:.6g}.{bound}"
    )
