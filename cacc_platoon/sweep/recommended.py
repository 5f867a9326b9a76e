"""Recommended designs for a row: what `platoon design` answers for its channel and its lag."""

from __future__ import annotations

from functools import lru_cache

from cacc_platoon.design import Requirements, paper_design, recommend
from cacc_platoon.model import Gains
from cacc_platoon.scenario import Scenario

NAMES = ("paper", "shortest", "robust", "balanced")
"""Of the designs; see `cacc_platoon.design.recommend`."""


def with_design(scenario: Scenario, name: str) -> Scenario:
    """Return a scenario with the gains and the headway that are recommended for it.

    They are for the smallest SNR and the largest lag of its followers, for its control period, and
    for the largest latency, loss and time from packet to packet of its links.

    Parameters
    ----------
    scenario : Scenario
        Whose channel and lag count.
    name : str
        One of `NAMES`.

    Raises
    ------
    DesignError
        When there is no such design.

    Examples
    --------
    >>> made = with_design(Scenario.from_values({"v2v.rho": 5.0}), "paper")
    >>> round(made.follower(1).gains.time_headway, 4)
    0.8814
    """
    links = [follower.v2v for follower in scenario.followers]
    rho = min(link.rho for link in links)
    tau_max = max(follower.tau_max for follower in scenario.followers)
    period = max(link.period for link in links)
    ask = Requirements(
        period=scenario.run.step,
        latency=max(link.latency for link in links),
        reception=1.0 - max(link.loss for link in links),
        hold=any(link.reception == "hold" for link in links),
        v2v_period=period or None,
    )
    gains = _recommended(rho, tau_max, ask, name)
    return scenario.with_values({f"controller.{key}": one for key, one in gains._asdict().items()})


@lru_cache(maxsize=64)
def _recommended(rho: float, tau_max: float, ask: Requirements, name: str) -> Gains:
    if name == "paper":
        return paper_design(rho, tau_max, reception=ask.counted_as_zero)
    return recommend(rho, tau_max, ask)[name].gains
