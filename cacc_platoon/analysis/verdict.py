"""String stable or not: a theorem about the run's parameters, never an impression of one run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cacc_platoon.analysis.age import LinkReception
from cacc_platoon.analysis.consistency import Consistency
from cacc_platoon.analysis.noise import LinkNoise
from cacc_platoon.analysis.premises import broken_premises
from cacc_platoon.errors import UserError
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.theory import (
    Certificate,
    Failure,
    Hop,
    certify,
    certify_chain,
    explain_failure,
    is_string_stable,
)

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

ZERO_NAME = (
    "lost packets count as zero: judged is the mean system of every packet reception probability "
    "from p = {:.6g} to 1, k in [p m k_a, M k_a]"
)
HOLD_NAME = (
    "the last packet is held while others are lost: judged is the mean system too, at the packet "
    "reception probability p = {:.6g} and the control period of the run, by the exact test of the "
    "sampled loop with k filtered by p/(1 - (1 - p)/z)"
)

JUDGED_BY = (
    "l2_gain",
    "string_stable",
    "in_paper_region",
    "internally_stable",
    "sampled_string_stable",
    "linf_gain",
)
"""The parts of a certificate that a verdict needs; where one cannot be computed it is undecided."""

_ABSURD = 100.0  # a mean of w that only damaged data can have


class FollowerVerdict(NamedTuple):
    """What holds for one follower's own parameters.

    Attributes
    ----------
    follower : int
        Index.
    certificate : Certificate or None
        What they guarantee, the sampled loop at the scenario's period; None when it could not be
        computed, and then nothing is certified.
    failure : Failure or None
        Why the exact test fails, None when it passes or is undecided.
    undecided : str
        Why there is no certificate, else empty.
    realised_k : float
        k_a times the mean w of this run's link, and times p where losses count as zero; NaN when w
        is unknown.
    realised_stable : bool or None
        The exact test for that k and the follower's own tau; None when w is unknown.
    """

    follower: int
    certificate: Certificate | None
    failure: Failure | None = None
    undecided: str = ""
    realised_k: float = math.nan
    realised_stable: bool | None = None

    @property
    def decided(self) -> bool:
        """Whether there is a certificate."""
        return self.certificate is not None

    @property
    def reason(self) -> str:
        """Which condition fails, or why none could be tested; empty when none fails."""
        return self.failure.condition if self.failure else self.undecided

    @property
    def string_stable(self) -> bool:
        """The exact test, worst over I and tau in (0, tau0]; of the mean system under loss."""
        return self.certificate is not None and self.certificate.string_stable

    @property
    def in_paper_region(self) -> bool:
        """The paper's sufficient test."""
        return self.certificate is not None and self.certificate.in_paper_region

    @property
    def internally_stable(self) -> bool:
        """Routh's test at tau0."""
        return self.certificate is not None and self.certificate.internally_stable

    @property
    def sampled(self) -> bool:
        """The exact test of the loop sampled at the scenario's period."""
        return self.certificate is not None and self.certificate.sampled_string_stable

    @property
    def l2_gain(self) -> float:
        """Worst sup |H|, NaN when undecided."""
        return math.nan if self.certificate is None else self.certificate.l2_gain

    @property
    def peak_frequency(self) -> float:
        """Where sup |H| is [rad/s], NaN when undecided."""
        return math.nan if self.certificate is None else self.certificate.peak_frequency

    @property
    def linf_gain(self) -> float:
        """Largest L-infinity gain of the hop, NaN when undecided."""
        return math.nan if self.certificate is None else self.certificate.linf_gain


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
    reception: list[LinkReception] | None = None,
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

    Examples
    --------
    >>> judge(Scenario.from_values({})).string_stable
    True
    >>> judge(Scenario.from_values({"controller.time_headway": 0.65})).string_stable
    False
    """
    means = {(link.sender, link.follower): link.mean for link in noise or []}
    seen: dict[object, FollowerVerdict] = {}
    verdicts = []
    for follower in scenario.followers:
        mean = means.get(follower.link, math.nan)
        key = (follower.gains, follower.tau_max, follower.v2v.rho, *_reception(follower))
        if key not in seen:
            seen[key] = _judge_follower(follower, scenario.run.step)
        verdicts.append(_realised(seen[key], follower, mean))
    stable = all(verdict.string_stable for verdict in verdicts)
    equal = len(seen) == 1 and len({(f.tau, f.v2v) for f in scenario.followers}) == 1
    law = (
        "delta_i = H delta_{i-1} for i >= 2, equal followers"
        if equal
        else "a_i = H_i a_{i-1} for every follower's own H_i, unequal followers"
    )
    return Verdict(
        stable,
        all(verdict.in_paper_region for verdict in verdicts),
        "; ".join((EXACT_TEST, law, L2_NAME, *loss_bases(scenario))),
        equal,
        (
            *_sampled_too_slowly(verdicts),
            *broken_premises(scenario, noise or [], reception or [], consistency),
        ),
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
    return FollowerVerdict(follower.index, None, undecided=why)


def _decide(follower: Follower, step: float) -> FollowerVerdict:
    zero, held = _reception(follower)
    certificate = certify(
        follower.gains,
        follower.v2v.rho,
        follower.tau_max,
        period=step,
        reception=zero,
        held=held,
    )
    for part in JUDGED_BY:  # what cannot be computed shows here, not when the verdict is read
        getattr(certificate, part)
    return FollowerVerdict(follower.index, certificate, explain_failure(certificate))


def _reception(follower: Follower) -> tuple[float, float]:
    """Return the packet reception probability where losses count as zero, and where one holds."""
    arrives = 1.0 - follower.v2v.loss
    return (1.0, arrives) if follower.v2v.reception == "hold" else (arrives, 1.0)


def loss_bases(scenario: Scenario) -> list[str]:
    """Say what the certificate means where packets may be lost, at the lossiest link."""
    pairs = [_reception(follower) for follower in scenario.followers]
    zero, held = min(pair[0] for pair in pairs), min(pair[1] for pair in pairs)
    return [name.format(p) for name, p in ((ZERO_NAME, zero), (HOLD_NAME, held)) if p < 1.0]


def _sampled_too_slowly(verdicts: list[FollowerVerdict]) -> list[str]:
    """Say that the continuous loops of some followers pass the test and the sampled ones fail."""
    lost = [
        (one.follower, one.certificate)
        for one in verdicts
        if one.certificate is not None and one.string_stable and not one.sampled
    ]
    if not lost:
        return []
    first, certificate = lost[0]
    return [
        f"the loop of vehicle {first}, sampled every {certificate.period:g} s, is not string "
        f"stable; it is below {certificate.critical_period:.4g} s ({len(lost)} vehicles in all): "
        "lower run.step"
    ]


def _realised(verdict: FollowerVerdict, follower: Follower, mean: float) -> FollowerVerdict:
    """Fill in what holds for the mean w that this run had."""
    held = _reception(follower)[1] < 1.0  # one gain does not describe a receiver that holds
    if not verdict.decided or held or not abs(mean) < _ABSURD:
        return verdict._replace(follower=follower.index)
    k = follower.gains.k_a * mean * _reception(follower)[0]
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
    if verdict.string_stable:
        return f"{scenario.name}: {verdict.void[0]}" if verdict.void else None
    if verdict.undecided:
        return f"the gains cannot be certified: {verdict.weakest.reason}"
    failing = [one for one in verdict.followers if one.failure]
    first = failing[0]
    who = "" if len(failing) == len(verdict.followers) else f" (vehicle {first.follower})"
    return (
        f"{scenario.name} is not string stable{who}, sup|H| = {verdict.weakest.l2_gain:.6g}: "
        f"{first.failure}"
    )
