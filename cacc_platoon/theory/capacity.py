"""How many vehicles a lane carries at a time headway."""

from __future__ import annotations

from cacc_platoon.theory.errors import require, require_positive

__all__ = ["capacity"]


def capacity(time_headway: float, speed: float, distance: float) -> float:
    """Vehicles per hour and lane of an endless platoon at one speed, ``3600 v/(d + h_w v)``.

    Parameters
    ----------
    time_headway : float
        Headway ``h_w`` [s].
    speed : float
        Common speed ``v`` [m/s].
    distance : float
        Standstill distance ``d`` with the length of a vehicle [m].

    Returns
    -------
    float
        Throughput [1/h]: one vehicle in every ``d + h_w v`` of road, in equilibrium.

    Raises
    ------
    DesignError
        If a headway or distance is negative, or the speed or the spacing is not positive.

    Notes
    -----
    docs/theory.md, section 4 (The exact region and the exact minimum headway).

    Examples
    --------
    >>> round(capacity(0.9375, 30.0, 5.0)), round(capacity(0.6, 30.0, 5.0))
    (3260, 4696)
    """
    require_positive("speed", speed, "m/s")
    require(
        time_headway >= 0 and distance >= 0,
        f"time_headway = {time_headway:g} s and distance = {distance:g} m must not be negative: "
        "vehicles would overlap. Give both as 0 or more.",
    )
    spacing = distance + time_headway * speed
    require_positive("distance + time_headway speed", spacing, "m")
    return 3600.0 * speed / spacing
