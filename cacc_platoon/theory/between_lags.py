"""How little is left at the lags between those that are tried.

A slack over lags has a few minima, and the deepest may lie between two lags that are tried. Each
least one is closed in on between its neighbours; a dip beside which no tried lag is least would be
missed (docs/theory.md, section 6 (Sampling)).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Float = NDArray[np.float64]

__all__ = ["between", "least_between"]

_SHARES, _PASSES = np.linspace(0.0, 1.0, 17), 5  # each pass narrows the brackets eightfold
_DEEPER = 2.0  # a parabola through three lags falls by an eighth of the rise beside the least


def between(low: Float, high: Float, shares: Float) -> Float:
    """Lay values between two ends in each row, `shares` of the way."""
    return np.asarray(low[:, np.newaxis] + np.multiply.outer(high - low, shares), dtype=np.float64)


@np.errstate(invalid="ignore")  # what is minus infinity twice
def least_between(
    slack_of: Callable[[Float], Float], lags: Float, needed: float
) -> tuple[Float, Float]:
    """Close in on each least slack between lags that may fall below what is needed.

    Parameters
    ----------
    slack_of : callable
        Slacks at lags of shape (n,), of shape (n, columns): each column is searched by itself.
    lags : ndarray, shape (n,)
        Lags [s] that are tried, rising.
    needed : float
        Where a least slack stays above although it fell by twice its rise to the higher of its
        neighbours, nothing is searched.

    Returns
    -------
    tuple of ndarray, shape (m,)
        The lags [s], and the slack at each.

    Examples
    --------
    >>> dip = lambda lag: ((lag - 0.29) ** 2 - 1e-4)[:, np.newaxis]
    >>> found, slack = least_between(dip, np.linspace(0.0, 1.0, 6), 0.0)
    >>> found.round(4).tolist(), slack.round(6).tolist()
    ([0.29], [-0.0001])
    """
    slack = slack_of(lags)
    padded = np.concatenate((slack[:1], slack, slack[-1:]))
    left, right = padded[:-2], padded[2:]
    deepest = slack - _DEEPER * (np.maximum(left, right) - slack)
    at, column = np.nonzero((slack <= left) & (slack <= right) & ~(deepest >= needed))
    low, high = lags[np.maximum(at - 1, 0)], lags[np.minimum(at + 1, len(lags) - 1)]
    if not at.size:
        return low, slack[at, column]
    rows = np.arange(at.size)
    for _ in range(_PASSES):
        local = between(low, high, _SHARES)
        found = slack_of(local.ravel()).reshape(*local.shape, -1)[rows, :, column]
        least = np.argmin(found, axis=1)
        low = local[rows, np.maximum(least - 1, 0)]
        high = local[rows, np.minimum(least + 1, _SHARES.size - 1)]
    return local[rows, least], found[rows, least]
