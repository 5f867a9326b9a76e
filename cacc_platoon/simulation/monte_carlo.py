"""Many noisy runs of one platoon, and what their mean and spread say."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation.links import links_of, plan_links
from cacc_platoon.simulation.platoon import Progress, propagate
from cacc_platoon.simulation.trajectory import Array, Trajectory

BATCH_VALUES = 3_000_000
"""Runs are integrated together up to so many states (samples x runs x vehicles): 100 MB or so."""

NOT_BY_CHANCE = 5.0
"""Standard deviations that the largest of many normal deviations, one a vehicle and time, keeps."""


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
    """

    runs: int
    mean: Array
    standard_error: Array
    low: Array
    high: Array
    max_abs_spacing_error: Array


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
    low, high = np.full(shape, np.inf), np.full(shape, -np.inf)
    batch = max(1, BATCH_VALUES // (scenario.samples * (scenario.platoon.followers + 1)))
    for start in range(0, runs, batch):
        seeds = range(start, min(start + batch, runs))
        errors = _spacing_errors(scenario, seeds)
        peaks.append(np.abs(errors).max(axis=0))
        total += errors.sum(axis=1)
        squares += (errors**2).sum(axis=1)
        np.minimum(low, errors.min(axis=1), out=low)
        np.maximum(high, errors.max(axis=1), out=high)
        if progress:
            progress(seeds.stop, runs)
    mean = total / runs
    variance = np.maximum(squares / runs - mean**2, 0.0) * runs / max(runs - 1, 1)
    return Ensemble(runs, mean, np.sqrt(variance / runs), low, high, np.concatenate(peaks))


def chance_deviation(runs: int) -> float:
    """Return the standard errors by which a mean of so many runs may be off by chance.

    A standard error from few runs is itself uncertain: the bound is the quantile of Student's
    distribution that is as improbable as `NOT_BY_CHANCE` normal standard deviations, by Wallace's
    approximation.

    Examples
    --------
    >>> [round(chance_deviation(runs), 1) for runs in (10, 20, 400)]
    [12.6, 7.4, 5.1]
    """
    freedom = max(runs - 1, 1)
    z = NOT_BY_CHANCE * (8 * freedom + 3) / (8 * freedom + 1)
    return math.sqrt(freedom * math.expm1(z * z / freedom))


def _spacing_errors(scenario: Scenario, seeds: range) -> Array:
    """Return the spacing errors of a batch, shape (samples, len(seeds), N)."""
    first = scenario.run.seed
    members = [scenario.with_values({"run.seed": first + offset}) for offset in seeds]
    states = propagate(
        scenario, links_of(scenario, [plan_links(one) for one in members]), runs=len(seeds)
    )
    position, velocity, acceleration = (part.reshape(-1, part.shape[-1]) for part in states)
    trajectory = Trajectory(scenario, position, velocity, acceleration, received=np.empty((0, 0)))
    return trajectory.spacing_error.reshape(-1, len(seeds), scenario.platoon.followers)
