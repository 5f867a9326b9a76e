"""The study as tables and a figure; everything from what study.json holds."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cacc_platoon.figures.style import FAINT, GREY, INK, LINES, Axes, draw_svg, standalone

BEGIN, END = "<!-- study.py -->", "<!-- end of study.py -->"
_HEADS = (
    *("design", "channel", "theory, w = 1", "theory, noise"),
    *("sine, in the mean", "brake, in the mean", "smallest gap, one run", "and in the mean"),
)
_DARK = "blackout, "
HEIGHT = 1.9
"""Of one panel of the figure [inch]."""

Study = Mapping[str, Any]


def with_tables(page: str, study: Study) -> str:
    """Return a page with the tables of a study in the place of those it has."""
    return between(page, BEGIN, END, tables(study))


def between(page: str, begin: str, end: str, text: str) -> str:
    """Return a page with a text in the place of what it has between two marks."""
    old = re.compile(f"{re.escape(begin)}\n.*?{re.escape(end)}", re.DOTALL)
    return old.sub(lambda _: f"{begin}\n{text}\n{end}", page)


def tables(study: Study) -> str:
    """Return summary, designs and all numbers as Markdown."""
    designs, ways = study["designs"], [row["channel"] for row in study["designs"][0]["rows"]]
    gains = [
        (
            one["name"],
            *(f"{one['gains'][key]:.4g}" for key in ("time_headway", "k_a", "k_v", "k_p")),
            one["origin"],
        )
        for one in designs
    ]
    parts = [
        markdown(
            ("design", *(_head(study, way) for way in ways)),
            [(one["name"], *map(_answer, one["rows"])) for one in designs],
        ),
        _beside(study),
        markdown(("design", "h_w [s]", "k_a", "k_v [1/s]", "k_p [1/s^2]", "from"), gains),
        markdown(_HEADS, [_cells(one, row) for one in designs for row in one["rows"]]),
    ]
    return "\n\n".join(parts)


def markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _head(study: Study, way: str) -> str:
    """Say what is judged: a packet at fixed times in the place of CAM, or a run."""
    fixed = way.replace("CAM", f"theory, every {study['packets']['period']:g} s as CAM")
    return f"theory, {way}" if way == "ideal" else fixed.replace(_DARK, f"one run, {_DARK}")


def _answer(row: Study) -> str:
    """Say whether a design stays string stable on a channel, or keeps apart in the dark."""
    if row["channel"].startswith(_DARK):
        return f"apart, {row['gap']:.2f} m" if row["gap"] > 0.0 else "**collides**"
    if row["theory_noisy"] == 1.0:
        return "string stable"
    return "stable without noise" if row["theory"] == 1.0 else "**grows**"


def _beside(study: Study) -> str:
    rows = [row for one in study["designs"] for row in one["rows"]]
    hardest, backwards = (max(row[key] for row in rows) for key in ("hardest", "backwards"))
    return (
        f"No follower brakes harder than {hardest:.1f} m/s^2; some roll back at up to "
        f"{backwards:.1f} m/s before they stand, for the model is linear."
    )


def _cells(design: Study, row: Study) -> tuple[str, ...]:
    return (
        design["name"],
        row["channel"],
        *(_growth(row, key) for key in ("theory", "theory_noisy")),
        *(_hops(row[key]) for key in ("sine", "brake")),
        *(_gap(row[key]) for key in ("gap", "gap_mean")),
    )


def _growth(row: Study, key: str) -> str:
    if row["channel"].startswith(_DARK):
        return "-"
    return "unstable" if row[key] is None else f"{row[key]:.4f}"


def _hops(growth: Study | None) -> str:
    return "-" if growth is None else f"{growth['platoon']:.3f} ({growth['hop']:.3f})"


def _gap(gap: float) -> str:
    return f"{gap:.2f} m" if gap > 0.0 else f"**{gap:.2f} m**"


def figure(study: Study) -> str:
    """Return the figure as an SVG file."""
    name = "Growth per hop over the V2V period, and gaps in a full brake without V2V"
    rows = 2 + len(study["designs"])
    return standalone(draw_svg(name, lambda *axes: draw(axes, study), rows, HEIGHT * rows))


def draw(axes: Sequence[Axes], study: Study) -> None:
    """Draw theory in the first two of the axes, the brake of one design in each other."""
    _draw_growth(axes[0], study, "theory", "no noise")
    _draw_growth(axes[1], study, "theory_noisy", f"noise up to $\\rho$ = {study['rho']:g}")
    axes[0].legend(loc="upper left")
    late = study["packets"]
    lost, latency = 100.0 * (1.0 - late["held"]), 1000.0 * late["latency"]
    axes[1].set_xlabel(f"packet to packet [s], {lost:.0f} % lost, {latency:.0f} ms late")
    for place, one in zip(axes[2:], study["designs"], strict=True):
        _draw_gaps(place, study, one)
    axes[2].legend(loc="upper right", ncols=2)
    axes[-1].set_xlabel("time [s]")


def _draw_growth(axes: Axes, study: Study, key: str, noise: str) -> None:
    for one, (colour, line) in zip(study["designs"], LINES, strict=False):
        growth = [np.nan if g is None else 100.0 * (g - 1.0) for g in one["growth"][key]]
        axes.plot(study["periods"], growth, line, color=colour, label=one["name"], linewidth=1.6)
    cam = study["packets"]["period"]
    axes.axvline(cam, color=GREY, linewidth=0.8, zorder=0)
    axes.text(cam, 3.9, " CAM at 25 m/s", color=GREY, ha="left", fontsize=8.5)
    axes.set_title(f"theory, {noise}: growth per hop")
    axes.set_ylabel("growth [%]")
    axes.set_xlim(0.0, max(study["periods"]))
    axes.set_ylim(-0.2, 4.5)


def _draw_gaps(axes: Axes, study: Study, design: Study) -> None:
    shown = [row for row in design["rows"] if row["channel"].startswith(("CAM, ", _DARK))]
    begin, end, step = study["shown"]
    for row, (colour, line) in zip(shown, LINES, strict=True):
        gaps = np.array(row["nearest"])
        label = row["channel"].removeprefix(_DARK)
        times = begin + step * np.arange(len(gaps))
        axes.plot(times, gaps, line, color=colour, label=label, linewidth=1.6)
    axes.axhline(0.0, color=INK, linewidth=0.8, zorder=0)
    axes.axhspan(-12.0, 0.0, color=FAINT, alpha=0.5, linewidth=0.0, zorder=0)
    axes.text(end, -3.6, "collision ", color=GREY, ha="right", fontsize=8.5)
    axes.set_title(f"{design['name']}, full brake: smallest of all gaps")
    axes.set_ylabel("gap [m]")
    axes.set_xlim(begin, end)
    axes.set_ylim(-4.0, 13.0)
