"""One design question and its whole answer, as plain data ready for JSON."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from cacc_platoon.design.answer_json import (
    FORMAT,
    certificate_document,
    conservatism_document,
    design_document,
    exact_region_document,
    gains_document,
    mixed_traffic_document,
    predecessors_document,
    region_document,
)
from cacc_platoon.design.recommend import recommend
from cacc_platoon.design.requirements import Design, Recommendation, Requirements
from cacc_platoon.model.control import Gains
from cacc_platoon.theory.certificate import Certificate
from cacc_platoon.theory.chance_constrained import (
    amplifying_probability,
    chance_constrained_headway,
)
from cacc_platoon.theory.errors import DesignError, require
from cacc_platoon.theory.explanation import explain_verdict
from cacc_platoon.theory.human_driver import HumanDriver
from cacc_platoon.theory.mean_square import NoiseStatistics
from cacc_platoon.theory.mixed_traffic import ConnectedVehicles, least_connected_share
from cacc_platoon.theory.noise_interval import effective_interval, k_a_max, snr_db_from_rho
from cacc_platoon.theory.packet_loss import fallback_headway
from cacc_platoon.theory.region import (
    conservatism,
    exact_region,
    infimum_headway,
    minimum_headway,
)
from cacc_platoon.theory.several_predecessors import (
    equivalent_gains,
    first_followers_gains,
    multi_predecessor_bounds,
    multi_predecessor_gains,
    several_predecessors_growth,
)
from cacc_platoon.theory.theorem2 import headway_bound, optimum, paper_region

__all__ = ["Question", "answer"]


@dataclass(frozen=True)
class Question:
    """What a user asks `answer`; None leaves a value open.

    Attributes
    ----------
    rho : float
        Linear signal-to-noise ratio, > 1.
    tau_max : float
        Largest actuation lag [s].
    requirements : Requirements
        Given gain and headway, period, latency and limits.
    k_v, k_p : float or None
        With ``k_a`` and headway of the requirements they make a design to certify for them.
    k_effective : float or None
        Certify for this effective gain at `tau_max` only.
    noise : NoiseStatistics
        For the mean-square index.
    bit_probabilities : tuple of float
        The channel's, most significant bit first, for `chance`.
    chance : float or None
        Probability with which a link may amplify whose noise is drawn once.
    recommend : bool
        Whether to search for designs.
    predecessors : int
        Number of predecessors received, 1 for the paper's platoon. Gains, headways and limits are
        those of the equivalent one-predecessor platoon, see `for_predecessors`.
    human : HumanDriver or None
        The drivers of all other vehicles, for the share of connected ones that mixed traffic needs.
    """

    rho: float
    tau_max: float
    requirements: Requirements = dataclasses.field(default_factory=Requirements)
    k_v: float | None = None
    k_p: float | None = None
    k_effective: float | None = None
    noise: NoiseStatistics = dataclasses.field(default_factory=NoiseStatistics)
    bit_probabilities: tuple[float, ...] = ()
    chance: float | None = None
    recommend: bool = True
    predecessors: int = 1
    human: HumanDriver | None = None

    def for_predecessors(self, count: int) -> Question:
        """Restate a question on a platoon with `count` predecessors as its equivalent one.

        Gains, headway and longest headway of the question are then per predecessor.
        """
        unit = equivalent_gains(Gains(1.0, 1.0, 1.0, 1.0), count)

        def scaled(value: float | None, factor: float) -> float | None:
            return None if value is None else value * factor

        ask = self.requirements
        return dataclasses.replace(
            self,
            predecessors=count,
            k_v=scaled(self.k_v, unit.k_v),
            k_p=scaled(self.k_p, unit.k_p),
            requirements=dataclasses.replace(
                ask,
                k_a=scaled(ask.k_a, unit.k_a),
                time_headway=scaled(ask.time_headway, unit.time_headway),
                max_headway=scaled(ask.max_headway, unit.time_headway),
            ),
        )

    @property
    def reception(self) -> float:
        """Least reception that shrinks I."""
        return self.requirements.counted_as_zero

    @property
    def k_a(self) -> float:
        """Given feed-forward gain, else the paper's ``k_a*``."""
        given = self.requirements.k_a
        if given is not None:
            return given
        return optimum(self.rho, self.tau_max, reception=self.reception).k_a

    @property
    def time_headway(self) -> float:
        """Given headway [s], else 1 % above the paper's bound."""
        given = self.requirements.time_headway
        if given is not None:
            return given
        return 1.01 * headway_bound(self.k_a, self.rho, self.tau_max, reception=self.reception)

    @property
    def gains(self) -> Gains | None:
        """The design to certify, None while a part of it is open."""
        ask = self.requirements
        if None in (ask.k_a, ask.time_headway, self.k_v, self.k_p):
            return None
        return Gains(self.time_headway, self.k_a, float(self.k_v or 0), float(self.k_p or 0))


