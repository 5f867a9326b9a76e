"""What a parameter is: type, unit, range and meaning, and how a bad value is refused."""

from __future__ import annotations

import dataclasses
import difflib
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from cacc_platoon.errors import UserError

KIND_TEXT = {
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "str": "a text",
    "tuple[float, ...]": "a list of numbers",
    "tuple[str, ...]": "a list of texts",
    "float | tuple[float, ...]": "a number or a list of numbers, one per follower",
    "int | str": "a whole number or a text",
    "float | str": "a number or a text",
}


MAX_CHARACTERS = 1000
"""Of a text; it has to be shown, and to be a path."""
_LONGEST_INT = 200


class ScenarioError(UserError):
    """A scenario that cannot be run: the line names source, key, value, rule and remedy."""


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One row of the parameter table.

    Attributes
    ----------
    name : str
        Dotted name, as in a ROS parameter file.
    kind : str
        Type, a key of KIND_TEXT.
    default, unit, meaning
        What it is when not given, its SI unit ("-" for none), what it means.
    above, at_least, below, at_most : float, optional
        Range of every number in the value, open (above, below) or closed.
    choices : tuple of str
        Permitted texts; empty when any text will do.
    consequence : str
        What a value outside the range would do.
    per_vehicle : bool
        Whether a vehicle's own section may override it.
    """

    name: str
    kind: str
    default: Any
    unit: str
    meaning: str
    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    choices: tuple[str, ...] = ()
    consequence: str = ""
    per_vehicle: bool = False

    @property
    def range_text(self) -> str:
        """Say the permitted values in words; empty when there is no limit."""
        limits = [
            f"{sign} {limit:g}"
            for sign, limit in (
                (">", self.above),
                (">=", self.at_least),
                ("<", self.below),
                ("<=", self.at_most),
            )
            if limit is not None
        ]
        return " | ".join(filter(None, (" and ".join(limits), *self.choices)))

    def check(self, value: object, source: str) -> Any:
        """Return `value` in the parameter's own type.

        Raises
        ------
        ScenarioError
            When type, finiteness, range or choice is wrong; `source` begins the line.
        """
        converted = _convert(value, self.kind)
        if converted is None:
            raise self.refusal(value, source, f"must be {KIND_TEXT[self.kind]}")
        numbers = converted if isinstance(converted, tuple) else (converted,)
        for number in numbers:
            if isinstance(number, str):
                if self.choices and number not in self.choices:
                    raise self.refusal(value, source, f"must be {self.range_text}")
                if not number.isprintable() or len(number) > MAX_CHARACTERS:
                    rule = f"must be at most {MAX_CHARACTERS} characters that can be printed"
                    raise self.refusal(value, source, rule)
            elif not math.isfinite(number):
                raise self.refusal(value, source, "must be finite")
            elif number and abs(number) < sys.float_info.min:
                rule = "is closer to 0 than can be computed with; give 0 or more"
                raise self.refusal(value, source, rule)
            elif not self._within(number):
                raise self.refusal(value, source, f"must be {self.range_text}")
        return converted

    def refusal(self, value: object, source: str, rule: str) -> ScenarioError:
        """Return the one-line error for a value that breaks `rule`."""
        shown = f"{value[:60]!r}" if isinstance(value, str) else _show_scalar(value)
        if len(shown) > 60:
            shown = f"{shown[:57]}..."
        unit = "" if self.unit == "-" else f" {self.unit}"
        range_broken = self.consequence and rule == f"must be {self.range_text}"
        consequence = f" ({self.consequence})" if range_broken else ""
        example = f", for example {_show(self.default)}" if self.default not in ("", ()) else ""
        remedy = f"Give {self.meaning}{example}"
        return ScenarioError(
            f"{source}: {self.name} = {shown}{unit} {rule}{consequence}. {remedy}."
        )

    def _within(self, number: float) -> bool:
        return (
            (self.above is None or number > self.above)
            and (self.at_least is None or number >= self.at_least)
            and (self.below is None or number < self.below)
            and (self.at_most is None or number <= self.at_most)
        )


def parameter(default: Any, unit: str, meaning: str, **limits: Any) -> Any:
    """Declare a dataclass field as a row of the parameter table."""
    metadata = {"unit": unit, "meaning": meaning, **limits}
    return dataclasses.field(default=default, metadata=metadata)


def rows(group: str, owner: type, per_vehicle: bool) -> list[Parameter]:
    """Return the table rows of one group, a dataclass of `parameter` fields."""
    return [
        Parameter(
            f"{group}.{f.name}", str(f.type), f.default, per_vehicle=per_vehicle, **f.metadata
        )
        for f in dataclasses.fields(owner)
    ]


def refuse_unknown(names: Iterable[str], known: Sequence[str], source: str) -> None:
    """Raise ScenarioError for the first name that the table does not have, with a suggestion."""
    for name in names:
        if name not in known:
            close = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
            hint = (
                f"Did you mean {close[0]}?" if close else "See the parameter table in the README."
            )
            raise ScenarioError(f"{source}: unknown key {name}, it would be ignored. {hint}")


def flatten(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Turn nested keys into dotted names; dotted keys may be mixed in, as ROS allows."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            flat.update(flatten(value, f"{prefix}{key}."))
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def nest(values: Mapping[str, Any]) -> dict[str, Any]:
    """Turn dotted names into nested keys."""
    tree: dict[str, Any] = {}
    for name, value in values.items():
        *groups, last = name.split(".")
        branch = tree
        for group in groups:
            branch = branch.setdefault(group, {})
        branch[last] = list(value) if isinstance(value, tuple) else value
    return tree


def _convert(value: object, kind: str) -> Any:
    """Return `value` as `kind`, or None when it is of another type."""
    for alternative in kind.split(" | "):
        match alternative:
            case "bool" if isinstance(value, bool):
                return value
            case "int" if isinstance(value, int) and not isinstance(value, bool):
                return value
            case "float" if isinstance(value, int | float) and not isinstance(value, bool):
                return _as_float(value)
            case "str" if isinstance(value, str):
                return value
            case "tuple[float, ...]" | "tuple[str, ...]" if isinstance(value, list | tuple):
                items = [_convert(item, alternative[6:-6]) for item in value]
                return None if None in items else tuple(items)
    return None


def _as_float(number: float) -> float:
    """Return a number as a float; a whole number beyond all of them is infinite."""
    try:
        return float(number)
    except OverflowError:
        return math.inf if number > 0 else -math.inf


def _show(value: object) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(f"{item:g}" for item in value[:3]) + ", ...]" if value else "[]"
    return _show_scalar(value)


def _show_scalar(value: object) -> str:
    """Write a value as YAML does where Python differs."""
    words = {True: "true", False: "false", None: "null"}
    if value is None or isinstance(value, bool):
        return words[value]
    if isinstance(value, int) and value.bit_length() > _LONGEST_INT:
        return f"a whole number of {value.bit_length()} bits"
    return f"{value}"
