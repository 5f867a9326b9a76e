"""Content noise: the factor w that multiplies the communicated acceleration (paper, III-A).

n-bit noise draws w from n binary random variables, w = (1 - 1/rho) + (1/rho) sum_j z_j 2^-j,
keyed by (seed, link, sample) and never by arrival.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from cacc_platoon.model.keyed_random import BLOCK, Stream, keyed_words

MAX_BITS = 32


class Noise(Protocol):
    """The noise factors of one link."""

    def factors(self, start: int, stop: int) -> npt.NDArray[np.float64]:
        """Return w for the samples start..stop-1, shape (stop - start,)."""
        ...


def factor_interval(rho: float) -> tuple[float, float]:
    """Return the least and the largest w that the signal-to-noise ratio rho > 1 permits.

    Examples
    --------
    >>> factor_interval(5.0)
    (0.8, 1.2)
    """
    return 1.0 - 1.0 / rho, 1.0 + 1.0 / rho


def expected_factor(rho: float, bit_probabilities: Sequence[float]) -> float:
    """Return E[w] for the signal-to-noise ratio rho > 1 and the probabilities of z_j = 1.

    Examples
    --------
    >>> expected_factor(5.0, [0.5, 0.5])
    0.9500000000000001
    """
    total = sum(p * 2.0**-j for j, p in enumerate(bit_probabilities))
    return (1.0 - 1.0 / rho) + total / rho


def factor_variance(rho: float, bit_probabilities: Sequence[float]) -> float:
    """Return Var[w] = (1/rho^2) sum_j p_j (1 - p_j) / 4^j."""
    return sum(p * (1.0 - p) * 4.0**-j for j, p in enumerate(bit_probabilities)) / rho / rho


class BitNoise:
    """The n-bit noise of equation (5), noise factor: random w, redrawn every `hold` samples.

    Parameters
    ----------
    rho : float
        Linear signal-to-noise ratio, > 1; w stays in [1 - 1/rho, 1 + 1/rho].
    bit_probabilities : sequence of float, length n <= 32
        P(z_j = 1), most significant bit first, to a multiple of 2^-32, none of them 0 or 1.
    seed : int
        Seed of the run.
    link : int
        Index i of the receiving vehicle; links are independent of each other.
    hold : int, optional
        Samples for which one draw is held; 1 redraws at every sample.

    Examples
    --------
    >>> noise = BitNoise(5.0, [0.5] * 16, seed=1, link=2)
    >>> bool((noise.factors(10, 20) == noise.factors(0, 30)[10:20]).all())
    True
    """

    def __init__(
        self, rho: float, bit_probabilities: Sequence[float], seed: int, link: int, hold: int = 1
    ) -> None:
        self._floor, self._rho = 1.0 - 1.0 / rho, rho
        self._seed, self._link, self._hold = seed, link, hold
        bits = len(bit_probabilities)
        chances = np.reshape(bit_probabilities, (bits, 1))
        self._thresholds = np.rint(chances * 2.0**32).clip(1, 2.0**32 - 1).astype(np.uint32)
        self._scale = 2.0 ** (bits - 1)
        self._stream = Stream(self._draw)

    def factors(self, start: int, stop: int) -> npt.NDArray[np.float64]:
        """Return w for the samples start..stop-1, shape (stop - start,)."""
        first, last = start // self._hold, -(-stop // self._hold)
        draws = self._stream(first, last)
        if self._hold == 1:
            return draws
        return draws[np.arange(start, stop) // self._hold - first]

    def _draw(self, block: int) -> npt.NDArray[np.float64]:
        source = keyed_words(self._seed, self._link, block)
        words = source.random_raw(BLOCK * len(self._thresholds) // 2)
        uniform = words.astype("<u8", copy=False).view("<u4").reshape(-1, BLOCK)
        code = np.zeros(BLOCK, np.uint32)
        for bit in uniform < self._thresholds:
            code <<= 1
            code |= bit
        return self._floor + code / (self._scale * self._rho)


class ConstantNoise:
    """One constant factor: w = E[w] (the mean system) or w = 1 (no noise)."""

    def __init__(self, factor: float) -> None:
        self.factor = factor

    def factors(self, start: int, stop: int) -> npt.NDArray[np.float64]:
        """Return the constant for the samples start..stop-1, shape (stop - start,)."""
        return np.full(stop - start, self.factor)
