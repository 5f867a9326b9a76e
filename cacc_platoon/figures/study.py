"""Figures of a study: a value over one parameter, or over two."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from cacc_platoon.figures.style import BLUE, INK, Axes

_DECADES = 30.0
"""An axis that spans a larger ratio is drawn on a log scale."""


def plot_curve(axes: Axes, x: npt.ArrayLike, y: npt.ArrayLike, names: Sequence[str]) -> None:
    """Draw a value over a parameter; `names` are those of the parameter and of the value."""
    axes.plot(x, y, "o-", color=BLUE, ms=3.5)
    axes.set_xlabel(names[0])
    axes.set_ylabel(names[1])
    _scale(axes.set_xscale, x)


def plot_map(
    axes: Axes,
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    values: npt.NDArray[np.float64],
    names: Sequence[str],
    *,
    share: bool = False,
) -> None:
    """Draw a value over two parameters, what is unknown left white.

    Parameters
    ----------
    axes : Axes
        Where.
    x, y : array_like, shapes (n,) and (m,)
        The parameters.
    values : ndarray, shape (n, m)
        The value.
    names : sequence of str
        Of x, y and the value.
    share : bool, optional
        Whether it is a share, from 0 to 1.
    """
    drawn = axes.pcolormesh(
        *(np.asarray(one, float) for one in (x, y)),
        np.ma.masked_invalid(values.T),
        shading="nearest",
        cmap="viridis",
        **({"vmin": 0.0, "vmax": 1.0} if share else {}),
    )
    _scale(axes.set_xscale, x)
    _scale(axes.set_yscale, y)
    axes.grid(visible=False)
    axes.set_xlabel(names[0])
    axes.set_ylabel(names[1])
    bar = axes.figure.colorbar(drawn, ax=axes)
    bar.set_label(names[2])
    bar.outline.set_edgecolor(INK)


def _scale(choose: Callable[[str], object], values: npt.ArrayLike) -> None:
    low, high = np.min(np.asarray(values)), np.max(np.asarray(values))
    if low > 0.0 and high / low > _DECADES:
        choose("log")
