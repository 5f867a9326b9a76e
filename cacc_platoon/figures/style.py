"""How every figure looks: one palette that colour-blind readers can tell apart, SVG and PNG."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from cacc_platoon.simulation.trajectory import Array

Axes: TypeAlias = Any
"""matplotlib's Axes; its import waits until something is drawn."""

BLUE, ORANGE, GREEN, RED, PURPLE = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7")
"""Okabe and Ito's palette, told apart with every kind of colour vision."""

INK, GREY, FAINT = "#202020", "#595959", "#d9d9d9"
"""For points and axes, for what stands back, for grids."""

LINES = ((BLUE, "-"), (RED, "--"), (GREEN, "-."), (PURPLE, ":"), (INK, "-"))
"""Curves of one kind: each differs from the others in its line, too."""

WIDTH = 5.4
"""Width of one column [inch]: its letters are still legible on a phone."""

POINTS = 600
"""Bins into which long signals are reduced before they are drawn."""

PIXELS_PER_INCH = 140
"""Of a figure that is saved as PNG."""

_LIGHTEST = 0.25  # share of a colour in its lightest shade
_BETWEEN, _MOST_APART = 0.06, 20  # of a row's height left free, and up to how many rows

_DECIMALS = re.compile(r"(\.\d\d)\d+")

_RC = {
    "axes.axisbelow": True,
    "axes.edgecolor": "#404040",
    "axes.grid": True,
    "axes.labelsize": 10,
    "axes.prop_cycle": f"cycler('color', ['{BLUE}', '{ORANGE}', '{GREEN}', '{RED}', '{PURPLE}'])",
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 10.5,
    "figure.constrained_layout.use": True,
    "font.family": "sans-serif",
    "font.size": 10,
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "svg.fonttype": "none",
}


@contextmanager
def styled(name: str) -> Iterator[None]:
    """Draw in the project's style; `name` makes the identifiers inside of the SVG its own."""
    import matplotlib as mpl  # noqa: PLC0415  (slow to import)

    with mpl.rc_context({**_RC, "svg.hashsalt": name}):
        yield


def draw_svg(
    name: str, draw: Callable[..., None], rows: int = 1, height: float = 3.1, columns: int = 1
) -> str:
    """Return a figure as SVG text that can stand inside of HTML and refers to nothing outside.

    Parameters
    ----------
    name : str
        What the figure shows, for readers who cannot see it.
    draw : callable
        Draws on the axes it is given, `rows` times `columns` of them.
    rows, columns : int, optional
        How the axes are arranged.
    height : float, optional
        Height [inch]; the width of one column is `WIDTH`.
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG  # noqa: PLC0415

    buffer = io.StringIO()
    with styled(name):
        FigureCanvasSVG(_figure(draw, rows, height, columns)).print_svg(buffer)
    return _inline(buffer.getvalue(), name)


def draw_png(
    name: str, draw: Callable[..., None], rows: int = 1, height: float = 3.1, columns: int = 1
) -> bytes:
    """Return the figure that `draw_svg` returns, as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: PLC0415

    buffer = io.BytesIO()
    with styled(name):
        figure = _figure(draw, rows, height, columns)
        figure.dpi = PIXELS_PER_INCH
        FigureCanvasAgg(figure).print_png(buffer)
    return buffer.getvalue()


def _figure(draw: Callable[..., None], rows: int, height: float, columns: int) -> Any:
    """Return a figure to be printed by a canvas: `savefig` would draw all of it twice."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(WIDTH * columns, height))
    draw(*figure.subplots(rows, columns, squeeze=False).flat)
    return figure


def _inline(svg: str, name: str) -> str:
    """Leave only what HTML needs: no prolog, metadata, namespaces or fixed size; two decimals."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r' xmlns(:\w+)?="[^"]*"', "", svg)
    svg = svg.replace("xlink:href", "href")
    svg = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r' d="[^"]*"', lambda path: _DECIMALS.sub(r"\1", path[0]), svg)
    label = html.escape(name, quote=True)
    return svg.replace("<svg", f'<svg role="img" aria-label="{label}"', 1).rstrip() + "\n"


def standalone(svg: str) -> str:
    """Return an inline SVG as a file of its own."""
    return svg.replace("<svg", '<svg xmlns="http://www.w3.org/2000/svg"', 1)


