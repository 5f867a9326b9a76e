r"""The platoon's matrix ``A(w)``, and the mean of its exponential.

With the state ``(x_0, v_0, a_0, ..., x_N, v_N, a_N)`` the noise factor ``w_i`` stands in ``A``
once, where ``a_{i-1}`` enters ``a_i``. Whatever leads from vehicle j to vehicle i passes each
``w`` between them exactly once, so that every entry of ``exp(A t)`` is of degree one in each
``w_i``. For links that are independent of each other therefore

.. math:: E[e^{A t}] = e^{E[A] t}

exactly (docs/theory.md, section 1 (Setting)). So has the transition matrix where every ``w_i``
changes in time, in whatever way, the mean that ``E[A]`` gives. With one factor common to all links
it is false: products of it have another mean.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from cacc_platoon.theory.errors import require

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from cacc_platoon.model.control import Gains

    Float = NDArray[np.float64]

__all__ = ["link_outcomes", "matrix_exponential", "platoon_matrix"]

_TAYLOR_TERMS = 18


def platoon_matrix(gains: Gains, tau: float, factors: ArrayLike) -> Float:
    """Matrix ``A(w)`` of the platoon's state ``(x_i, v_i, a_i)``, as deviations from equilibrium.

    Parameters
    ----------
    gains : Gains
        Controller of every follower.
    tau : float
        Actuation lag of every vehicle, the leader's too [s].
    factors : array_like, shape (..., N)
        Noise factors ``w_1 .. w_N`` of the links.

    Returns
    -------
    ndarray, shape (..., 3 N + 3, 3 N + 3)
        Block lower bidiagonal, 3 by 3 blocks.

    Raises
    ------
    DesignError
        If the lag is not positive.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> A = platoon_matrix(Gains(1.0, 0.5, 0.7, 0.1), 0.5, [1.2])
    >>> A[5].round(6).tolist()  # the lag times the derivative of a_1
    [0.2, 1.4, 1.2, -0.2, -1.6, -2.0]
    """
    require(tau > 0, f"tau = {tau:g} s is not positive: the vehicle has no third state. Raise tau.")
    w = np.asarray(factors, dtype=np.float64)
    followers = w.shape[-1]
    h, k_a, k_v, k_p = gains
    matrix = np.zeros((*w.shape[:-1], 3 * followers + 3, 3 * followers + 3))
    for i in range(followers + 1):
        x = 3 * i
        matrix[..., x, x + 1] = matrix[..., x + 1, x + 2] = 1.0
        matrix[..., x + 2, x + 2] = -1.0 / tau
        if i:
            matrix[..., x + 2, x] = -k_p / tau
            matrix[..., x + 2, x + 1] = -(k_v + h * k_p) / tau
            matrix[..., x + 2, x - 3] = k_p / tau
            matrix[..., x + 2, x - 2] = k_v / tau
            matrix[..., x + 2, x - 1] = k_a * w[..., i - 1] / tau
    return matrix


def matrix_exponential(matrix: ArrayLike) -> Float:
    """``exp(A)`` by scaling, a Taylor series and squaring.

    Parameters
    ----------
    matrix : array_like, shape (..., n, n)
        Square matrices.

    Returns
    -------
    ndarray, shape (..., n, n)
        Their exponentials.

    Examples
    --------
    >>> matrix_exponential([[0.0, 3.0], [0.0, 0.0]]).tolist()
    [[1.0, 3.0], [0.0, 1.0]]
    """
    A = np.asarray(matrix, dtype=np.float64)
    size = float(np.abs(A).sum(axis=-1).max(initial=0.0))
    halvings = max(0, int(np.ceil(np.log2(max(size, 1e-300)))) + 1)
    scaled = A / 2.0**halvings
    total = term = np.broadcast_to(np.eye(A.shape[-1]), A.shape)
    for n in range(1, _TAYLOR_TERMS):
        term = term @ scaled / n
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return np.asarray(total, dtype=np.float64)


def link_outcomes(values: Sequence[float], mean: float, links: int) -> tuple[Float, Float]:
    """List what independent links may do when each takes one of two values of a given mean.

    Means of what is of degree one in every factor depend on the law by its mean alone, so that
    two values stand for every law.

    Parameters
    ----------
    values : sequence of float
        The two values of a factor.
    mean : float
        Its mean, between them.
    links : int
        How many links.

    Returns
    -------
    factors : ndarray, shape (2**links, links)
        Every outcome.
    probability : ndarray, shape (2**links,)
        How probable it is.

    Raises
    ------
    DesignError
        If the mean is not between the values.

    Examples
    --------
    >>> factors, probability = link_outcomes((0.8, 1.2), 1.1, 2)
    >>> factors.tolist()
    [[0.8, 0.8], [0.8, 1.2], [1.2, 0.8], [1.2, 1.2]]
    >>> probability.round(4).tolist()
    [0.0625, 0.1875, 0.1875, 0.5625]
    """
    low, high = values
    require(
        low < high and low <= mean <= high,
        f"the mean {mean:g} is not between {low:g} and {high:g}: no probabilities give it. Give "
        "two different values around it.",
    )
    up = (mean - low) / (high - low)
    factors = np.array(list(product((low, high), repeat=links)))
    return factors, np.where(factors == high, up, 1.0 - up).prod(axis=1)
