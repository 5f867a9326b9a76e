"""What a design question may not contain, as value, rule, consequence, remedy."""

from __future__ import annotations

import math

from cacc_platoon.errors import UserError

__all__ = ["DesignError", "require", "require_positive", "require_reception", "require_rho"]


class DesignError(UserError, ValueError):
    """A design question without an answer: a value out of range or a request nothing fulfils."""


def require(condition: bool, message: str) -> None:
    """Raise ``DesignError(message)`` unless the condition holds.

    Raises
    ------
    DesignError
        If `condition` is false.
    """
    if not condition:
        raise DesignError(message)


def require_positive(name: str, value: float, unit: str) -> None:
    """Refuse a quantity that is not a positive, finite number.

    Raises
    ------
    DesignError
        If `value` is NaN, infinite, zero or negative.
    """
    unit = f" {unit}" if unit else ""
    require(
        math.isfinite(value) and value > 0,
        f"{name} = {value:g}{unit} is not a positive finite number: the platoon equations have no "
        f"meaning for it. Give {name} > 0{unit and ' in' + unit}.",
    )


def require_rho(rho: float) -> None:
    """Refuse a signal-to-noise ratio outside ``rho > 1``; infinity (no noise) is allowed.

    Raises
    ------
    DesignError
        If `rho` is NaN or not above one.
    """
    require(
        rho > 1,
        f"rho = {rho:g} is not above 1 (0 dB): the noise could cancel the communicated "
        "acceleration, and no headway is guaranteed. Give a linear SNR above 1, or one in dB "
        "with rho = 10^(SNR/20).",
    )


def require_reception(reception: float, name: str = "reception") -> None:
    """Refuse a packet reception that is not a probability.

    Raises
    ------
    DesignError
        If `reception` is NaN or outside 0 to 1.
    """
    if not 0 <= reception <= 1:  # the text is costly where a search asks often
        raise DesignError(
            f"{name} = {reception:g} is not a probability: no share of packets can be outside "
            f"0 to 1. Give {name} from 0 to 1, the smallest packet reception probability."
        )