def fill(
    axes: Axes, x: Array, low: Array, high: Array, *, color: str = BLUE, label: str | None = None
) -> None:
    """Draw the band between two curves, as light as every band."""
    axes.fill_between(x, low, high, color=color, alpha=0.2, linewidth=0.0, label=label)


def reduce(time: Array, values: Array, points: int = POINTS) -> tuple[Array, Array]:
    """Return fewer points that look the same: the smallest and largest value of every bin.

    Parameters
    ----------
    time, values : ndarray, shape (n,)
        A signal; NaN leaves a gap.
    points : int
        Number of bins.

    Examples
    --------
    >>> t, v = reduce(np.arange(10_000.0), np.sin(np.arange(10_000.0)))
    >>> len(t), float(v.max()) > 0.9999
    (1200, True)
    """
    if len(values) <= 2 * points:
        return time, values
    edges = np.linspace(0, len(values), points + 1).astype(np.int64)
    filled_low = np.where(np.isnan(values), np.inf, values)
    filled_high = np.where(np.isnan(values), -np.inf, values)
    picks = []
    for begin, end in pairwise(edges.tolist()):
        pair = (
            begin + int(np.argmin(filled_low[begin:end])),
            begin + int(np.argmax(filled_high[begin:end])),
        )
        picks += sorted(pair)
    index = np.array(picks)
    return time[index], values[index]


def vehicle_colours(count: int) -> list[Any]:
    """Return one colour per vehicle along a perceptually even scale, the first the darkest."""
    import matplotlib as mpl  # noqa: PLC0415

    return [mpl.colormaps["viridis"](0.9 * i / max(count - 1, 1)) for i in range(count)]


def shades(color: str, count: int) -> list[Any]:
    """Return shades of a colour, from light to itself.

    Examples
    --------
    >>> [tuple(round(float(part), 2) for part in shade) for shade in shades("#0000ff", 2)]
    [(0.75, 0.75, 1.0), (0.0, 0.0, 1.0)]
    """
    from matplotlib.colors import to_rgb  # noqa: PLC0415

    full = np.array(to_rgb(color))
    return [tuple(1.0 - s * (1.0 - full)) for s in np.linspace(_LIGHTEST, 1.0, count)]


def draw_cells(axes: Axes, edges: Array, level: npt.NDArray[np.int64], colours: list[Any]) -> None:
    """Draw rows of coloured cells, one path a colour, so that the file stays small.

    Parameters
    ----------
    axes : Axes
        Where to draw; row i lies around y = i.
    edges : ndarray, shape (n + 1,)
        Where the cells of a row begin and end.
    level : ndarray of int, shape (rows, n)
        Which of the colours each cell has, -1 for none; equal neighbours are drawn as one.
    colours : list
        As matplotlib takes them.
    """
    from matplotlib.patches import PathPatch  # noqa: PLC0415
    from matplotlib.path import Path  # noqa: PLC0415

    half = 0.5 - (_BETWEEN if len(level) <= _MOST_APART else 0.0)
    corners: list[list[tuple[float, float]]] = [[] for _ in colours]
    for row, levels in enumerate(level):
        ends = [0, *(np.flatnonzero(np.diff(levels)) + 1).tolist(), len(levels)]
        for begin, end in pairwise(ends):
            if levels[begin] >= 0:
                low, high = float(edges[begin]), float(edges[end])
                top, bottom = row - half, row + half
                box = [(low, top), (high, top), (high, bottom), (low, bottom), (low, top)]
                corners[levels[begin]] += box
    codes = [Path.MOVETO, *[Path.LINETO] * 3, Path.CLOSEPOLY]
    for colour, box in zip(colours, corners, strict=True):
        if box:
            path = Path(box, codes * (len(box) // len(codes)))
            axes.add_patch(PathPatch(path, facecolor=colour, linewidth=0.0))
    axes.set_xlim(edges[0], edges[-1])
    axes.set_ylim(len(level) - 0.5, -0.5)


def spread(count: int, at_most: int) -> list[int]:
    """Return `at_most` of 0..count-1, evenly spread, the first and the last among them.

    Examples
    --------
    >>> spread(101, 5)
    [0, 25, 50, 75, 100]
    """
    if count <= at_most:
        return list(range(count))
    return [round(i * (count - 1) / (at_most - 1)) for i in range(at_most)]
