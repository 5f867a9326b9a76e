"""A picture of a platoon as one line, for logs."""

from __future__ import annotations

from collections.abc import Iterator

from cacc_platoon.live.picture import Picture, VehicleNow
from cacc_platoon.live.table import progress


def summary_line(picture: Picture) -> str:
    """Return how far a platoon is, and its extremes, in one line."""
    return ", ".join([picture.namespace, *progress(picture), *_extremes(picture)])


def _extremes(picture: Picture) -> Iterator[str]:
    errors = [(one.spacing_error, one) for one in picture.vehicles if one.spacing_error is not None]
    if errors:
        error, vehicle = max(errors, key=lambda found: abs(found[0]))
        yield f"largest spacing error {error:+.3f} m ({_name(vehicle)})"
    gaps = [(one.gap, one) for one in picture.vehicles if one.gap is not None]
    if gaps:
        gap, vehicle = min(gaps, key=lambda found: found[0])
        yield f"smallest gap {gap:.2f} m ({_name(vehicle)})"
    for state in ("fallback", "degrading", "recovering"):
        if found := [str(one.index) for one in picture.vehicles if one.reception == state]:
            yield f"{state}: {' '.join(found)}"
    if alarmed := [str(one.index) for one in picture.vehicles if one.alarm]:
        yield f"alarm: {' '.join(alarmed)}"


def _name(vehicle: VehicleNow) -> str:
    return f"vehicle {vehicle.index}"
