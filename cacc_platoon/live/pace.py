"""How fast a run goes, from when it was seen at which sample."""

from __future__ import annotations

from collections import deque

WINDOW = 3.0
"""The pace is that of the last seconds [s]."""
_KEPT = 100


class Pace:
    """Samples by wall time, over the last seconds.

    Examples
    --------
    >>> pace = Pace()
    >>> pace.note(0, 10.0)
    >>> pace.note(200, 12.0)
    >>> pace.rate
    100.0
    """

    def __init__(self) -> None:
        self._seen: deque[tuple[float, int]] = deque(maxlen=_KEPT)

    def note(self, sample: int, now: float) -> None:
        """Take note of the sample that is reached at a time [s]; earlier ones change nothing."""
        if self._seen and sample <= self._seen[-1][1]:
            return
        self._seen.append((now, sample))
        while len(self._seen) > 2 and now - self._seen[1][0] > WINDOW:
            self._seen.popleft()

    @property
    def rate(self) -> float | None:
        """Samples per second; None as long as that cannot be said."""
        if len(self._seen) < 2:
            return None
        (began, first), (ended, last) = self._seen[0], self._seen[-1]
        return (last - first) / (ended - began) if ended > began else None
