"""The values of a study along its axes, to be drawn: curves over one axis, maps over two."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from cacc_platoon.sweep.axes import Axis
from cacc_platoon.sweep.plan import Plan
from cacc_platoon.sweep.rows import RowResult


class Map(NamedTuple):
    """A value over one or two numeric axes.

    Attributes
    ----------
    name : str
        What it shows: a column, or a criterion.
    axes : tuple of Axis
        One or two of those of the plan.
    values : ndarray, shape of the axes
        Means over whatever else varies, the places of each axis in ascending order; NaN where
        any row has none.
    share : bool
        Whether they are shares of rows in which something is true.
    over : tuple of str
        What else varies.
    """

    name: str
    axes: tuple[Axis, ...]
    values: npt.NDArray[np.float64]
    share: bool
    over: tuple[str, ...]


def maps(plan: Plan, rows: Mapping[int, RowResult]) -> Iterator[Map]:
    """Yield criteria and columns of numbers over the first numeric axes, two at most.

    What is the same everywhere is left out; seeds are an axis only where nothing else is.
    """
    numeric = [axis for axis in plan.axes if axis.numeric and axis.name != "sample"]
    chosen = [axis for axis in numeric if axis.name != "run.seed"][:2] or numeric[:1]
    if not chosen:
        return
    shape = tuple(len(axis.choices) for axis in plan.axes)
    kept = [plan.axes.index(axis) for axis in chosen]
    over = tuple(
        axis.name
        for number, axis in enumerate(plan.axes)
        if number not in kept and len(axis.choices) > 1
    )
    for name, share, values in _values(plan, rows):
        grid = np.reshape(values, shape)
        summed = tuple(number for number in range(len(shape)) if number not in kept)
        with np.errstate(all="ignore"):
            mean = grid.mean(axis=summed)
        for axis, number in enumerate(kept):  # which are in the order of the plan
            mean = np.take(mean, np.argsort(plan.axes[number].places), axis=axis)
        if np.unique(mean[np.isfinite(mean)]).size > 1:
            yield Map(name, tuple(chosen), mean, share, over)


def _values(
    plan: Plan, rows: Mapping[int, RowResult]
) -> Iterator[tuple[str, bool, npt.NDArray[np.float64]]]:
    """Yield name, whether it is true or false, and one value a row, NaN where there is none."""
    for criterion in plan.criteria:
        met = [rows[row].met.get(criterion.text) if row in rows else None for row in _all(plan)]
        yield criterion.text, True, np.array(met, dtype=float)
    for value in plan.columns:
        found = [rows[row].values.get(value.text) if row in rows else None for row in _all(plan)]
        known = {type(one) for one in found if one is not None}
        if known and known <= {bool, int, float}:
            yield value.text, known == {bool}, np.array(found, dtype=float)


def _all(plan: Plan) -> range:
    return range(plan.rows)
