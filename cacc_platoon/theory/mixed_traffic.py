r"""Connected vehicles among human drivers, in random order: from which share on nothing grows.

A connected vehicle behind a connected one has the hop of its gains. Behind a human driver it hears
nothing: the same gains with ``k_a = 0``. With a share ``p`` of connected vehicles, each vehicle
drawn independently, the gain from the first to the last of n vehicles is a product of random
factors, and by the law of large numbers its logarithm per vehicle tends almost surely to

.. math:: \Lambda(\omega) = p^2 \log|H_{CACC}| + p (1-p) \log|H_{ACC}| + (1-p) \log|H_{human}| .

It does not grow iff ``Lambda <= 0`` at every frequency. As every ``H(0)`` is one,
``Lambda/omega^2`` is computed, from ``|D|^2 - |N|^2`` divided by ``omega^2`` term by term, so that
``omega = 0`` is a frequency like others (docs/theory.md, section 11 (Extensions)).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cacc_platoon.theory.errors import require, require_positive
from cacc_platoon.theory.exact import is_string_stable, propagation_margins
from cacc_platoon.theory.human_driver import HumanDriver, require_stable
from cacc_platoon.theory.transfer import gamma, is_internally_stable, require_resolvable

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from cacc_platoon.model.control import Gains

    Float = NDArray[np.float64]

__all__ = ["ConnectedVehicles", "LeastShare", "least_connected_share", "mixed_traffic_growth"]

_FREQUENCIES, _ZOOMS, _ZOOM = 3000, 4, 33


class ConnectedVehicles(NamedTuple):
    """The connected vehicles of mixed traffic.

    Attributes
    ----------
    gains : Gains
        Controller; ``k_a`` is not used.
    tau_max : float
        Actuation lag [s].
    k_effective : tuple of float
        Effective gains ``k_a E[w]``; at each frequency the one that grows most counts.
    acc_headway : float or None
        Headway [s] behind a human driver; None for that of `gains`.
    shorter_lags : bool
        Whether at each frequency the lag up to `tau_max` counts that grows most.
    """

    gains: Gains
    tau_max: float
    k_effective: tuple[float, ...]
    acc_headway: float | None = None
    shorter_lags: bool = True

    @property
    def behind_human(self) -> Gains:
        """The gains behind a human driver, where nothing is heard."""
        acc = self.acc_headway
        return self.gains._replace(time_headway=self.gains.time_headway if acc is None else acc)


class LeastShare(NamedTuple):
    """From which share of connected vehicles on mixed traffic does not grow.

    Attributes
    ----------
    share : float
        Every share from this one to 1 is enough [-]; 0 where human drivers alone do not amplify.
    omega : float
        The frequency that asks for it [rad/s].
    """

    share: float
    omega: float


def mixed_traffic_growth(
    share: float, omega: ArrayLike, vehicles: ConnectedVehicles, human: HumanDriver
) -> Float:
    """Mean growth per vehicle of the logarithm of an amplitude, almost surely, ``Lambda``.

    Parameters
    ----------
    share : float
        Share of connected vehicles [-].
    omega : array_like, shape (n,)
        Frequencies [rad/s].
    vehicles : ConnectedVehicles
        The share of them that `share` is.
    human : HumanDriver
        All other vehicles.

    Returns
    -------
    ndarray, shape (n,)
        Natural logarithm per vehicle [-]; above zero, amplitudes grow.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> driver = HumanDriver(0.5, 0.1, 1.4, 0.4)
    >>> vehicles = ConnectedVehicles(Gains(0.75, 0.5, 0.8, 0.5), 0.5, (0.5,))
    >>> [float(mixed_traffic_growth(p, [0.1], vehicles, driver)[0]) > 0 for p in (0.5, 0.95)]
    [True, False]
    """
    w = np.asarray(omega, dtype=np.float64)
    parts = _growths_per_square(w, vehicles, human)
    weights = (share**2, share * (1.0 - share), 1.0 - share)
    return np.asarray(w * w * sum(p * part for p, part in zip(weights, parts, strict=True)))


def least_connected_share(vehicles: ConnectedVehicles, human: HumanDriver) -> LeastShare | None:
    """Least share of connected vehicles from which on mixed traffic does not grow.

    At one frequency ``Lambda`` is quadratic in the share: the largest share up to 1 at which it is
    positive is closed form, so that every share above is enough although ``Lambda`` need not fall
    with it. The largest over frequencies is numerical: zero and 3000 frequencies up to where no
    vehicle amplifies, refined around the worst.

    Parameters
    ----------
    vehicles, human
        As in `mixed_traffic_growth`.

    Returns
    -------
    LeastShare or None
        None where the connected vehicles alone amplify: no share is enough.

    Raises
    ------
    DesignError
        If a vehicle is not stable by itself, or a value is out of its range.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> driver = HumanDriver(0.5, 0.1, 1.4, 0.4)
    >>> vehicles = ConnectedVehicles(Gains(0.75, 0.5, 0.8, 0.5), 0.5, (0.4, 0.6))
    >>> least = least_connected_share(vehicles, driver)
    >>> round(least.share, 3), round(least.omega, 2)
    (0.907, 0.0)
    """
    gains, tau_max, behind_human = vehicles.gains, vehicles.tau_max, vehicles.behind_human
    require_positive("tau_max", tau_max, "s")
    require_positive("acc_headway", behind_human.time_headway, "s")
    require_stable(human)
    for hop, place in ((gains, "connected"), (behind_human, "human-driven")):
        require(
            is_internally_stable(hop, tau_max),
            f"k_v = {hop.k_v:g} 1/s, k_p = {hop.k_p:g} 1/s^2, headway {hop.time_headway:g} s are "
            f"not stable behind a {place} vehicle at tau = {tau_max:g} s: no traffic is. Raise k_v "
            "or that headway.",
        )
        require_resolvable(hop, tau_max)
    if not all(is_string_stable(gains, tau_max, k) for k in vehicles.k_effective):
        return None
    loops = [(gamma(hop), hop.k_p) for hop in (gains, behind_human)]
    loops.append((human.damping, human.k_p))
    slowest = min(min(k_p / damping, math.sqrt(k_p)) for damping, k_p in loops)
    fastest = max(2.0 * damping + math.sqrt(2.0 * k_p) for damping, k_p in loops)
    omega = np.append(0.0, np.geomspace(1e-3 * slowest, fastest, _FREQUENCIES))
    for _ in range(_ZOOMS):
        found = _least_shares(*_growths_per_square(omega, vehicles, human))
        at = int(np.argmax(found >= np.max(found) - 1e-12))  # the lowest of those that are alike
        best = LeastShare(float(found[at]), float(omega[at]))
        omega = np.linspace(omega[max(at - 1, 0)], omega[min(at + 1, omega.size - 1)], _ZOOM)
    return best


def _least_shares(cacc: Float, acc: Float, human: Float) -> Float:
    """Largest share in [0, 1] with ``p^2 cacc + p (1-p) acc + (1-p) human > 0``, else 0.

    ``cacc <= 0``: at a share of 1 nothing grows.
    """
    a, b = np.minimum(cacc, 0.0) - acc, acc - human
    spread = b * b - 4.0 * a * human
    with np.errstate(divide="ignore", invalid="ignore"):
        q = -0.5 * (b + np.copysign(np.sqrt(np.maximum(spread, 0.0)), b))
        roots = np.stack((q / a, human / q))
    low, high = np.nan_to_num(np.sort(roots, axis=0), nan=0.0)
    concave = np.where((spread > 0.0) & (low < 1.0 - 1e-12), high, 0.0)
    convex = np.where(human > 0.0, low, 0.0)
    return np.asarray(np.clip(np.where(a < 0.0, concave, convex), 0.0, 1.0))


def _growths_per_square(
    omega: Float, vehicles: ConnectedVehicles, human: HumanDriver
) -> tuple[Float, Float, Float]:
    """``log|H|/omega^2`` [s^2] of a connected vehicle behind one, behind a human, and a human."""
    tau_max, square = vehicles.tau_max, omega * omega

    def connected(hop: Gains, effective_gains: tuple[float, ...]) -> Float:
        damping = gamma(hop)
        lag = np.full_like(omega, tau_max)
        if vehicles.shorter_lags:
            with np.errstate(divide="ignore"):
                lag = np.minimum(lag, damping / square)  # where Im D is zero
        size = (hop.k_p - square) ** 2 + square * (damping - lag * square) ** 2
        grown = []
        for k in effective_gains:
            B, C = 1.0 - k * k - 2.0 * lag * damping, propagation_margins(hop, tau_max, k).C
            grown.append(_per_square(square, (square * (lag**2 * square + B) + C) / size))
        return np.asarray(np.max(grown, axis=0))

    return (
        connected(vehicles.gains, vehicles.k_effective),
        connected(vehicles.behind_human, (0.0,)),
        _per_square(square, human.excess(omega)),
    )


def _per_square(square: Float, excess: Float) -> Float:
    """``log|H|/omega^2`` from ``(1 - |H|^2)/omega^2``, its limit ``-excess/2`` at zero."""
    lost = np.minimum(square * excess, 1.0 - 1e-16)  # a zero of H: no number has its logarithm
    small = lost == 0.0
    log = np.log1p(-lost) / np.where(small, 1.0, square)
    return np.asarray(0.5 * np.where(small, -excess, log))
