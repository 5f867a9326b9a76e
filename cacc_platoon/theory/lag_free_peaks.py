r"""Whether peaks grow where vehicles have next to no lag, in closed form.

Without lag ``H = k + (q s + (1 - k) k_p)/(s^2 + gamma s + k_p)`` with ``q = k_v - k gamma``. Its L1
norm is one iff ``0 <= k <= 1`` and what follows the direct part never changes sign, from ``q >= 0``
at once to the slow mode, whose weight has the sign of ``(1 - k) k_p - l_1 q``. As ``l_1 l_2 = k_p``
for the slow and the fast rate, and ``q = (1 - k) gamma - h_w k_p``, that is ``h_w l_2 >= 1 - k``
(docs/theory.md, section 5 (Gains between energies and between peaks)).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from cacc_platoon.theory.exact import TOLERANCE
from cacc_platoon.theory.transfer import gamma

if TYPE_CHECKING:
    from cacc_platoon.model.control import Gains

__all__ = ["keeps_peaks_without_lag"]


def keeps_peaks_without_lag(gains: Gains, k_effective: float) -> bool:
    """Whether no peak grows along a platoon without lag: the L1 norm of its mean hop is one.

    Where it is not, the norm is above one for all short lags as well, so that a gain between peaks
    of one for every lag needs it. It is not sufficient. Where both ends of I have it, so does
    every ``k`` in between.

    Parameters
    ----------
    gains : Gains
        Controller; ``k_a`` is not used.
    k_effective : float
        Effective feed-forward gain ``k_a E[w]``.

    Returns
    -------
    bool
        Whether ``gamma^2 >= 4 k_p``, ``k_v >= k gamma`` and ``h_w l_2 >= 1 - k``, each down to a
        relative `TOLERANCE`, and the loop is stable.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> keeps_peaks_without_lag(Gains(0.95, 0.5, 0.63, 0.009), 0.6)
    True
    >>> keeps_peaks_without_lag(Gains(0.95, 0.5, 0.63, 0.009), 0.4)
    False
    """
    h, _, k_v, k_p = gains
    damping, k, slack = gamma(gains), k_effective, 1.0 - TOLERANCE
    if not (k >= 0.0 and k_p > 0.0 and damping > 0.0):
        return False
    stiffness = 2.0 * math.sqrt(k_p)
    if damping < stiffness * slack or k_v < k * damping * slack:
        return False
    apart = math.sqrt(max(damping - stiffness, 0.0)) * math.sqrt(damping + stiffness)
    return 0.5 * h * (damping + apart) >= (1.0 - k) * slack
