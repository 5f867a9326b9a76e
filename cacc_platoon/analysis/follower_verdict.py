"""What holds for one follower's own parameters, and of which loop its gains are."""

from __future__ import annotations

import math
from typing import NamedTuple

from cacc_platoon.errors import UserError
from cacc_platoon.theory import Certificate, Failure

AS_JUDGED, WITHOUT_LOSS = "as judged", "without loss"
PROMPT = "with packets that are prompt"


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
        is unknown, and where the last packet is held.
    realised_stable : bool or None
        The exact test for that k and the follower's own tau; None when there is no such k.
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
    def remedy(self) -> str:
        """What to change where a condition fails, else empty; `undecided` says its own."""
        return self.failure.remedy if self.failure else ""

    @property
    def string_stable(self) -> bool:
        """The exact test, worst over I and tau in (0, tau0]; of the mean system under loss."""
        return self.certificate is not None and self.certificate.string_stable

    @property
    def loop(self) -> str:
        """Which loop its gains and the paper's test are of.

        That is the loop without loss where the last packet is held, and the one with a packet
        every control period, at once, where they are rare or late: those are judged by the sampled
        loop too.
        """
        parts = ((WITHOUT_LOSS, self.holds), (PROMPT, self.rare_or_late))
        return ", ".join(part for part, has in parts if has) or AS_JUDGED

    @property
    def of_loop(self) -> str:
        """Of which loop its gains are, for a sentence, where it is not the one that is judged."""
        return "" if self.loop == AS_JUDGED else f" of the loop {self.loop}"

    @property
    def holds(self) -> bool:
        """Whether it holds the last packet while others are lost."""
        return self.certificate is not None and self.certificate.held < 1.0

    @property
    def rare_or_late(self) -> bool:
        """Whether packets come to it less often than every control period, or late."""
        return self.certificate is not None and self.certificate.v2v_period is not None

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
    def lost_with_packets(self) -> bool:
        """Whether a loop that passes the exact test grows once sampled, or with its packets."""
        if self.certificate is None or not self.string_stable:
            return False
        growth = self.certificate.v2v_growth
        return not self.sampled or (growth is not None and growth.growth > 1.0)

    @property
    def l2_gain(self) -> float:
        """Worst sup |H|, NaN when undecided."""
        return math.nan if self.certificate is None else self.certificate.l2_gain

    @property
    def peak_frequency(self) -> float:
        """Where sup |H| is [rad/s], NaN when undecided."""
        return math.nan if self.certificate is None else self.certificate.peak_frequency

    @property
    def margins(self) -> tuple[float, float]:
        """Least C [1/s^2] and least B + 2 tau0 sqrt(C) over I, NaN when undecided."""
        return (math.nan, math.nan) if self.certificate is None else self.certificate.margins

    @property
    def gain(self) -> str:
        """The worst sup |H| in words, with the margins, since it is 1 of every stable design."""
        (C, margin), of_loop = self.margins, self.of_loop
        if self.certificate is None or not self.certificate.internally_stable:
            return f"sup|H| = {self.l2_gain:.9g}{of_loop}"
        return (
            f"sup|H| = {self.l2_gain:.9g}{of_loop}, margins C = {C:.4g} 1/s^2 and "
            f"B + 2 tau0 sqrt(C) = {margin:.4g}"
        )

    @property
    def linf_gain(self) -> float:
        """Largest ratio of peaks of the mean hop, over all lags and I; NaN when unknown."""
        return self._known("linf_gain")

    @property
    def sure_gain(self) -> float:
        """Largest ratio of peaks of a_i for every realisation, sampled; NaN when unknown."""
        return self._known("sampled_sure_gain")

    def _known(self, part: str) -> float:
        """Return a part that nothing else of a verdict rests on."""
        try:
            return math.nan if self.certificate is None else float(getattr(self.certificate, part))
        except (UserError, ArithmeticError):
            return math.nan
