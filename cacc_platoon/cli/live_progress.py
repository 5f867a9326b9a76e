"""What `platoon run` shows on a terminal: vehicles while they drive, a line before and after."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Self

from cacc_platoon.cli.progress import ProgressLine
from cacc_platoon.live.picture import PAUSED, RUNNING
from cacc_platoon.live.screen import Above, Screen, coloured
from cacc_platoon.live.table import table_lines
from cacc_platoon.live.watch import Watch
from cacc_platoon.scenario import Scenario

if TYPE_CHECKING:
    from cacc_platoon.supervision.watch_node import WatchNode

_PERIOD = 0.2
_MARGIN = 1
"""Lines of the terminal that stay free, one for the cursor."""


class LiveProgress(ProgressLine):
    """A progress line that makes room for the platoon as long as its vehicles drive.

    Parameters
    ----------
    scenario : Scenario
        What is run.
    """

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario.run.step)
        self._prefix = scenario.platoon.namespace
        self._watch, self._screen = Watch(self._prefix, scenario), Screen(self._stream)
        self._node: WatchNode | None = None
        self._drawn_at = 0.0
        self._above = contextlib.redirect_stderr(Above(self.clear, sys.stderr))

    def nodes(self) -> Sequence[Any]:
        """Make the node that hears the platoon, beside the supervisor's."""
        from cacc_platoon.supervision.watch_node import WatchNode  # noqa: PLC0415  (needs ROS)

        self._node = WatchNode()
        self._node.follow(self._prefix, scenario_too=False)
        return [self._node]

    def __enter__(self) -> Self:
        """Let what others say on standard error come above."""
        self._above.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        """Clear the terminal."""
        self._above.__exit__(None, None, None)
        self.clear()

    def __call__(self, what: str, done: int, total: int) -> None:
        """Show the platoon if there is something to see of it, otherwise the line."""
        now = time.monotonic()
        if not what.startswith((RUNNING, PAUSED)) or self._node is None:
            self._screen.clear()
            super().__call__(what, done, total)
        elif now - self._drawn_at >= _PERIOD:
            self._drawn_at = now
            self._draw(self._node, now)

    def clear(self) -> None:
        """Remove what is shown."""
        self._screen.clear()
        super().clear()

    def _draw(self, node: WatchNode, now: float) -> None:
        self._watch.hear(node.take(), now)
        picture = self._watch.picture(now)
        columns, lines = self._screen.size
        self._screen.draw(
            table_lines(picture, columns, lines - _MARGIN, coloured=coloured(os.environ))
        )