def answer(question: Question) -> tuple[dict[str, Any], Recommendation | None]:
    """Answer a question in full.

    Returns
    -------
    dict
        Plain data; what is infinite or does not exist is None. Keys: ``format rho snr_db tau0 k_a
        k_a_max time_headway headway_bound optimal infimum_headway region exact_region
        conservatism``, and where asked ``known_gain chance certificate verdict unmet
        mixed_traffic extensions recommended front``; docs/formats/design.schema.json has them all.
    Recommendation or None
        The designs found.

    Raises
    ------
    DesignError
        If a value is out of its range, or no design meets the requirements.

    Examples
    --------
    >>> data, _ = answer(Question(5.0, 0.5, Requirements(k_a=0.5), recommend=False))
    >>> round(data["headway_bound"]["paper"], 6), round(data["headway_bound"]["exact"], 6)
    (0.9375, 0.714286)
    """
    _check(question)
    data = _bounds(question)
    ask = question.requirements
    gains = question.gains
    if gains is not None:
        certificate = ask.certify(
            gains,
            question.rho,
            question.tau_max,
            noise=question.noise,
            k_effective=question.k_effective,
        )
        data["gains"] = gains_document(gains)
        data["certificate"] = certificate_document(certificate)
        data["verdict"] = explain_verdict(certificate)
        data["unmet"] = list(ask.unmet(certificate))
        if question.human is not None:
            data["mixed_traffic"] = _mixed_traffic(question.human, certificate)
    if question.chance is not None and gains is not None:
        data["chance"] = _chance(question, gains, question.chance)
    if question.k_effective is not None:
        data["known_gain"] = _known_gain(question.k_effective, question.tau_max)
    if question.predecessors != 1 or ask.reception != 1.0:
        data["extensions"] = _extensions(question, data)
    found = recommend(question.rho, question.tau_max, ask) if question.recommend else None
    if found is not None:
        data["recommended"] = [_design_values(design, question) for design in found.designs]
        data["front"] = [_design_values(design, question) for design in found.front]
    return _finite(data), found


def _check(question: Question) -> None:
    """Refuse what has no one meaning together."""
    ask, k = question.requirements, question.k_effective
    require(
        ask.min_gap is None or question.predecessors == 1,
        f"min_gap with {question.predecessors} predecessors is not known: the first followers are "
        "other hops, and gaps at rest differ. Leave min_gap out.",
    )
    require(
        question.chance is None or 0.0 <= question.chance < 1.0,
        f"chance = {question.chance} is not from 0 to below 1: no share of links can be. Give the "
        "probability with which a link may amplify.",
    )
    require(
        question.chance is None or (question.predecessors, ask.reception) == (1, 1.0),
        "chance is of links that lose nothing, with one predecessor: others have another law. "
        "Leave it out.",
    )
    require(
        question.human is None or question.gains is not None,
        "human drivers without a whole design have no traffic to be mixed with: no share can be "
        "computed. Give --k-a, --time-headway, --k-v and --k-p, or leave --human out.",
    )
    require(
        question.human is None or question.predecessors == 1,
        f"human drivers among vehicles with {question.predecessors} predecessors are not known: "
        "which of them are heard depends on the order. Leave --human or --predecessors out.",
    )
    require(
        k is None or ask.reception == 1.0,
        f"k_effective = {k} with reception = {ask.reception:g} says twice what arrives. Leave one "
        "of them out.",
    )
    require(
        k is None or k <= effective_interval(question.k_a, question.rho).high * (1.0 + 1e-12),
        f"k_effective = {k} is above (1 + 1/rho) k_a: no noise of this SNR makes it of k_a = "
        f"{question.k_a:g}. Lower k_effective or raise k_a.",
    )


