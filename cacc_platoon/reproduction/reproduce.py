"""The paper beside our runs of its three cases."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cacc_platoon.reproduction.claims import Claim, claims

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
    """

    reports: Mapping[str, Report]
    claims: list[Claim]

    @property
    def agrees(self) -> bool:
        """Whether every statement agrees, from data that stand."""
        return all(claim.agrees for claim in self.claims) and not self.unsound

    @property
    def unsound(self) -> dict[str, Standing]:
        """The cases whose data do not stand, and how they do."""
        standings = {name: report.standing for name, report in self.reports.items()}
        return {name: one for name, one in standings.items() if not one.stands}

    @property
    def headline(self) -> str:
        """The result in a few words."""
        agreeing = sum(claim.agrees for claim in self.claims)
        words = f"{agreeing} of {len(self.claims)} statements of the paper agree"
        return ", ".join([words, *(f"{s.headline} of case {n}" for n, s in self.unsound.items())])


def reproduce(reports: Mapping[str, Report]) -> Reproduction:
    """Compare the reports of the three cases with the paper."""
    return Reproduction(reports, claims(reports))
