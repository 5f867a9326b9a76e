"""Random numbers keyed by what they belong to: any slice of a stream equals that of the whole."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

STREAM_VERSION = 1
BLOCK = 8192
"""Draws per keyed block; part of a stream's definition together with STREAM_VERSION."""

LOSS, PHASE, BURST, DELAY, ERROR, RANGE, RANGE_RATE, CLOCK = range(1, 9)
"""Purposes of streams beside the noise factor's, which has none; part of their keys."""

LARGEST_NORMAL = 6.0
"""The largest absolute value that `keyed_normal` can return."""


def keyed_words(seed: int, *key: int) -> np.random.SFC64:
    """Return a source of random 64-bit words for (seed, key), such as (link, purpose, block)."""
    return np.random.SFC64(np.random.SeedSequence(seed, spawn_key=(STREAM_VERSION, *key)))


class Stream:
    """Random numbers of a stream that is drawn a block at a time.

    The last block is remembered, for whoever asks for one number after the other.
    """

    def __init__(self, draw: Callable[[int], npt.NDArray[np.float64]]) -> None:
        self._draw, self._block = draw, -1
        self._values = np.empty(0)

    def __call__(self, start: int, stop: int) -> npt.NDArray[np.float64]:
        """Return the draws start..stop-1."""
        draws = np.empty(stop - start)
        for block in range(start // BLOCK, -(-stop // BLOCK)):
            begin, end = max(start, block * BLOCK), min(stop, (block + 1) * BLOCK)
            values = self._values if block == self._block else self._draw(block)
            if end - begin < BLOCK:
                self._block, self._values = block, values
            draws[begin - start : end - start] = values[begin - block * BLOCK : end - block * BLOCK]
        return draws


def keyed_uniform(seed: int, link: int, purpose: int) -> Stream:
    """Return a link's stream for a purpose, uniform in [0, 1)."""

    def draw(block: int) -> npt.NDArray[np.float64]:
        words = keyed_words(seed, link, purpose, block).random_raw(BLOCK)
        return np.asarray((words >> np.uint64(11)) * 2.0**-53, np.float64)

    return Stream(draw)


def keyed_normal(seed: int, link: int, purpose: int) -> Stream:
    """Return a link's stream for a purpose, of mean 0 and variance 1.

    Each number is the sum of twelve uniform ones, less its mean: normal but for its tails, which
    end at LARGEST_NORMAL, and the same to the last bit on every machine.
    """

    def draw(block: int) -> npt.NDArray[np.float64]:
        words = keyed_words(seed, link, purpose, block).random_raw(6 * BLOCK)
        parts = words.astype("<u8", copy=False).view("<u4").reshape(12, BLOCK)
        total = parts.sum(axis=0, dtype=np.uint64).astype(np.float64)
        return np.asarray((total - LARGEST_NORMAL * (2.0**32 - 1.0)) * 2.0**-32, np.float64)

    return Stream(draw)