def _mixed_traffic(human: HumanDriver, certificate: Certificate) -> dict[str, Any]:
    vehicles = ConnectedVehicles(
        certificate.gains,
        certificate.tau_max,
        certificate.effective_gains,
        shorter_lags=certificate.k_effective is None,
    )
    return mixed_traffic_document(human, least_connected_share(vehicles, human))


def _known_gain(k: float, tau_max: float) -> dict[str, float]:
    """Return the least headway of one known effective gain, Theorem 1 (b): below one."""
    headway = 2.0 * tau_max / (1.0 + k) if k < 1 else math.inf
    return {"k_effective": k, "headway": headway}


def _chance(question: Question, gains: Gains, chance: float) -> dict[str, float]:
    """Return how likely a link amplifies whose noise never changes, and headways for these gains.

    No headway is infinite: it does not exist.
    """
    asked = (gains, question.rho, question.tau_max, question.bit_probabilities)

    def headway(probability: float) -> float:
        try:
            return chance_constrained_headway(*asked, probability)
        except DesignError:
            return math.inf

    found = {"probability": chance, "amplifying": amplifying_probability(*asked)}
    return {**found, "headway": headway(chance), "worst_headway": headway(0.0)}


def _bounds(question: Question) -> dict[str, Any]:
    rho, tau_max, k_a, p = question.rho, question.tau_max, question.k_a, question.reception
    headway = question.time_headway
    paper = paper_region(k_a, headway, rho, tau_max, reception=p)
    exact = exact_region(k_a, headway, rho, tau_max, reception=p)
    best = optimum(rho, tau_max, reception=p)
    return {
        "format": FORMAT.version,
        "rho": rho,
        "snr_db": snr_db_from_rho(rho),
        "tau0": tau_max,
        "k_a": k_a,
        "k_a_max": k_a_max(rho),
        "time_headway": headway,
        "effective_gain": list(effective_interval(k_a, rho, reception=p)),
        "headway_bound": {
            "paper": headway_bound(k_a, rho, tau_max, reception=p),
            "exact": minimum_headway(k_a, rho, tau_max, reception=p),
        },
        "optimal": {"k_a": best.k_a, "headway": best.time_headway},
        "infimum_headway": infimum_headway(rho, tau_max, reception=p),
        "fallback_headway": fallback_headway(tau_max),
        "region": region_document(paper),
        "exact_region": exact_region_document(exact),
        "conservatism": conservatism_document(
            conservatism(k_a, headway, rho, tau_max, reception=p)
        ),
    }


def _extensions(question: Question, answered: dict[str, Any]) -> dict[str, Any]:
    rho, tau_max, k_a, gains = question.rho, question.tau_max, question.k_a, question.gains
    data: dict[str, Any] = {}
    if question.predecessors != 1:
        r = question.predecessors
        bounds = multi_predecessor_bounds(k_a / r, rho, tau_max, r)
        data["predecessors"] = predecessors_document(r, k_a / r, bounds)
        if gains is not None:
            each = multi_predecessor_gains(gains, r)
            data["predecessors"]["gains"] = gains_document(each)
            ends = [k / r for k in answered["effective_gain"]]
            found = [several_predecessors_growth(each, tau_max, [k] * r) for k in ends]
            data["predecessors"]["growth"] = max(growth for growth, _ in found)
            data["predecessors"]["sum_of_gains"] = max(total for _, total in found)
            first = [first_followers_gains(each, tau_max, k, r) for k in ends]
            worst = [max(pair) for pair in zip(*first, strict=True)]
            data["predecessors"]["first_followers"] = worst
            answered["unmet"] += [
                f"follower {i} hears {i} of {r} vehicles and amplifies, sup|H| = {gain:.6g}"
                for i, gain in enumerate(worst, start=1)
                if gain > 1.0
            ]
    ask = question.requirements
    if ask.reception != 1.0:
        data["reception"] = {
            "probability": ask.reception,
            "lost": "hold" if ask.hold else "zero",
            "effective_gain": answered["effective_gain"],
            "minimum_headway": answered["headway_bound"]["exact"],
        }
        if "certificate" in answered:
            data["reception"]["string_stable"] = answered["certificate"]["string_stable"]
    return data


def _design_values(design: Design, question: Question) -> dict[str, Any]:
    return design_document(design, multi_predecessor_gains(design.gains, question.predecessors))


def _finite(value: Any) -> Any:
    """Replace infinite numbers by None, which JSON knows."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
