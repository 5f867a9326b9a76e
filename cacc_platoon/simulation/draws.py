"""How far one draw of a link's noise and loss can move what its follower receives."""

from __future__ import annotations

import numpy as np

from cacc_platoon.model import factor_interval
from cacc_platoon.scenario import Follower, Scenario
from cacc_platoon.simulation.mean_links import mean_factor
from cacc_platoon.simulation.trajectory import Array


def draws_are_fresh(scenario: Scenario) -> bool:
    """Return whether each draw is used at its own sample alone and independent of those before.

    It is not where packets are rare or late, lost in bursts or blackouts or say anything else, nor
    where noise is held over several samples and lost packets are replaced by the last one: a factor
    is then used before and after a loss. Errors of sensors and limits are no draws of a channel.
    Where parameters change there is no one response to a draw.
    """
    followers = scenario.followers
    linear = all(one.sensing().perfect and not (one.limits() or one.stops) for one in followers)
    plain = linear and all(
        follower.timing().prompt
        and not (follower.v2v.burst_begin or follower.v2v.blackouts or follower.v2v.jitter)
        and not (follower.errs or follower.v2v.false_data or follower.triggered)
        and follower.v2v.reception != "fallback"
        for follower in scenario.receivers
    )
    return (
        plain
        and not scenario.changes
        and not any(
            follower.v2v.loss and follower.holds and _drawn_for(follower) > 1
            for follower in scenario.followers
        )
    )


def squared_ranges(scenario: Scenario, sent: Array, received: Array) -> Array:
    """Return the squared width of the interval that a draw leaves open [m^2/s^4].

    Parameters
    ----------
    scenario : Scenario
        Whose channels they are.
    sent, received : ndarray, shape (samples, ..., L)
        Acceleration of the senders, and what was used of it.

    Returns
    -------
    ndarray, shape (samples, ..., L)
        A draw that is held for n samples counts n times at each: by the inequality of Cauchy and
        Schwarz their sum is no less than the square of what all of them do together.

    Examples
    --------
    >>> scenario = Scenario.from_values({"platoon.followers": 1, "v2v.rho": 5.0})
    >>> round(float(squared_ranges(scenario, np.ones((1, 1)), np.ones((1, 1)))[0, 0]), 12)
    0.16
    """
    followers = scenario.receivers
    low, high = np.array([_factors(follower) for follower in followers]).T
    loses = np.array([follower.v2v.loss > 0.0 for follower in followers])
    holds = np.array([follower.holds for follower in followers])
    before = np.zeros_like(received)
    before[1:] = received[:-1]
    other = np.where(loses, np.where(holds, before, 0.0), low * sent)
    both = np.stack((low * sent, high * sent, other))
    held = np.array([_drawn_for(follower) for follower in followers])
    widths: Array = held * np.square(both.max(axis=0) - both.min(axis=0))
    return widths


def _factors(follower: Follower) -> tuple[float, float]:
    """Return the least and the largest w of a link."""
    if follower.v2v.noise != "bits":
        return (mean_factor(follower),) * 2
    return factor_interval(follower.v2v.rho)


def _drawn_for(follower: Follower) -> int:
    """Return for how many samples a draw of the noise is held."""
    return follower.hold_steps if follower.v2v.noise == "bits" else 1
