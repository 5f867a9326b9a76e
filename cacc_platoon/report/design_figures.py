"""All pictures of one design question, saved as SVG and PNG."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from cacc_platoon.figures import design as figures
from cacc_platoon.theory.curves import (
    bound_curves,
    headway_over_snr,
    response_band,
    slope_curve,
)
from cacc_platoon.theory.errors import DesignError
from cacc_platoon.theory.region import exact_region
from cacc_platoon.theory.theorem2 import paper_region

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from cacc_platoon.design.requirements import Recommendation
    from cacc_platoon.model.control import Gains

__all__ = ["save_gallery"]

_RHOS = (2.0, 5.0, 20.0, 1000.0)


def save_gallery(
    folder: Path,
    gains: Gains,
    rho: float,
    tau_max: float,
    *,
    k_effective: float | None = None,
    recommendation: Recommendation | None = None,
) -> list[Path]:
    """Draw and save every picture of a design question.

    Parameters
    ----------
    folder : Path
        Made when missing; pictures of the same names in it are replaced.
    gains : Gains
        Operating point.
    rho, tau_max : float
        SNR and largest lag [s].
    k_effective : float, optional
        Effective gain of the nominal response.
    recommendation : Recommendation, optional
        Adds the Pareto front.

    Returns
    -------
    list of Path
        Files written, SVG and PNG of each picture.

    Raises
    ------
    DesignError
        If the folder cannot be written or matplotlib is not installed.
    """
    written: list[Path] = []
    with _page(folder, "feasible_regions", written, columns=2) as axes:
        paper = paper_region(gains.k_a, gains.time_headway, rho, tau_max)
        exact = exact_region(gains.k_a, gains.time_headway, rho, tau_max)
        for panel, limit in zip(axes, _k_p_limits(paper.polygon, gains, exact), strict=True):
            figures.plot_regions(panel, paper, exact, gains, limit)
    with _page(folder, "frequency_response", written, columns=2) as axes:
        band = response_band(gains, rho, tau_max, k_effective=k_effective)
        figures.plot_response(axes[0], band)
        figures.plot_response(axes[1], band, close=True)
    with _page(folder, "headway_slope", written) as axes:
        figures.plot_slope(axes[0], slope_curve(rho))
    with _page(folder, "headway_bounds", written) as axes:
        rhos = sorted({*_RHOS, rho}) if rho < 1e6 else _RHOS
        figures.plot_headway_bounds(axes[0], bound_curves(rhos, tau_max))
    with _page(folder, "headway_over_snr", written) as axes:
        figures.plot_headway_over_snr(axes[0], headway_over_snr(tau_max))
    with _page(folder, "noise_regions", written, columns=2) as axes:
        figures.plot_noise_regions(axes[0], axes[1], rho)
    if recommendation is not None:
        with _page(folder, "pareto_front", written) as axes:
            cap = 3.0 * tau_max
            mappable = figures.plot_pareto_front(
                axes[0], recommendation.front, recommendation.designs, cap
            )
            axes[0].figure.colorbar(mappable, label="L-infinity gain [-]")
    return written


def _k_p_limits(
    polygon: tuple[tuple[float, float], ...], gains: Gains, exact: Any
) -> tuple[float, float]:
    """Choose a close view, around S or the operating point, and a wide one."""
    near = max([gains.k_p, *(k_p for k_p, _ in polygon)]) * 1.4
    wide = max(8.0 * near, 1.0 / exact.tau_max**2)
    return near, max(wide, 2.0 * exact.k_p_min if exact.nonempty else 0.0)


@contextmanager
def _page(folder: Path, name: str, written: list[Path], columns: int = 1) -> Iterator[Any]:
    """Yield a row of axes, then save the page as SVG and PNG, the same bytes every time."""
    try:
        from matplotlib import rc_context  # noqa: PLC0415
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415
        from matplotlib.figure import Figure  # noqa: PLC0415
    except ImportError as error:
        raise DesignError(
            "matplotlib is not installed: no picture can be drawn. Install it or leave the "
            "pictures out."
        ) from error
    with rc_context({"svg.hashsalt": "cacc_platoon", "svg.fonttype": "none"}):
        figure = Figure(figsize=(6.0 * columns, 4.2), layout="constrained")
        FigureCanvasAgg(figure)
        axes = np.atleast_1d(figure.subplots(1, columns))
        for panel in axes:
            panel.grid(alpha=0.3)
        yield axes
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for suffix, metadata in ((".svg", {"Date": None}), (".png", None)):
                path = folder / f"{name}{suffix}"
                figure.savefig(path, dpi=140, metadata=metadata)
                written.append(path)
        except OSError as error:
            raise DesignError(
                f"{folder} cannot be written ({error.strerror}): the pictures are lost. Choose "
                "another folder."
            ) from error
