"""The paper beside our runs of its three cases."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cacc_platoon.reproduction.claims import Claim, claims

if TYPE_CHECKING:
    from cacc_platoon.analysis import Report


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
        """Whether every statement agrees."""
        return all(claim.agrees for claim in self.claims)

    @property
    def headline(self) -> str:
        """The result in a few words."""
        agreeing = sum(claim.agrees for claim in self.claims)
        return f"{agreeing} of {len(self.claims)} statements of the paper agree"


def reproduce(reports: Mapping[str, Report]) -> Reproduction:
    """Compare the reports of the three cases with the paper."""
    return Reproduction(reports, claims(reports))
