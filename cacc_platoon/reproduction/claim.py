"""One statement of the paper beside ours."""

from __future__ import annotations

from typing import NamedTuple


class Claim(NamedTuple):
    """One statement of the paper beside ours.

    Attributes
    ----------
    where : str
        Where the paper makes it.
    what : str
        The quantity, with its unit.
    paper : str
        As the paper has it.
    measured : str
        As computed or measured here.
    agrees : bool or None
        Whether both say the same, to the digits the paper gives; None where that is a question.
    basis : str
        What our side rests on.
    """

    where: str
    what: str
    paper: str
    measured: str
    agrees: bool | None
    basis: str


def yes(holds: bool) -> str:
    """Return a truth in words."""
    return "yes" if holds else "no"
