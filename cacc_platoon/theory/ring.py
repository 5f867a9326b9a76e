r"""A ring of identical vehicles: with how many of them it is unstable.

A motion that each vehicle of a ring of N repeats, turned by ``2 pi m/N``, has the characteristic
``D(s) = exp(2 pi j m/N) N(s)``. The number of its roots in the right half plane changes with the
turn only where ``|H(j omega)| = 1``, at ``-arg H``. It is zero outside of the turns between the two
edges of the band in which ``|H| > 1``, so that a ring is unstable iff one of its turns lies between
them (docs/theory.md, section 11 (Extensions)).
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING

from cacc_platoon.theory.errors import require, require_positive
from cacc_platoon.theory.exact import is_string_stable, propagation_margins
from cacc_platoon.theory.transfer import gamma, is_internally_stable, require_resolvable

if TYPE_CHECKING:
    from cacc_platoon.model.control import Gains

__all__ = ["first_unstable_ring", "unstable_turns"]


def first_unstable_ring(gains: Gains, tau: float, k_effective: float) -> int | None:
    """Smallest number of vehicles with which a ring of them is unstable.

    Larger rings may be stable again where ``|H| <= 1`` at low frequencies; where ``C < 0`` all are
    unstable. In continuous time, for one lag and one effective gain.

    Parameters
    ----------
    gains : Gains
        Controller; ``k_a`` is not used.
    tau : float
        Actuation lag [s].
    k_effective : float
        Effective feed-forward gain ``k_a E[w]``, not negative.

    Returns
    -------
    int or None
        The number of vehicles, None when a ring of any number is stable: iff the hop is string
        stable.

    Raises
    ------
    DesignError
        If a value is out of its range, or the loop of a single vehicle is unstable.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> first_unstable_ring(Gains(0.65, 0.5, 0.63, 0.009), 0.5, 0.524086844)
    75
    >>> first_unstable_ring(Gains(0.95, 0.5, 0.63, 0.009), 0.5, 0.524086844) is None
    True
    """
    if k_effective > 1.0:
        return 1
    turns = unstable_turns(gains, tau, k_effective)
    if turns is None:
        return None
    low, high = (Fraction(turn / (2.0 * math.pi)) for turn in turns)
    require(
        low < high,
        f"the turns at which a ring with k_v = {gains.k_v:g} 1/s, k_p = {gains.k_p:g} 1/s^2 is "
        "unstable are too close together: no number of vehicles can be computed. Choose gains "
        "farther from the edge of string stability.",
    )
    return _simplest(low, high).denominator


def unstable_turns(gains: Gains, tau: float, k_effective: float) -> tuple[float, float] | None:
    """Between which turns from one vehicle to the next [rad] a motion grows; None for none.

    The band ``|H| > 1`` ends where ``tau^2 omega^4 + B omega^2 + C = 0``; its edges are the turns
    ``-arg H``. What grows at a turn also grows at its negative.

    Parameters
    ----------
    gains, tau, k_effective
        As in `first_unstable_ring`, with ``k_effective <= 1``.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> low, high = unstable_turns(Gains(0.65, 0.5, 0.63, 0.009), 0.5, 0.524086844)
    >>> low, round(high, 5)
    (0.0, 0.08456)
    """
    require_positive("tau", tau, "s")
    require(
        0.0 <= k_effective <= 1.0,
        f"k_effective = {k_effective:g} is outside 0 to 1: no turn can be told from its loop. Give "
        "an effective gain from 0 to 1.",
    )
    require(
        is_internally_stable(gains, tau),
        f"k_v = {gains.k_v:g} 1/s, k_p = {gains.k_p:g} 1/s^2 do not keep one vehicle stable at tau "
        f"= {tau:g} s: a ring of them has no meaning. Raise k_v until k_v + h_w k_p > tau k_p.",
    )
    if is_string_stable(gains, tau, k_effective):
        return None
    require_resolvable(gains, tau)
    B, C, _ = propagation_margins(gains, tau, k_effective)
    spread = math.sqrt(max(B * B - 4.0 * tau * tau * C, 0.0))
    if B >= 0.0:
        return 0.0, _turn(gains, tau, k_effective, -2.0 * C / (B + spread))
    first = max(2.0 * C / (spread - B), 0.0)
    last = (spread - B) / (2.0 * tau * tau)
    return _turn(gains, tau, k_effective, first), _turn(gains, tau, k_effective, last)


def _turn(gains: Gains, tau: float, k: float, square: float) -> float:
    """``-arg H`` [rad], continuous from 0 at ``omega = 0``, at ``omega^2``."""
    h, _, k_v, k_p = gains
    omega, damping = math.sqrt(square), gamma(gains)
    real = (k_p - square) * (k_p - k * square) + square * k_v * (damping - tau * square)
    imag = h * k_p**2 + square * (k_v - tau * k_p - k * damping + k * tau * square)
    fine = math.atan2(omega * imag, real)  # no digits are lost at small turns
    below = math.atan2(omega * (damping - tau * square), k_p - square) % (2.0 * math.pi)
    above = math.atan2(omega * k_v, k_p - k * square)
    return fine + 2.0 * math.pi * round((below - above - fine) / (2.0 * math.pi))


def _simplest(low: Fraction, high: Fraction) -> Fraction:
    """Return the fraction with the smallest denominator strictly between two numbers."""
    whole = math.floor(low)
    if whole + 1 < high:
        return Fraction(whole + 1)
    low, high = low - whole, high - whole
    if low == 0:
        return whole + Fraction(1, math.floor(1 / high) + 1)
    return whole + 1 / _simplest(1 / high, 1 / low)
