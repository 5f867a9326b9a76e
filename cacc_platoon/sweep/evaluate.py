"""One scenario as numbers: judged by its parameters, simulated in arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cacc_platoon.analysis import compute_metrics, judge
from cacc_platoon.analysis.document import plain_values, run_document, verdict_document
from cacc_platoon.simulation import simulate, simulate_mean

if TYPE_CHECKING:
    from cacc_platoon.analysis import Metrics, Verdict
    from cacc_platoon.scenario import Scenario


@dataclass(frozen=True)
class Row:
    """What a scenario gives; plain numbers, so that it can be pickled and put into a table.

    Attributes
    ----------
    name : str
        The scenario's.
    seed : int
        Of the simulated run.
    string_stable : bool
        The exact test of the mean system, every follower; see `cacc_platoon.analysis.Verdict`.
    headline, basis : str
        The verdict in a few words, and the test it rests on.
    l2_gain, linf_gain : float
        Largest sup |H| and largest L-infinity gain of a mean hop; NaN where one is unknown.
    mean_first_peak, mean_last_peak : float
        max |delta_i| [m] of the first and the last follower in the mean system.
    first_peak, last_peak : float
        The same in the one run of this seed, which certifies nothing.
    min_gap : float
        Smallest gap of any follower in that run [m].
    collided : bool
        Whether a vehicle touched the one ahead in that run, which ends it unless
        run.stop_on_collision says otherwise: peaks are those until then.
    loss : float
        Largest share of packets lost on a link in that run.
    """

    name: str
    seed: int
    string_stable: bool
    headline: str
    basis: str
    l2_gain: float
    linf_gain: float
    mean_first_peak: float
    mean_last_peak: float
    first_peak: float
    last_peak: float
    min_gap: float
    collided: bool
    loss: float


class _Judged(NamedTuple):
    """The run of a scenario's seed, the mean system, and the verdict on its parameters."""

    run: Metrics
    mean: Metrics
    verdict: Verdict

    @classmethod
    def of(cls, scenario: Scenario) -> _Judged:
        with np.errstate(all="ignore"):  # an unstable scenario overflows, and that is its result
            run = compute_metrics(simulate(scenario))
            mean = compute_metrics(simulate_mean(scenario))
        return cls(run, mean, judge(scenario))


def evaluate(scenario: Scenario) -> Row:
    """Judge and simulate a scenario; a pure function, for any `concurrent.futures` executor.

    Parameters
    ----------
    scenario : Scenario
        What to evaluate; `Scenario.with_values` makes others from one.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> short = Scenario.from_values({"run.duration": 20.0, "platoon.followers": 3})
    >>> headways = (0.95, 0.65)
    >>> rows = [evaluate(short.with_values({"controller.time_headway": h})) for h in headways]
    >>> [row.string_stable for row in rows]
    [True, False]
    """
    run, mean, verdict = _Judged.of(scenario)
    return Row(
        scenario.name,
        scenario.run.seed,
        verdict.string_stable,
        verdict.headline,
        verdict.basis,
        verdict.weakest.l2_gain,
        verdict.linf_gain,
        float(mean.max_abs_spacing_error[0]),
        float(mean.max_abs_spacing_error[-1]),
        float(run.max_abs_spacing_error[0]),
        float(run.max_abs_spacing_error[-1]),
        float(np.min(run.min_gap)),
        run.collision,
        max(link.loss for link in run.reception),
    )


def parameters_of(scenario: Scenario) -> dict[str, Any]:
    """Return the parameters of a scenario by group and name, those that followers share.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> parameters_of(Scenario())["controller"]["time_headway"]
    0.95
    """
    groups: dict[str, Any] = {}
    for name, value in scenario.values().items():
        group, _, own = name.partition(".")
        groups.setdefault(group, {})[own] = plain_values(value)
    return groups


def document_of(scenario: Scenario) -> dict[str, Any]:
    """Judge and simulate a scenario; return its numbers by the names of metrics.json.

    Those of the run of its seed, of the mean system under `expected`, of the verdict under
    `verdict`; what is no number is None.

    Examples
    --------
    >>> from cacc_platoon.scenario import Scenario
    >>> found = document_of(Scenario.from_values({"run.duration": 20.0, "platoon.followers": 3}))
    >>> len(found["expected"]["max_abs_spacing_error"]), found["verdict"]["string_stable"]
    (3, True)
    """
    run, mean, verdict = _Judged.of(scenario)
    document: dict[str, Any] = plain_values(
        {
            **run_document(run),
            "expected": run_document(mean),
            "verdict": verdict_document(verdict),
        },
        infinite=True,
    )
    return document
