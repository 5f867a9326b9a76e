"""Who fell back to a law without V2V in a run, and when."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from cacc_platoon.model import Gains, ReceptionState
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.simulation import Trajectory
from cacc_platoon.simulation.course import reception_state
from cacc_platoon.theory.certificate import certify
from cacc_platoon.theory.switching import blend_is_stable


class FallbackUse(NamedTuple):
    """How a follower used its law without V2V.

    Attributes
    ----------
    follower : int
        Index.
    shares : tuple of float
        Share of time in each `ReceptionState`, from NORMAL on.
    begin, end : float
        From when until when [s] it was not NORMAL; NaN when it always was.
    turns : int
        How many times it left NORMAL.
    """

    follower: int
    shares: tuple[float, float, float, float]
    begin: float
    end: float
    turns: int


def fallback_use(run: Trajectory) -> list[FallbackUse]:
    """Return how each follower that may fall back did so, from front to rear.

    Examples
    --------
    >>> from cacc_platoon.simulation import simulate
    >>> silent = {"v2v.reception": "fallback", "v2v.blackouts": (1.0, 9.0), "run.duration": 10.0}
    >>> used = fallback_use(simulate(Scenario.from_values(silent)))[0]
    >>> used.begin, used.turns, [round(share, 2) for share in used.shares]
    (1.49, 1, [0.15, 0.1, 0.75, 0.0])
    """
    return [
        _use(run, follower.index, column)
        for column, follower in enumerate(run.scenario.followers)
        if follower.fallback_law()
    ]


def _use(run: Trajectory, index: int, column: int) -> FallbackUse:
    share = np.ones(len(run.position)) if run.share is None else run.share[:, column]
    state = reception_state(share)
    other = state != ReceptionState.NORMAL
    samples = np.flatnonzero(other)
    begin, end = (float(run.time[k]) for k in samples[[0, -1]]) if samples.size else (np.nan,) * 2
    counts = np.bincount(state, minlength=len(ReceptionState)) / len(state)
    normal, degrading, fallback, recovering = counts.tolist()
    left = int((other & ~np.concatenate(([False], other[:-1]))).sum())
    return FallbackUse(index, (normal, degrading, fallback, recovering), begin, end, left)


def fallback_premises(scenario: Scenario, used: Sequence[FallbackUse]) -> Iterator[str]:
    """Say from when to when vehicles drove without V2V, and what is proven of that."""
    left = [one for one in used if one.turns]
    if not left:
        return
    begin, end = min(one.begin for one in left), max(one.end for one in left)
    followers = [one.follower for one in left]
    yield (
        f"{len(left)} of {len(scenario.followers)} vehicles fell back to a law without V2V, "
        f"between {begin:g} and {end:g} s: {_proven(scenario, followers)}"
    )


def _proven(scenario: Scenario, followers: Sequence[int]) -> str:
    """Say what is known of vehicles without V2V, and of the blend to it."""
    several = [scenario.follower(index) for index in followers]
    alone, blend = True, not any(one.law_name for one in several)
    pairs = {
        (gains, law.gains, one.v2v.rho, one.tau_max)
        for one in several
        if (law := one.fallback_law())
        for gains in _laws(one, scenario.samples)
    }
    for gains, without, rho, tau_max in pairs:
        found = certify(without, rho, tau_max, period=scenario.run.step)
        alone &= found.string_stable and found.sampled_string_stable
        blend &= blend_is_stable(gains, without, tau_max)
    stable = "is" if alone else "is NOT"
    moves = any(len(_laws(one, scenario.samples)) > 1 for one in several)
    while_still = ", while its time headway stays what it is" if moves else ""
    whole = (
        f"no blend of the two, however it changes{while_still}, can destabilise a vehicle "
        "(one Lyapunov function "
        "serves both at every lag, of a linear vehicle that measures at once, in continuous time)"
        if blend
        else "nothing is proven of a vehicle that goes from one to the other and back"
    )
    return (
        f"that law {stable} string stable by itself for every lag up to tau0, sampled too, and "
        f"{whole}; what a platoon passes on meanwhile rests on this run alone"
    )


def _laws(follower: Follower, samples: int) -> set[Gains]:
    """Return its laws with V2V with the least and the largest time headway of the run.

    The condition for a blend is affine in ``k_v + k_p h``, so that these decide for all between.
    """
    headways = follower.headways(samples)
    if headways is None:
        return {follower.gains}
    ends = float(np.min(headways)), float(np.max(headways))
    return {follower.gains._replace(time_headway=end) for end in ends}
