"""Pictures of a design question: each takes records and axes; nothing is computed here.

Colours are Okabe and Ito's, told apart with every kind of colour vision; lines differ in style
too. Matplotlib is imported only when a picture is saved.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cacc_platoon.theory.noise_interval import effective_interval

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from cacc_platoon.design.requirements import Design
    from cacc_platoon.model.control import Gains
    from cacc_platoon.theory.curves import BoundCurve, HeadwayOverSnr, ResponseBand, SlopeCurve
    from cacc_platoon.theory.region import ExactRegion
    from cacc_platoon.theory.theorem2 import PaperRegion

__all__ = [
    "plot_headway_bounds",
    "plot_headway_over_snr",
    "plot_noise_regions",
    "plot_pareto_front",
    "plot_regions",
    "plot_response",
    "plot_slope",
]

BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, BLACK = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#56B4E9",
    "#000000",
)
_CYCLE = ((BLUE, "-"), (VERMILION, "--"), (GREEN, "-."), (PURPLE, ":"), (BLACK, "-"))


def plot_regions(
    axes: Any, paper: PaperRegion, exact: ExactRegion, gains: Gains | None, k_p_limit: float
) -> None:
    """Draw the exact robust region, the paper's S inside it, and the operating point."""
    k_p = k_p_limit * np.linspace(0.0, 1.0, 600) ** 2
    low, high = exact.bounds(k_p)
    inside = (k_p >= exact.k_p_min) & (high >= low)
    if inside.any():
        axes.fill_between(
            k_p[inside], low[inside], high[inside], color=SKY, alpha=0.45, label="exact, robust"
        )
        for edge in (low, high):
            axes.plot(k_p[inside], edge[inside], color=BLUE, lw=1.2)
    _plot_paper_region(axes, paper, k_p)
    if gains is not None:
        axes.plot(
            gains.k_p, gains.k_v, "o", color=BLACK, mfc="white", mew=1.8, label="operating point"
        )
    axes.set_xlim(0.0, k_p_limit)
    if inside.any():
        bottom, top = float(np.min(low[inside])), float(np.max(high[inside]))
        if gains is not None:
            bottom, top = min(bottom, gains.k_v), max(top, gains.k_v)
        axes.set_ylim(max(0.0, 1.08 * bottom - 0.08 * top), 1.08 * top - 0.08 * bottom)
    elif gains is not None:
        axes.set_ylim(0.0, 1.5 * max(gains.k_v, paper.a1, paper.a2))
    axes.set_xlabel(r"$k_p$ [1/s$^2$]")
    axes.set_ylabel(r"$k_v$ [1/s]")
    empty = "" if exact.nonempty else ": no robust gains"
    axes.set_title(rf"$k_a$ = {exact.k_a:.4g}, $h_w$ = {exact.time_headway:.4g} s{empty}")
    axes.legend(loc="best", fontsize="small")


def _plot_paper_region(axes: Any, paper: PaperRegion, k_p: NDArray[np.float64]) -> None:
    """Draw S, or where it is empty the two lines that leave nothing between them."""
    if paper.nonempty:
        axes.fill(
            *np.transpose(paper.polygon),
            facecolor=ORANGE,
            edgecolor=VERMILION,
            label="paper's S (sufficient)",
        )
    for intercept, slope, color, name in (
        (paper.a1, paper.a1 / paper.b1, VERMILION, "S1: below"),
        (paper.a2, paper.a2 / paper.b2, PURPLE, "S2: above"),
    ):
        if not paper.nonempty:
            axes.plot(k_p, intercept - slope * k_p, color=color, ls="--", lw=1.0, label=name)


def plot_response(axes: Any, band: ResponseBand, *, close: bool = False) -> None:
    """Draw ``|H|`` over frequency with the band of lag and effective gain, or `close` to one."""
    axes.fill_between(
        band.omega,
        band.low,
        band.high,
        color=SKY,
        alpha=0.5,
        label=r"$\tau \in (0, \tau_0]$, $\tilde k_a \in I$",
    )
    axes.plot(
        band.omega,
        band.nominal,
        color=BLUE,
        label=rf"$\tau = \tau_0$, $\tilde k_a$ = {band.k_effective:.4g}",
    )
    axes.axhline(1.0, color=VERMILION, ls="--", lw=1.0, label=r"$|H| = 1$")
    axes.set_xscale("log")
    peak = max(1.0, float(np.max(band.high)))
    zoom = (1.0 - max(0.004, 2.0 * (peak - 1.0)), peak + max(0.001, 0.5 * (peak - 1.0)))
    axes.set_ylim(*(zoom if close else (0.0, 1.1 * peak)))
    axes.set_xlabel(r"$\omega$ [rad/s]")
    axes.set_ylabel(r"$|H(j\omega)|$ [-]")
    axes.legend(loc="lower left", fontsize="small")


