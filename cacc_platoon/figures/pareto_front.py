"""The figure of a Pareto set of designs: what a shorter headway costs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cacc_platoon.design import Design
from cacc_platoon.figures.style import INK, RED, Axes


def plot_pareto_front(
    axes: Axes, front: Sequence[Design], named: Sequence[Design], latency_cap: float
) -> None:
    """Draw latency margin over headway, coloured by L-infinity gain, sized by speed.

    Margins above `latency_cap` [s], infinite ones too, are drawn at the cap as triangles. Where
    packets have a period of their own, the critical one [s] stands beside each design.
    """
    x, margin, color, slowest = np.array(
        [
            (
                design.gains.time_headway,
                design.certificate.latency_margin,
                design.certificate.linf_gain,
                design.certificate.slowest_time_constant,
            )
            for design in front
        ]
    ).T
    size = 20.0 + 160.0 / (1.0 + slowest / 10.0)
    beyond = margin > latency_cap
    for marker, mask in (("o", ~beyond), ("^", beyond)):
        points = axes.scatter(
            x[mask],
            np.minimum(margin[mask], latency_cap),
            c=color[mask],
            s=size[mask],
            marker=marker,
            cmap="cividis",
            vmin=color.min(),
            vmax=max(color.max(), color.min() + 1e-6),
            edgecolors=INK,
            linewidths=0.5,
        )
    axes.figure.colorbar(points, ax=axes, label=r"$L_\infty$ gain [-]")
    axes.margins(0.08)
    _plot_critical_periods(axes, front, latency_cap)
    _plot_names(axes, named, latency_cap)
    axes.set_xlabel(r"time headway $h_w$ [s]")
    axes.set_ylabel("margin of constant V2V latency [s]")
    rated = any(design.certificate.v2v_period for design in front)
    more = "\nsmall figures: critical V2V period [s]" if rated else ""
    axes.set_title(f"large marker: fast slowest mode; triangle: beyond the axis{more}")


def _plot_critical_periods(axes: Axes, front: Sequence[Design], latency_cap: float) -> None:
    for design in front:
        one = design.certificate
        if one.v2v_period is not None:
            place = (design.gains.time_headway, min(one.latency_margin, latency_cap))
            text = f"{one.critical_v2v_period:.3g}".replace("inf", "any")
            axes.annotate(
                text, place, xytext=(0, -9), textcoords="offset points", ha="center", fontsize=6
            )


def _plot_names(axes: Axes, named: Sequence[Design], latency_cap: float) -> None:
    """Write the names beside their designs, towards the middle; one place, one label."""
    places: dict[tuple[float, float], list[str]] = {}
    for design in named:
        height = min(design.certificate.latency_margin, latency_cap)
        places.setdefault((design.gains.time_headway, height), []).append(design.name)
    for x, y in places:
        axes.plot(x, y, "+", color=RED, ms=12, mew=1.8)
    middle = np.mean(axes.get_xlim())
    for (x, y), names in places.items():
        side, align = (9, "left") if x < middle else (-9, "right")
        axes.annotate(
            ", ".join(names),
            (x, y),
            xytext=(side, 0),
            textcoords="offset points",
            ha=align,
            va="center",
            fontsize=8.5,
        )
