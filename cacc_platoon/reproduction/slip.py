"""One place where the paper slips, or leaves something open, with what shows it."""

from __future__ import annotations

from typing import NamedTuple


class Slip(NamedTuple):
    """One place where the paper slips or leaves something open.

    Attributes
    ----------
    where : str
        Where in the paper.
    paper : str
        What it says, or leaves unsaid.
    holds : str
        What holds instead.
    check : str
        What was computed to show it.
    shown : bool
        Whether that shows it.
    """

    where: str
    paper: str
    holds: str
    check: str
    shown: bool