def plot_slope(axes: Any, curve: SlopeCurve) -> None:
    """Draw the paper's f(k_a) with both roots and the cap."""
    axes.plot(curve.k_a, curve.slope, color=BLUE, label=r"$f(k_a) = -mnk_a^2 + 2nk_a - m$")
    axes.axhline(0.0, color=BLACK, lw=0.8)
    axes.axvline(curve.k_a_max, color=VERMILION, ls="--", label=f"cap $k_a$ < {curve.k_a_max:.4g}")
    shown = [root for root in curve.roots if root <= curve.k_a[-1]]
    axes.plot(
        shown,
        np.zeros(len(shown)),
        "o",
        color=BLACK,
        mfc="white",
        label="roots " + ", ".join(f"{root:.4g}" for root in curve.roots),
    )
    axes.set_xlabel(r"$k_a$ [-]")
    axes.set_ylabel(r"$f(k_a)$ [-]")
    axes.legend(loc="best", fontsize="small")


def plot_headway_bounds(axes: Any, curves: Sequence[BoundCurve]) -> None:
    """Draw the paper's bound over k_a for several SNR, the exact minimum thin below each."""
    top = 0.0
    for curve, (color, style) in zip(curves, _CYCLE * len(curves), strict=False):
        axes.plot(curve.k_a, curve.paper, color=color, ls=style, label=rf"$\rho$ = {curve.rho:g}")
        axes.plot(curve.k_a, curve.exact, color=color, lw=0.8)
        axes.plot(*curve.optimum, "o", color=color, mfc="white")
        top = max(top, 1.6 * float(curve.paper[0]))
    axes.plot([], [], color=BLACK, lw=0.8, label="exact minimum (thin)")
    axes.plot([], [], "o", color=BLACK, mfc="white", label=r"$(k_a^*, h^*)$")
    axes.set_ylim(0.0, top)
    axes.set_xlabel(r"$k_a$ [-]")
    axes.set_ylabel(r"headway bound $h_{w,lb}$ [s]")
    axes.legend(loc="best", fontsize="small")


def plot_headway_over_snr(axes: Any, curve: HeadwayOverSnr) -> None:
    """Draw minimal headways over SNR: the paper's, the exact one at k_a*, the infimum."""
    axes.plot(curve.snr_db, curve.paper, color=BLUE, label=r"paper, $h^*$")
    axes.plot(curve.snr_db, curve.exact, color=GREEN, ls="-.", label=r"exact at $k_a^*$")
    axes.plot(curve.snr_db, curve.infimum, color=VERMILION, ls="--", label=r"infimum over $k_a$")
    axes.set_ylim(0.0, 1.08 * float(np.max(curve.paper)))
    axes.set_xlabel("SNR [dB]")
    axes.set_ylabel("minimal headway [s]")
    axes.legend(loc="best", fontsize="small")


def plot_noise_regions(plane: Any, time: Any, rho: float) -> None:
    """Draw the admissible received accelerations, over the true one and over time (Figs. 2, 3)."""
    low, high = effective_interval(1.0, rho)
    a = np.linspace(-1.0, 1.0, 101)
    t = np.linspace(0.0, 2.0 * np.pi / 0.1, 400)
    signal = 0.5 * np.sin(0.1 * t)
    for axes, x, y in ((plane, a, a), (time, t, signal)):
        axes.fill_between(
            x, low * y, high * y, color=SKY, alpha=0.5, label=rf"received, $\rho$ = {rho:g}"
        )
        axes.plot(x, y, color=BLUE, label="sent")
        for edge, style in ((low, ":"), (high, "--")):
            axes.plot(
                x, edge * y, color=VERMILION, ls=style, lw=1.0, label=rf"{edge:.3g} $a_{{i-1}}$"
            )
        axes.axhline(0.0, color=BLACK, lw=0.6)
        axes.set_ylabel(r"$w\,a_{i-1}$ [m/s$^2$]")
        axes.legend(loc="best", fontsize="small")
    plane.set_xlabel(r"$a_{i-1}$ [m/s$^2$]")
    time.set_xlabel("time [s]")


def plot_pareto_front(
    axes: Any, front: Sequence[Design], named: Sequence[Design], latency_cap: float
) -> Any:
    """Draw latency margin over headway, coloured by L-infinity gain, sized by speed.

    Margins above `latency_cap` [s], infinite ones too, are drawn at the cap as triangles.
    Returns the mappable for a colour bar.
    """
    x = np.array([design.gains.time_headway for design in front])
    y = np.array([design.certificate.latency_margin for design in front])
    color = np.array([design.certificate.linf_gain for design in front])
    slowest = np.array([design.certificate.slowest_time_constant for design in front])
    size = 20.0 + 160.0 / (1.0 + slowest / 10.0)
    capped = y > latency_cap
    mappable = None
    for marker, mask in (("o", ~capped), ("^", capped)):
        if mask.any() or mappable is None:
            mappable = axes.scatter(
                x[mask],
                np.minimum(y[mask], latency_cap),
                c=color[mask],
                s=size[mask],
                marker=marker,
                cmap="cividis",
                vmin=color.min(),
                vmax=max(color.max(), color.min() + 1e-6),
                edgecolors=BLACK,
                linewidths=0.5,
            )
    for design in named:
        point = (design.gains.time_headway, min(design.certificate.latency_margin, latency_cap))
        axes.plot(*point, "+", color=VERMILION, ms=12, mew=1.8)
        axes.annotate(design.name, point, xytext=(6, 6), textcoords="offset points")
    axes.set_xlabel(r"time headway $h_w$ [s]")
    axes.set_ylabel("V2V latency margin [s]")
    axes.set_title("large marker: fast slowest mode; triangle: beyond the axis", fontsize="small")
    axes.margins(0.08)
    return mappable
