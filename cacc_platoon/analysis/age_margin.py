"""How the age of what followers knew compares with the latency that their design bears."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cacc_platoon.analysis.age import link_ages
from cacc_platoon.analysis.follower_verdict import FollowerVerdict
from cacc_platoon.errors import UserError
from cacc_platoon.simulation import Trajectory

BASIS = (
    "the largest constant latency at which the loop, sampled at the control period and without "
    "losses, is string stable for every lag up to tau0 and every E[w] "
    "(docs/theory.md, section 7 (V2V latency)). No theorem covers an age that changes, as it does "
    "where packets are lost, rare or delayed by different times: an age below the margin proves "
    "nothing of it, one above does not disprove string stability"
)
"""What the margin is, and what it is not, for a sentence."""

_ROUNDING = 1e-9


class AgeMargin(NamedTuple):
    """The age of information over one link beside the latency margin of the follower's design.

    Attributes
    ----------
    sender, follower : int
        Index of the sender, and of the receiver.
    margin : float
        Latency margin [s], see `BASIS`: infinite where nothing received is used, 0 where it is not
        string stable with none, NaN where it is not known or the link is not the predecessor's.
    share_above : float
        Share of samples at which the age was above it, from the first arrival on; NaN where one of
        the two is not known.
    """

    sender: int
    follower: int
    margin: float
    share_above: float


def age_margins(run: Trajectory, followers: Sequence[FollowerVerdict]) -> list[AgeMargin]:
    """Compare the age of information over every link with the margin of its follower's design.

    Parameters
    ----------
    run : Trajectory
        What happened.
    followers : sequence of FollowerVerdict
        The design of every follower, from front to rear.
    """
    margins = {one.follower: _margin(one) for one in followers}
    found = []
    for link, age in zip(run.scenario.topology.links, link_ages(run), strict=True):
        nearest = link.sender == link.receiver - 1
        margin = margins[link.receiver] if nearest else math.nan
        known = age[np.isfinite(age)]
        share = float((known > margin + _ROUNDING).mean()) if known.size else math.nan
        found.append(AgeMargin(*link, margin, math.nan if math.isnan(margin) else share))
    return found


def describe_age(margins: Sequence[AgeMargin]) -> str:
    """Say how often the age was above the margin, of the link where it was most.

    Examples
    --------
    >>> describe_age([AgeMargin(0, 1, 0.073, 0.0), AgeMargin(1, 2, 0.073, 0.25)])
    'above the latency margin of 0.073 s for 25 % of the time (vehicle 2, no other for longer)'
    >>> describe_age([AgeMargin(0, 1, 0.073, 0.0)])
    'never above the latency margin of 0.073 s'
    >>> describe_age([AgeMargin(0, 1, 0.0, 1.0)])
    'of no margin: vehicle 1 is not string stable with any latency'
    """
    known = [one for one in margins if not math.isnan(one.share_above)]
    if not known:
        return "unknown"
    if hopeless := [one for one in known if one.margin == 0.0]:
        return f"of no margin: vehicle {hopeless[0].follower} is not string stable with any latency"
    worst = max(known, key=lambda one: one.share_above)
    if not worst.share_above:
        least = min(known, key=lambda one: one.margin)
        return f"never above the latency margin of {least.margin:.4g} s"
    alone = f"vehicle {worst.follower}" + (", no other for longer" if len(known) > 1 else "")
    return (
        f"above the latency margin of {worst.margin:.4g} s for {100 * worst.share_above:.3g} % of "
        f"the time ({alone})"
    )


def _margin(one: FollowerVerdict) -> float:
    """Return the latency margin of a follower's design with every packet."""
    if one.certificate is None:
        return math.nan
    try:
        return replace(one.certificate, held=1.0).joint_latency_margin
    except (UserError, ArithmeticError, ValueError):
        return math.nan
