r"""Blending two laws in time: when it cannot destabilise a vehicle, however it is done.

Under ``u = share u_1 + (1 - share) u_2`` of two constant time headway laws the vehicle's own loop
is ``x' = (A_1 + (1 - share) b c^T) x``, with a share that may change in any way. By the circle
criterion one quadratic Lyapunov function serves all of these loops iff both are stable and

    Re D_1(jw) D_2(-jw) > 0 for every w,   D_i(s) = tau s^3 + s^2 + (k_v,i + k_p,i h_i) s + k_p,i

(K. S. Narendra and J. H. Taylor, Frequency Domain Criteria for Absolute Stability, 1973; R. N.
Shorten and K. S. Narendra, IEEE Trans. Automatic Control 48 (2003) 618-621). With y = w^2 that is

    P(y, tau) = (k_p,1 - y)(k_p,2 - y) + y (c_1 - tau y)(c_2 - tau y) > 0

with ``c_i = k_v,i + k_p,i h_i``. Where ``y <= (c_1 + c_2)/(2 tau_0)`` its least value over the lags
is at ``tau_0``; beyond, it is ``(k_p,1 - y)(k_p,2 - y) - y (c_1 - c_2)^2/4``, which is convex and
rises from there on if it is positive there, since ``c_i > tau_0 k_p,i``. So one polynomial of y
on one interval decides for all lags (docs/theory.md, section 11 (Extensions)).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.theory.errors import require_positive

if TYPE_CHECKING:
    from cacc_platoon.model.control import Gains

__all__ = ["blend_is_stable"]


def blend_is_stable(first: Gains, second: Gains, tau_max: float) -> bool:
    """Return whether no blend of two laws in time can destabilise a vehicle, at any lag.

    Parameters
    ----------
    first, second : Gains
        The laws.
    tau_max : float
        Largest actuation lag ``tau_0`` [s].

    Returns
    -------
    bool
        Whether for every lag in (0, tau_0] one quadratic Lyapunov function serves both loops and
        all between them, in continuous time: exact up to rounding.

    Raises
    ------
    DesignError
        If `tau_max` is not positive.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> from cacc_platoon.model.fallback import gains_without_v2v
    >>> blend_is_stable(Gains(0.95, 0.5, 0.63, 0.009), gains_without_v2v(0.5, 1.1), 0.5)
    True
    >>> blend_is_stable(Gains(0.95, 0.5, 0.1, 0.01), Gains(0.1, 0.0, 0.1, 20.0), 0.001)
    False
    """
    require_positive("tau_max", tau_max, "s")
    (c_1, p_1), (c_2, p_2) = (
        (gains.k_v + gains.k_p * gains.time_headway, gains.k_p) for gains in (first, second)
    )
    if not all(p > 0 and c > tau_max * p for c, p in ((c_1, p_1), (c_2, p_2))):
        return False
    y = np.polynomial.Polynomial([0.0, 1.0])
    turn = (c_1 + c_2) / (2.0 * tau_max)
    return _positive((p_1 - y) * (p_2 - y) + y * (c_1 - tau_max * y) * (c_2 - tau_max * y), turn)


def _positive(polynomial: np.polynomial.Polynomial, high: float) -> bool:
    """Return whether a polynomial is positive from 0 to `high`."""
    turns = polynomial.deriv().roots()
    real = turns[np.abs(turns.imag) <= 1e-9 * (1.0 + np.abs(turns))].real
    places = np.array([0.0, *real[(real > 0.0) & (real < high)], high])
    return bool(np.min(polynomial(places)) > 0.0)
