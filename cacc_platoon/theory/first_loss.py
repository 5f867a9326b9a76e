"""Where a slack that falls first turns negative (docs/theory.md, section 7 (V2V latency))."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["first_loss"]


def first_loss(
    slack: Callable[[float], float],
    low: float,
    high: float,
    shortest: float,
    at_high: float = -math.inf,
) -> float:
    """Close in on where a falling `slack` turns negative; 0 where that is below `shortest`.

    Regula falsi (Illinois), halving where an end is not finite.
    """
    at_low, rose = math.inf, False
    while low > shortest and (at_low := slack(low)) < 0:
        low, high, at_high = 0.75 * low, low, at_low
    while high - low > 1e-7 * high:
        if high < shortest:
            return 0.0
        share = at_low / (at_low - at_high) if math.isfinite(at_low - at_high) else 0.5
        middle = low + min(max(share, 1e-8), 1.0 - 1e-8) * (high - low)
        value = slack(middle)
        if value >= 0:  # an end that stays twice counts half
            low, at_low, at_high = middle, value, at_high * (0.5 if rose else 1.0)
        else:
            high, at_high, at_low = middle, value, at_low * (1.0 if rose else 0.5)
        rose = value >= 0
    return low
