"""Figures of the gains that are string stable: the exact region and the paper's S inside of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cacc_platoon.figures.style import BLUE, INK, ORANGE, PURPLE, RED, Axes, fill
from cacc_platoon.model import Gains
from cacc_platoon.theory import ExactRegion, PaperRegion


def plot_regions(
    axes: Axes, paper: PaperRegion, exact: ExactRegion, gains: Gains, *, wide: bool = False
) -> None:
    """Draw the exact robust region, the paper's S inside it, and the operating point.

    Parameters
    ----------
    axes : Axes
        Where to draw.
    paper, exact : PaperRegion, ExactRegion
        Of one headway.
    gains : Gains
        The operating point.
    wide : bool, optional
        Show all that ``k_p`` may be, not S and the operating point from near.
    """
    limit = _k_p_limit(paper, exact, gains, wide)
    k_p = limit * np.linspace(0.0, 1.0, 600) ** 2
    low, high = exact.bounds(k_p)
    inside = (k_p >= exact.k_p_min) & (high >= low)
    if inside.any():
        fill(axes, k_p[inside], low[inside], high[inside], label="exact, robust")
        for edge in (low, high):
            axes.plot(k_p[inside], edge[inside], color=BLUE)
        bottom = min(float(np.min(low[inside])), gains.k_v)
        top = max(float(np.max(high[inside])), gains.k_v)
        axes.set_ylim(max(0.0, 1.08 * bottom - 0.08 * top), 1.08 * top - 0.08 * bottom)
    else:
        axes.set_ylim(0.0, 1.5 * max(gains.k_v, paper.a1, paper.a2))
    _plot_paper_region(axes, paper, k_p)
    look = {"color": INK, "mfc": "white", "mew": 1.8, "clip_on": False, "zorder": 3}
    axes.plot(gains.k_p, gains.k_v, "o", label="operating point", **look)
    axes.set_xlim(0.0, limit)
    axes.set_xlabel(r"$k_p$ [1/s$^2$]")
    axes.set_ylabel(r"$k_v$ [1/s]")
    empty = "" if exact.nonempty else ": no robust gains"
    axes.set_title(rf"$k_a$ = {exact.k_a:.4g}, $h_w$ = {exact.time_headway:.4g} s{empty}")
    axes.legend()


def _k_p_limit(paper: PaperRegion, exact: ExactRegion, gains: Gains, wide: bool) -> float:
    """Choose a close view, around S or the operating point, or a wide one."""
    near = max([gains.k_p, *(k_p for k_p, _ in paper.polygon)]) * 1.4
    if not wide:
        return near
    farthest = max(8.0 * near, 1.0 / exact.tau_max**2)
    return max(farthest, 2.0 * exact.k_p_min if exact.nonempty else 0.0)


def _plot_paper_region(axes: Axes, paper: PaperRegion, k_p: NDArray[np.float64]) -> None:
    """Draw S, or where it is empty the two lines that leave nothing between them."""
    if paper.nonempty:
        axes.fill(
            *np.transpose(paper.polygon),
            facecolor=ORANGE,
            edgecolor=RED,
            label=r"paper's $S$ (sufficient)",
        )
    for intercept, slope, color, name in (
        (paper.a1, paper.a1 / paper.b1, RED, r"$S_1$: below"),
        (paper.a2, paper.a2 / paper.b2, PURPLE, r"$S_2$: above"),
    ):
        if not paper.nonempty:
            axes.plot(k_p, intercept - slope * k_p, color=color, ls="--", lw=1.0, label=name)
