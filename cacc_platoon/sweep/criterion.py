"""What a study asks of every row: a value by its name in metrics.json, and what it has to be."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from typing import Any, NamedTuple

from cacc_platoon.errors import UserError

_COMPARISONS: Mapping[str, Callable[[float, float], bool]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    ">": operator.gt,
}
_OVER_LISTS: Mapping[str, Callable[[list[float]], float]] = {"max": max, "min": min}
_STEP = re.compile(r"\.?([a-zA-Z_][a-zA-Z_0-9]*)|\[(-?\d{1,6})\]")
_NAME = r"[a-zA-Z_][a-zA-Z_0-9]*(?:\.[a-zA-Z_][a-zA-Z_0-9]*|\[-?\d{1,6}\])*"
_VALUE = re.compile(rf"(?:(max|min)\(\s*({_NAME})\s*\)|({_NAME}))")
_CRITERION = re.compile(r"(not\s+)?(.+?)\s*(?:(<=|>=|==|!=|<|>)\s*(\S+))?")
_MOST_TEXT, _SHOWN = 200, 12


class BeyondListError(UserError):
    """A list of a document is shorter than the place that is asked for."""


class Value(NamedTuple):
    """A number or truth value of a row.

    Attributes
    ----------
    text : str
        As it was written.
    path : tuple of str or int
        Keys and places of metrics.json; what is not at its top is looked for in the verdict.
    over : str
        "max" or "min" of a list, empty for a value; unknown where anything in the list is.

    Examples
    --------
    >>> document = {"min_gap": 2.5, "hop_ratio": {"max": [0.5, 1.5]}, "verdict": {"certified": 1}}
    >>> [Value.parse(text).of(document) for text in ("max(hop_ratio.max)", "certified")]
    [1.5, 1]
    """

    text: str
    path: tuple[str | int, ...]
    over: str

    @classmethod
    def parse(cls, text: str) -> Value:
        """Read a value's name.

        Raises
        ------
        UserError
            When it is none.
        """
        found = _VALUE.fullmatch(text.strip()) if len(text) <= _MOST_TEXT else None
        if found is None:
            raise UserError(
                f"{text} is no name of a number: nothing can be looked up. Write names of "
                "metrics.json such as min_gap, max_abs_spacing_error[-1] or max(hop_ratio.max)."
            )
        name = found[2] or found[3]
        steps = [(key, place) for key, place in _STEP.findall(name)]
        path = tuple(key or int(place) for key, place in steps)
        return cls(text.strip(), path, found[1] or "")

    def check(self, document: Mapping[str, Any]) -> None:
        """Refuse a name that no such document has; places in a list may differ from row to row.

        Raises
        ------
        UserError
            When it is none.
        """
        try:
            self.of(document)
        except BeyondListError:
            return

    def of(self, document: Mapping[str, Any]) -> Any:
        """Return the value in a document with the names of metrics.json, None where it is unknown.

        Raises
        ------
        UserError
            When there is none of the name.
        """
        found: Any = document
        if self.path[0] not in document and self.path[0] in document.get("verdict", ()):
            found = document["verdict"]
        for step in self.path:
            if found is None:
                return None
            try:
                found = found[step]
            except IndexError as error:
                text = f"{self.text}: place {step} is beyond a list of {len(found)}."
                raise BeyondListError(text) from error
            except (KeyError, TypeError) as error:
                raise UserError(f"{self.text}: {_lacking(found, step)}.") from error
        if not self.over or found is None:
            return found
        if not isinstance(found, list):
            raise UserError(f"{self.text}: that is no list. Leave {self.over} out.")
        if not all(one is None or type(one) in (int, float) for one in found):
            raise UserError(f"{self.text}: that is no list of numbers.")
        return _OVER_LISTS[self.over](found) if found and None not in found else None


def _lacking(found: Any, step: str | int) -> str:
    """Say what there is where a step of a name leads nowhere."""
    match found, step:
        case dict(), str():
            near = get_close_matches(step, found, n=3, cutoff=0.5)
            some = near or [*found][:_SHOWN]
            more = "" if len(some) == len(found) else " and others"
            return f"there is no {step} among {', '.join(some)}{more}"
        case list(), _:
            return f"{step} is looked for in a list. Give a place, such as [-1], or max(...)"
    return f"{step} is looked for in a single value"


class Criterion(NamedTuple):
    """What has to be true of a row.

    Attributes
    ----------
    text : str
        As it was written.
    value : Value
        What it is about.
    comparison : str
        One of <, <=, ==, !=, >=, >; empty where the value itself is true or false.
    limit : float
        What it is compared with.
    negated : bool
        Whether it has to be false.

    Examples
    --------
    >>> document = {"min_gap": 2.5, "verdict": {"string_stable": True}}
    >>> texts = ("string_stable", "not string_stable", "min_gap > 2.5", "min_gap >= 2.5")
    >>> [Criterion.parse(text).holds(document) for text in texts]
    [True, False, False, True]
    """

    text: str
    value: Value
    comparison: str
    limit: float
    negated: bool

    @classmethod
    def parse(cls, text: str) -> Criterion:
        """Read a criterion.

        Raises
        ------
        UserError
            When it is none.
        """
        found = _CRITERION.fullmatch(text.strip()) if len(text) <= _MOST_TEXT else None
        if found is None:
            raise UserError(f"criterion {text[:_MOST_TEXT]!r} is none. Write: min_gap > 2.0")
        try:
            limit = float(found[4]) if found[4] else 0.0
        except ValueError:
            raise UserError(
                f"criterion {text}: {found[4]} is no number to compare with. Write: min_gap > 2.0"
            ) from None
        if math.isnan(limit):
            raise UserError(f"criterion {text}: nothing compares with nan. Give a number.")
        value = Value.parse(found[2])
        return cls(text.strip(), value, found[3] or "", limit, bool(found[1]))

    def holds(self, document: Mapping[str, Any]) -> bool:
        """Return whether it is true of a document; what is unknown never is.

        Raises
        ------
        UserError
            When the document has no such value, or one that cannot be compared.
        """
        value = self.value.of(document)
        if value is None:
            return False
        if self.comparison:
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise UserError(
                    f"criterion {self.text}: {self.value.text} is {_kind(value)}, no number."
                )
            return _COMPARISONS[self.comparison](value, self.limit) is not self.negated
        if not isinstance(value, bool):
            raise UserError(
                f"criterion {self.text}: {self.value.text} is {_kind(value)}, neither true nor "
                "false. Compare it with a number."
            )
        return value is not self.negated


def _kind(value: Any) -> str:
    kinds = {bool: "true or false", str: "a text", list: "a list", dict: "a group of values"}
    return kinds.get(type(value), "a number")
