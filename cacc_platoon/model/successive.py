"""What changes in the course of a run: impairments that follow each other, a moving headway."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from cacc_platoon.model.packets import Floats, Impairment, Packets


class Successive:
    """Impairments that follow each other: packets suffer those of the time they are sent at.

    Parameters
    ----------
    stages : sequence of (int, sequence of Impairment)
        From which source sample on, and what happens to packets then; the first from 0 on.

    Examples
    --------
    >>> from cacc_platoon.model import ComposedChannel, IndependentLoss
    >>> change = Successive([(0, []), (3, [IndependentLoss(1.0, seed=1, link=1)])])
    >>> ComposedChannel([change]).delivery(0, 10).source.tolist()
    [0, 1, 2]
    """

    def __init__(self, stages: Sequence[tuple[int, Sequence[Impairment]]]) -> None:
        self._starts = np.array([start for start, _ in stages])
        self._stages = [tuple(impairments) for _, impairments in stages]
        self.prompt = all(one.prompt for stage in self._stages for one in stage)
        self.longest_delay = max(sum(one.longest_delay for one in stage) for stage in self._stages)
        self.oldest_content = max(
            sum(getattr(one, "oldest_content", 0) for one in stage) for stage in self._stages
        )

    def apply(self, packets: Packets) -> Packets:
        """Return the packets as they are afterwards."""
        number = np.searchsorted(self._starts, packets.source, "right") - 1
        after = packets
        for stage in np.unique(number).tolist():
            changed = packets
            for impairment in self._stages[stage]:
                changed = impairment.apply(changed)
            chosen = number == stage
            after = Packets(
                *(np.where(chosen, new, old) for new, old in zip(changed, after, strict=True))
            )
        return after


def moving_headway(
    first: float, changes: Iterable[tuple[int, float]], rate: float, samples: int
) -> Floats:
    """Return a time headway at each sample that moves to new values at a rate, shape (samples,).

    Parameters
    ----------
    first : float
        At the beginning [s].
    changes : iterable of (int, float)
        From which sample on, in order, and to which value [s].
    rate : float
        By how much from sample to sample [s].
    samples : int
        How many.

    Examples
    --------
    >>> moving_headway(1.0, [(1, 1.5), (4, 1.0)], rate=0.25, samples=7).tolist()
    [1.0, 1.25, 1.5, 1.5, 1.25, 1.0, 1.0]
    """
    headway = np.full(samples, first)
    for start, value in changes:
        if start < samples:
            before = headway[start - 1] if start else first
            most = rate * np.arange(1, samples - start + 1)
            headway[start:] = np.where(
                most < abs(value - before), before + np.sign(value - before) * most, value
            )
    return headway
