"""Pareto sets: what is left when nothing can be improved without giving something up."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Float = NDArray[np.float64]

__all__ = ["normalised", "pareto_front", "ranks", "spread_out"]


def pareto_front(costs: Float) -> NDArray[np.intp]:
    """Find the rows that no other row dominates.

    Parameters
    ----------
    costs : ndarray, shape (n, m)
        One row per design, every column to be minimised.

    Returns
    -------
    ndarray of int
        Rows for which no other is at most equal in all columns and lower in one, in order.

    Examples
    --------
    >>> pareto_front(np.array([[1.0, 2.0], [2.0, 1.0], [2.0, 2.0]])).tolist()
    [0, 1]
    """
    alive = np.argsort(normalised(costs).sum(axis=1), kind="stable")
    front = []
    while alive.size:  # the row with the lowest sum left is never dominated
        best, rest = alive[0], alive[1:]
        front.append(int(best))
        better = np.any(costs[rest] < costs[best], axis=1)
        equal = np.all(costs[rest] == costs[best], axis=1)
        alive = rest[better | equal]
    return np.sort(np.array(front, dtype=np.intp))


def normalised(costs: Float) -> Float:
    """Scale every column to [0, 1] between its least and largest finite value.

    Examples
    --------
    >>> normalised(np.array([[1.0, 5.0], [3.0, 5.0]])).tolist()
    [[0.0, 0.0], [1.0, 0.0]]
    """
    if costs.size == 0:
        return costs
    finite = np.where(np.isfinite(costs), costs, np.nan)
    known = np.isfinite(costs).any(axis=0)
    low, high = np.zeros(costs.shape[1]), np.ones(costs.shape[1])
    low[known] = np.nanmin(finite[:, known], axis=0)
    high[known] = np.nanmax(finite[:, known], axis=0)
    scaled = (np.clip(costs, low, high) - low) / np.where(high > low, high - low, 1.0)
    return np.asarray(scaled, dtype=np.float64)


def ranks(costs: Float) -> Float:
    """Rank every column from 0 (least) to 1 (largest); equal values share the lowest rank.

    Examples
    --------
    >>> ranks(np.array([[7.0], [1e6], [8.0]])).ravel().tolist()
    [0.0, 1.0, 0.5]
    """
    ordered = np.sort(costs, axis=0)
    below = [np.searchsorted(ordered[:, j], costs[:, j]) for j in range(costs.shape[1])]
    return np.stack(below, axis=1) / max(len(costs) - 1, 1)


def spread_out(costs: Float, count: int) -> NDArray[np.intp]:
    """Pick up to `count` different rows: the best of each column, then the most distant.

    Examples
    --------
    >>> spread_out(np.array([[0.0, 1.0], [0.45, 0.5], [0.5, 0.5], [1.0, 0.0]]), 3).tolist()
    [0, 2, 3]
    """
    scaled = normalised(costs)
    chosen = list(dict.fromkeys(int(i) for i in np.argmin(scaled, axis=0)))[:count]
    distance = np.min(
        [np.sum((scaled - scaled[i]) ** 2, axis=1) for i in chosen], axis=0, initial=np.inf
    )
    while len(chosen) < count and np.max(distance) > 0:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.sum((scaled - scaled[chosen[-1]]) ** 2, axis=1))
    return np.sort(np.array(chosen, dtype=np.intp))
