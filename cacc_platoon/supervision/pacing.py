"""How far the leader may go, what recorders can have reached by then, how long a pause may last."""

from __future__ import annotations

from collections.abc import Callable

from cacc_platoon.scenario import Scenario
from cacc_platoon.stepping.wall import CLOCK_MARGIN

LONGEST_LOOK = 1.0
"""For longer [s] a supervisor that is not stopped does not look away."""


class AwakeClock:
    """A steady clock that stands still while its process does.

    Who was stopped cannot have seen the progress that others made meanwhile, nor let them make it.

    Parameters
    ----------
    clock : callable
        The time now [s].

    Examples
    --------
    >>> times = iter((5.0, 5.25, 100.0, 100.5))
    >>> awake = AwakeClock(lambda: next(times))
    >>> [awake() for _ in range(3)]
    [5.25, 6.25, 6.75]
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock, self._seen = clock, clock()
        self._now = self._seen

    def __call__(self) -> float:
        """Return the time now [s]; call it more often than every `LONGEST_LOOK`."""
        seen = self._clock()
        self._now += min(seen - self._seen, LONGEST_LOOK)
        self._seen = seen
        return self._now


def horizon(scenario: Scenario, progress: int, elapsed: float) -> int:
    """Return the last sample that the leader may publish.

    Parameters
    ----------
    scenario : Scenario
        The run.
    progress : int
        Sample up to which everything is recorded, -1 before the first.
    elapsed : float
        Wall time since the start of the run [s].
    """
    run = scenario.run
    window = progress + run.window
    if not run.real_time_factor:
        return window
    return min(window, int(elapsed * run.real_time_factor / run.step))


def furthest_sample(scenario: Scenario, horizon: int) -> int:
    """Return the last sample that anybody can have published under a horizon.

    A follower needs sample k of its predecessor for its own sample k + 1, so the vehicle at the
    end may be ahead of the leader by one sample for each vehicle between.
    """
    return horizon + scenario.platoon.followers


LEAD, LEAD_OF_A_VEHICLE = 0.5, 0.01
"""How long before its start a run by clocks is announced, and more for each vehicle [s].

By then everybody has to know it, and each vehicle where the one ahead begins.
"""


def start_by_clocks(scenario: Scenario, now: float) -> float:
    """Return when sample 0 of a run by clocks is due that begins now [s]."""
    return now + LEAD + LEAD_OF_A_VEHICLE * len(scenario.vehicles)


def sample_by_clocks(scenario: Scenario, elapsed: float) -> int:
    """Return the last sample that anybody can have taken so long after the start [s]."""
    return int((elapsed + CLOCK_MARGIN) / scenario.run.clock_period)


def end_by_clocks(scenario: Scenario, *, restarted: bool = False) -> float:
    """Return how long after its start a run by clocks has to be complete [s].

    A process that is started again may take as long as any to appear.
    """
    more = start_limit(scenario) if restarted else 0.0
    return scenario.samples * scenario.run.clock_period + stall_limit(scenario) + more


def known_ahead(scenario: Scenario) -> int:
    """Return at how many samples more a relay may know that nothing is delivered."""
    counts = any(follower.counted for follower in scenario.followers)
    return scenario.run.window if counts else 0


NODES_IN_TIME = 100
"""Nodes that the time-outs are made for; more of them get more time, in proportion."""


def start_limit(scenario: Scenario) -> float:
    """Return how long no node may appear and no connection be made while a run starts [s]."""
    return scenario.run.start_timeout * _share(scenario)


def stall_limit(scenario: Scenario) -> float:
    """Return how long a run may make no progress [s]: at a slow pace even a window takes time."""
    run = scenario.run
    limit = run.stall_timeout * _share(scenario)
    if not run.real_time_factor:
        return limit
    return limit + run.window * run.step / run.real_time_factor


def _share(scenario: Scenario) -> float:
    return max(1.0, len(scenario.node_names) / NODES_IN_TIME)
