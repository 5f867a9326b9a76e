"""The three published cases (paper, section IV)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from cacc_platoon.scenario import Scenario
from cacc_platoon.theory import optimum

RHO, TAU_0, FOLLOWERS, DISTANCE = 5.0, 0.5, 12, 5.0


class Case(NamedTuple):
    """One published case.

    Attributes
    ----------
    name : str
        A, B or C, the order in which the paper brings them.
    time_headway, k_a, k_v, k_p : float
        Headway [s] and gains.
    string_stable : bool
        What the paper says of it.
    """

    name: str
    time_headway: float
    k_a: float
    k_v: float
    k_p: float
    string_stable: bool


CASES = (
    Case("A", 0.95, 0.5, 0.63, 0.009, string_stable=True),
    Case("B", 0.65, 0.5, 0.63, 0.009, string_stable=False),
    Case("C", 0.88, optimum(RHO, TAU_0).k_a, 0.85, 0.003, string_stable=True),
)


def case_scenario(case: Case, settings: Mapping[str, Any] | None = None) -> Scenario:
    """Return the scenario of a case; `settings` replace parameters by their dotted names.

    Examples
    --------
    >>> case_scenario(CASES[1]).controller.time_headway
    0.65
    """
    return Scenario.from_values(
        {
            "platoon.followers": FOLLOWERS,
            "platoon.standstill_distance": DISTANCE,
            "vehicle.tau": TAU_0,
            "vehicle.tau_max": TAU_0,
            "v2v.rho": RHO,
            "controller.time_headway": case.time_headway,
            "controller.k_a": case.k_a,
            "controller.k_v": case.k_v,
            "controller.k_p": case.k_p,
            **(settings or {}),
        },
        source=f"paper_{case.name.lower()}",
    )
