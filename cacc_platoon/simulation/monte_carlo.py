"""Many noisy runs of one platoon, and what their mean and spread say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation.bodies import Sensors
from cacc_platoon.simulation.draws import squared_ranges
from cacc_platoon.simulation.platoon import Progress, links_of_runs, propagate, used_of
from cacc_platoon.simulation.trajectory import Array, spacing_errors

BATCH_VALUES = 2_000_000
"""Runs are integrated together up to so many states (samples x runs x vehicles): 200 MB or so."""


@dataclass(frozen=True)
class Ensemble:
    """Pointwise statistics over the noisy runs of one scenario.

    Attributes
    ----------
    runs : int
        Number of runs; run r has the seed of the scenario plus r.
    mean, standard_error, low, high : ndarray, shape (samples, N)
        Spacing errors delta_i [m]: mean over the runs, its standard error, smallest and largest.
    max_abs_spacing_error : ndarray, shape (runs, N)
        max_t |delta_i| [m] of each run.
    squared_ranges : ndarray, shape (samples, L)
        Sum over the runs of `squared_ranges` of every link [m^2/s^4].
    """

    runs: int
    mean: Array
    standard_error: Array
    low: Array
    high: Array
    max_abs_spacing_error: Array
    squared_ranges: Array


def monte_carlo(scenario: Scenario, runs: int, progress: Progress | None = None) -> Ensemble:
    """Simulate `runs` noisy runs with consecutive seeds and gather their spacing errors.

    Examples
    --------
    >>> ensemble = monte_carlo(Scenario.from_values({"run.duration": 0.5}), runs=3)
    >>> ensemble.mean.shape, ensemble.max_abs_spacing_error.shape
    ((51, 12), (3, 12))
    """
    peaks: list[Array] = []
    shape = (scenario.samples, scenario.platoon.followers)
    total, squares = np.zeros(shape), np.zeros(shape)
    ranges = np.zeros((scenario.samples, len(scenario.receivers)))
    low, high = np.full(shape, np.inf), np.full(shape, -np.inf)
    batch = max(1, BATCH_VALUES // (scenario.samples * (scenario.platoon.followers + 1)))
    for start in range(0, runs, batch):
        seeds = range(start, min(start + batch, runs))
        errors, widths = _batch(scenario, seeds)
        ranges += widths
        peaks.append(np.abs(errors).max(axis=0))
        total += errors.sum(axis=1)
        squares += (errors**2).sum(axis=1)
        np.minimum(low, errors.min(axis=1), out=low)
        np.maximum(high, errors.max(axis=1), out=high)
        if progress:
            progress(seeds.stop, runs)
    mean = total / runs
    variance = np.maximum(squares / runs - mean**2, 0.0) * runs / max(runs - 1, 1)
    return Ensemble(runs, mean, np.sqrt(variance / runs), low, high, np.concatenate(peaks), ranges)


def _batch(scenario: Scenario, seeds: range) -> tuple[Array, Array]:
    """Return the spacing errors of a batch, (samples, len(seeds), N), and its squared ranges."""
    first = scenario.run.seed
    members = [scenario.with_values({"run.seed": first + offset}) for offset in seeds]
    links = links_of_runs(members)
    states = propagate(scenario, links, runs=len(seeds), sensors=Sensors.of(members))
    sent = states[2][:, :, scenario.topology.senders]
    used, _ = used_of(links, states)
    widths = squared_ranges(scenario, sent, used)
    return spacing_errors(scenario, *states[:2]), widths.sum(axis=1)
