"""Versions of what is written, and the one rule for what is read: older yes, newer no.

A document says `"format": n`; one without was written before formats had versions and counts as 0.
Each format is named and numbered beside its writer; docs/formats has the schemas and the history.
"""

from __future__ import annotations

from typing import NamedTuple

from cacc_platoon import __version__
from cacc_platoon.errors import UserError

_DIGITS = 10


class Format(NamedTuple):
    """A kind of document and the version of it that this software writes.

    Attributes
    ----------
    name : str
        What a document of the kind is called.
    version : int
        The newest version, which is the one that is written.
    """

    name: str
    version: int

    @staticmethod
    def number(text: str) -> int | str:
        """Return what a text says a version is: a number, or the text where it is none."""
        return int(text) if text.isdecimal() and len(text) < _DIGITS else text

    def check(self, found: object, source: str) -> int:
        """Return the version of a document, 0 when it says none.

        Parameters
        ----------
        found : object
            What the document says its version is; None when it says nothing.
        source : str
            The document, for the error line.

        Raises
        ------
        UserError
            When it is newer than what this software knows, or no version at all.

        Examples
        --------
        >>> Format("run.json", 2).check(1, "runs/a/run.json")
        1
        """
        if found is None:
            return 0
        if not isinstance(found, int) or isinstance(found, bool) or found < 1:
            raise UserError(
                f"{source}: format = {found!r} must be a whole number >= 1; as it is, nothing says "
                f"how to read this {self.name}. Restore the file."
            )
        if found > self.version:
            raise UserError(
                f"{source}: format {found} of {self.name} is newer than {self.version}, the newest "
                f"that cacc_platoon {__version__} knows; it could be misread. Read it with the "
                "version that wrote it, or a newer one."
            )
        return found
