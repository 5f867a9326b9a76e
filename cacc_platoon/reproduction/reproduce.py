"""The paper beside our runs of its three cases."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cacc_platoon.reproduction.claim import Claim
from cacc_platoon.reproduction.claims import claims
from cacc_platoon.reproduction.journal import journal_claims
from cacc_platoon.reproduction.model_slips import model_slips
from cacc_platoon.reproduction.slip import Slip
from cacc_platoon.reproduction.theorem_slips import theorem_slips

if TYPE_CHECKING:
    from cacc_platoon.analysis import Report, Standing


@dataclass(frozen=True)
class Reproduction:
    """The paper beside our runs.

    Attributes
    ----------
    reports : Mapping of str to Report
        Of the cases A, B and C.
    claims : list of Claim
        Statement by statement.
    journal : list of Claim
        What its journal version shows; a question does not count.
    slips : list of Slip
        Where the paper slips or leaves something open.
    """

    reports: Mapping[str, Report]
    claims: list[Claim]
    journal: list[Claim]
    slips: list[Slip]

    @property
    def agrees(self) -> bool:
        """Whether every statement of both versions agrees, from data that stand."""
        both = (*self.claims, *self.journal)
        return not any(map(_disagrees, both)) and not self.unsound

    @property
    def complete(self) -> bool:
        """Whether every statement agrees and every slip is shown."""
        return self.agrees and all(slip.shown for slip in self.slips)

    @property
    def unsound(self) -> dict[str, Standing]:
        """The cases whose data do not stand, and how they do."""
        standings = {name: report.standing for name, report in self.reports.items()}
        return {name: one for name, one in standings.items() if not one.stands}

    @property
    def headline(self) -> str:
        """The result in a few words."""
        agreeing = sum(bool(claim.agrees) for claim in self.claims)
        words = [f"{agreeing} of {len(self.claims)} statements of the paper agree"]
        if far := sum(map(_disagrees, self.journal)):
            words.append(f"{far} of its journal version do not")
        if unseen := sum(not slip.shown for slip in self.slips):
            words.append(f"{unseen} of {len(self.slips)} slips are not shown")
        return ", ".join([*words, *(f"{s.headline} of case {n}" for n, s in self.unsound.items())])

    @property
    def journal_line(self) -> str:
        """What the journal version adds to the result, in a few words."""
        read = [claim.agrees for claim in self.journal if claim.agrees is not None]
        questions = len(self.journal) - len(read)
        asked = f"; {questions} cannot be compared and is a question" if questions else ""
        return f"{sum(read)} of {len(read)} figures of the journal version agree as read{asked}"


def reproduce(reports: Mapping[str, Report]) -> Reproduction:
    """Compare the reports of the three cases with the paper and its journal version."""
    mean = reports["A"].measured.noise[0].expected_mean
    slips = [*theorem_slips(mean), *model_slips(reports)]
    return Reproduction(reports, claims(reports), journal_claims(reports), slips)


def _disagrees(claim: Claim) -> bool:
    """Return whether both sides differ; a question does not."""
    return claim.agrees is not None and not claim.agrees
