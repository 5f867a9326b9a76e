"""Reads what people wrote in a plan, and says in one line what is wrong there."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from cacc_platoon.errors import UserError, one_line

MOST_ROWS = 1_000_000


def group(given: Any, where: str, keys: Sequence[str] = ()) -> dict[str, Any]:
    """Return a group of names and values, of which only `keys` may be, if any are given."""
    if not isinstance(given, dict) or not all(isinstance(key, str) for key in given):
        raise UserError(f"{where}: is no group of names and values. Write name: value.")
    for key in given:
        if keys and key not in keys:
            raise UserError(f"{where}: {one_line(key, 80)} is none of {', '.join(keys)}.")
    return dict(given)


def several(given: Any, where: str) -> list[Any]:
    """Return a list that has something in it."""
    if not isinstance(given, list) or not given:
        raise UserError(f"{where}: {one_line(str(given), 80)} is no list of values. Write [A, B].")
    return given


def texts(document: Mapping[str, Any], key: str, name: str) -> list[str]:
    """Return the texts of a list that may be absent."""
    given = document.get(key) or []
    if not isinstance(given, list):
        raise UserError(f"{name}: {key} is no list. Write one text a line, each after a dash.")
    return [text(one, f"{name}: {key}") for one in given]


def text(given: Any, where: str) -> str:
    """Return a text."""
    if not isinstance(given, str):
        raise UserError(f"{where}: {one_line(str(given), 80)} is no text. Put it in quotes.")
    return given


def number(given: Any, where: str) -> float:
    """Return a finite number."""
    if isinstance(given, bool) or not isinstance(given, (int, float)) or not math.isfinite(given):
        raise UserError(f"{where} = {one_line(str(given), 80)} must be a finite number.")
    return float(given)


def count(given: Any, where: str, least: int = 1) -> int:
    """Return a whole number that can be one of rows."""
    if isinstance(given, bool) or not isinstance(given, int) or given < least:
        text = one_line(str(given), 80)
        raise UserError(f"{where} = {text} must be a whole number >= {least}.")
    if given > MOST_ROWS:
        raise UserError(f"{where} = {given} is more than {MOST_ROWS}, which no table holds.")
    return given
