r"""A human driver as a linear follower with a reaction delay.

.. math:: \tau \dot a + a = -k_v (v - v_{ahead})(t - \theta) - k_p \delta(t - \theta)

so that ``H = (k_v s + k_p)/D`` with ``D = s^2 (tau s + 1) e^{theta s} + gamma s + k_p`` up to a
pure delay. The loop has the gain ``|gamma j omega + k_p|/|s^2 (tau s + 1)|``, which falls with
frequency and is one at one of them only: the driver is stable iff the delay is below the phase
margin there, divided by that frequency (docs/theory.md, section 11 (Extensions)).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.theory.errors import require

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = ["HumanDriver", "longest_delay", "require_stable"]


class HumanDriver(NamedTuple):
    """What a human driver does, linearised at constant speed.

    Attributes
    ----------
    k_v, k_p : float
        Gains on the velocity error [1/s] and on the spacing error [1/s^2].
    time_headway : float
        Time headway the driver keeps [s].
    delay : float
        Reaction delay ``theta`` [s] of all that the driver sees, the own speed included.
    lag : float
        Actuation lag of the vehicle [s].
    """

    k_v: float
    k_p: float
    time_headway: float
    delay: float
    lag: float = 0.0

    @property
    def damping(self) -> float:
        """``gamma = k_v + h k_p`` [1/s]."""
        return self.k_v + self.time_headway * self.k_p

    def excess(self, omega: ArrayLike) -> NDArray[np.float64]:
        """``(1 - |H(j omega)|^2)/omega^2`` [s^2]: negative where the driver amplifies.

        Examples
        --------
        >>> driver = HumanDriver(0.5, 0.1, 1.4, 0.4)
        >>> driver.excess([0.0, 0.3]).round(3).tolist()
        [-4.04, 0.154]
        """
        w = np.asarray(omega, dtype=np.float64)
        h, tau = self.time_headway, self.lag
        sin, cos = np.sin(w * self.delay), np.cos(w * self.delay)
        real, imag = cos - tau * w * sin, sin + tau * w * cos
        size = (self.k_p - w * w * real) ** 2 + (w * (self.damping - w * imag)) ** 2
        late = 4.0 * np.sin(0.5 * w * self.delay) ** 2 + 2.0 * tau * w * sin
        still = self.k_p * (h * (2.0 * self.k_v + h * self.k_p) - 2.0 + late)
        moving = w * (w * (1.0 + (tau * w) ** 2) - 2.0 * self.damping * imag)
        return np.asarray((still + moving) / size)


def longest_delay(driver: HumanDriver) -> float:
    """Delay [s] at which a driver loses stability behind a vehicle at constant speed.

    Returns
    -------
    float
        Zero or less where the driver is not stable without delay.

    Examples
    --------
    >>> round(longest_delay(HumanDriver(0.5, 0.1, 1.4, 0.4)), 3)
    2.033
    """
    g, p, lag = driver.damping, driver.k_p, driver.lag
    low, high = math.sqrt(p) * 1e-6, g + math.sqrt(p)
    for _ in range(100):
        w = math.sqrt(low * high)
        loop = math.hypot(p, g * w) / (w * w * math.hypot(1.0, lag * w))
        low, high = (w, high) if loop > 1.0 else (low, w)
    return (math.atan2(g * low, p) - math.atan(lag * low)) / low


def require_stable(driver: HumanDriver) -> None:
    """Refuse a driver that is no vehicle: a value out of range, or a delay that is too long.

    Raises
    ------
    DesignError
        If a value is out of its range, or the delay reaches `longest_delay`.
    """
    for name, value in driver._asdict().items():
        least = 1e-6 if name in ("k_p", "time_headway") else 0.0
        require(
            least <= value <= 1e6,
            f"human {name} = {value:g} is not from {least:g} to 1e+06: no driver has it, and "
            f"nothing can be computed with it. Give a {name} in between.",
        )
    longest = longest_delay(driver)
    require(
        driver.delay < longest,
        f"human delay = {driver.delay:g} s is not below {longest:.4g} s: a driver with k_v = "
        f"{driver.k_v:g} 1/s, k_p = {driver.k_p:g} 1/s^2 and a headway of {driver.time_headway:g} "
        "s swings more and more behind a steady vehicle, and no traffic is stable. Give a shorter "
        "delay or smaller gains.",
    )
