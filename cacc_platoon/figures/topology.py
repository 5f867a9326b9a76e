"""Figure of who hears and measures whom (the paper's Fig. 1)."""

from __future__ import annotations

from cacc_platoon.figures.style import BLUE, FAINT, GREY, INK, ORANGE, Axes

_SPAN, _LONG, _TALL = 1.0, 0.46, 0.2
"""Distance between vehicles, their length and height, in units of the drawing."""


def plot_topology(axes: Axes, followers: int) -> None:
    """Draw leader, the first followers and the last, each with what it knows of the one ahead.

    Parameters
    ----------
    axes : Axes
        Where to draw.
    followers : int
        N, at least 1; the last vehicle carries this number.
    """
    left_out = followers > 4
    shown = [0, 1, 2, followers] if left_out else list(range(followers + 1))
    places = {index: -_SPAN * place for place, index in enumerate(shown)}
    if left_out:
        places[followers] -= _SPAN
        axes.text(-3 * _SPAN, 0.5 * _TALL, "...", ha="center", va="center", color=INK, fontsize=14)
    for index, x in places.items():
        _vehicle(axes, x, index)
        if index:
            _link(axes, x + _SPAN, x, index)
    last = min(places.values())
    axes.plot([last - 0.4, 0.5], [-0.09, -0.09], color=GREY, linewidth=0.8)
    _arrow(axes, (0.18, -0.2), (0.5, -0.2), INK)
    axes.text(0.16, -0.2, "driving direction", ha="right", va="center", fontsize=8)
    axes.plot([], [], color=ORANGE, linestyle="--", label="V2V: acceleration, times noise $w$")
    axes.plot([], [], color=BLUE, label="on-board sensors: distance, velocity difference")
    axes.set_xlim(last - 0.4, 0.5)
    axes.set_ylim(-0.28, 0.92)
    axes.set_axis_off()
    axes.legend(loc="upper center", ncols=2, fontsize=7.5, columnspacing=1.0)


def _vehicle(axes: Axes, x: float, index: int) -> None:
    half = 0.5 * _LONG
    outline = [(-half, 0.0), (-half, 0.6), (-0.55 * half, 1.0), (0.35 * half, 1.0)]
    outline += [(0.7 * half, 0.6), (half, 0.5), (half, 0.0)]
    sides = zip(*[(x + dx, _TALL * up) for dx, up in outline], strict=True)
    axes.fill(*sides, facecolor=FAINT, edgecolor=INK, linewidth=0.9)
    for wheel in (-0.55 * half, 0.55 * half):
        axes.plot([x + wheel], [-0.03], "o", color=INK, markersize=4.5)
    axes.text(x, 0.45 * _TALL, str(index), ha="center", va="center", fontsize=9, color=INK)


def _link(axes: Axes, ahead: float, behind: float, index: int) -> None:
    """Draw what follower `index` has of its predecessor, and the names of it."""
    middle, half = 0.5 * (ahead + behind), 0.5 * _LONG
    _arrow(axes, (ahead, 0.3), (behind, 0.3), ORANGE, curve=0.35, style="--")
    text = f"$w_{{{index},{index - 1}}}\\,a_{{{index - 1}}}$"
    axes.text(middle, 0.63, text, ha="center", va="center", fontsize=8.5, color=INK)
    _arrow(axes, (behind + half, 0.07), (ahead - half, 0.07), BLUE)
    gap = f"$x_{{{index - 1}}},v_{{{index - 1}}}$"
    axes.text(middle, 0.15, gap, ha="center", va="center", fontsize=7.5, color=INK)


def _arrow(
    axes: Axes,
    start: tuple[float, float],
    end: tuple[float, float],
    color: str,
    *,
    curve: float = 0.0,
    style: str = "-",
) -> None:
    shape = {"arrowstyle": "-|>", "color": color, "linestyle": style, "shrinkA": 0, "shrinkB": 0}
    shape["connectionstyle"] = f"arc3,rad={curve}"
    axes.annotate("", xy=end, xytext=start, arrowprops=shape)
