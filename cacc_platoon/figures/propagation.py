"""Figures of how errors travel along the platoon: peaks per vehicle, and many noisy runs."""

from __future__ import annotations

import numpy as np

from cacc_platoon.analysis.metrics import Metrics
from cacc_platoon.figures.style import BLUE, GREY, ORANGE, POINTS, RED, Axes, fill
from cacc_platoon.simulation import Ensemble, Trajectory


def plot_peaks(
    axes: Axes, measured: Metrics, expected: Metrics, ensemble: Ensemble | None = None
) -> None:
    """Draw max|delta_i| over the vehicles: the run, its expectation, and many noisy runs."""
    index = np.unique([link.follower for link in measured.noise])
    if ensemble is not None:
        peaks = ensemble.max_abs_spacing_error
        label = f"{ensemble.runs} noisy runs, smallest to largest"
        fill(axes, index, peaks.min(axis=0), peaks.max(axis=0), label=label)
    axes.plot(
        index, measured.max_abs_spacing_error, "o", color=BLUE, markersize=4, label="this run"
    )
    axes.plot(
        index,
        expected.max_abs_spacing_error,
        "-s",
        color=RED,
        markersize=3,
        label="expectation run, $w = E[w]$",
    )
    axes.set_xlabel("vehicle")
    axes.set_ylabel(r"$\max_t |\delta_i|$ [m]")
    axes.legend()


def plot_ensemble(
    first: Axes, last: Axes, ensemble: Ensemble, expectation: Trajectory, run: Trajectory
) -> None:
    """Draw how far noisy runs are from the expectation run, for the first and last follower.

    The dashed lines are 4 standard errors of their mean from zero: a measure of it, not a test.
    """
    rows = np.linspace(0, len(expectation.time) - 1, POINTS).astype(np.int64)
    time = expectation.time[rows]
    for axes, column in ((first, 0), (last, ensemble.mean.shape[1] - 1)):
        base = expectation.spacing_error[rows, column]
        low, high = (side[rows, column] - base for side in (ensemble.low, ensemble.high))
        fill(axes, time, low, high, label=f"{ensemble.runs} runs")
        own = run.spacing_error[rows, column] - base
        axes.plot(time, own, color=GREY, linewidth=0.7, label="this run")
        mean = ensemble.mean[rows, column] - base
        axes.plot(time, mean, color=ORANGE, linewidth=1.6, label="mean of the runs")
        reach = 4.0 * ensemble.standard_error[rows, column]
        for side, label in ((-reach, None), (reach, "4 standard errors")):
            axes.plot(time, side, color=RED, linestyle="--", linewidth=0.9, label=label)
        vehicle = run.scenario.indices[column]
        axes.set_ylabel(rf"$\delta_{{{vehicle}}} - E[\delta_{{{vehicle}}}]$ [m]")
    first.legend(ncols=2)
    last.set_xlabel("time [s]")
