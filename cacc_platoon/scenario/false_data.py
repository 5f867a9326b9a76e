"""Times of false data as texts, such as "20 40 factor=3"."""

from __future__ import annotations

import math

from cacc_platoon.model import Forgery

KINDS = ("factor", "replay", "frozen")
RULE = (
    'must be "BEGIN END WHAT" with 0 <= BEGIN < END in seconds and WHAT factor=X, replay=X with '
    "X > 0 s, or frozen"
)


def forgery(text: str, step: float) -> Forgery:
    """Return what a text says of packets, in samples of `step` [s].

    Raises
    ------
    ValueError
        When it does not keep the rule.

    Examples
    --------
    >>> forgery("20 40 replay=5", step=0.1)
    Forgery(begin=200, end=400, factor=1.0, older=50, frozen=False)
    """
    first, last, what = text.split()
    begin, end = _time(first), _time(last)
    kind, given, value = what.partition("=")
    if kind not in KINDS or bool(given) == (kind == "frozen") or not begin < end:
        raise ValueError(RULE)
    start, stop = (math.ceil(time / step - 1e-9) for time in (begin, end))
    match kind:
        case "factor":
            return Forgery(start, stop, factor=_number(value))
        case "replay":
            return Forgery(start, stop, older=max(1, round(_time(value) / step)))
        case _:
            return Forgery(start, stop, frozen=True)


def _time(text: str) -> float:
    if not 0.0 <= (value := _number(text)) <= 1e7:
        raise ValueError(RULE)
    return value


def _number(text: str) -> float:
    if not math.isfinite(value := float(text)):
        raise ValueError(RULE)
    return value
