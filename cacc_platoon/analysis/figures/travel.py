"""Figures of how errors travel along the platoon: peaks per vehicle, and many noisy runs."""

from __future__ import annotations

import numpy as np

from cacc_platoon.analysis.figures.style import BLUE, GREY, ORANGE, POINTS, RED, Axes, reduce
from cacc_platoon.analysis.metrics import Metrics
from cacc_platoon.simulation import Ensemble, Trajectory


def plot_peaks(
    axes: Axes, measured: Metrics, expected: Metrics, ensemble: Ensemble | None = None
) -> None:
    """Draw max|delta_i| over the vehicles: the run, its expectation, and many noisy runs."""
    index = [link.follower for link in measured.noise]
    if ensemble is not None:
        peaks = ensemble.max_abs_spacing_error
        label = f"{ensemble.runs} noisy runs, smallest to largest"
        axes.fill_between(
            index, peaks.min(axis=0), peaks.max(axis=0), color=BLUE, alpha=0.18, label=label
        )
    axes.plot(
        index, measured.max_abs_spacing_error, "o", color=BLUE, markersize=4, label="this run"
    )
    axes.plot(
        index,
        expected.max_abs_spacing_error,
        "-s",
        color=RED,
        markersize=3,
        label="expectation run, w = E[w]",
    )
    axes.set_xlabel("vehicle")
    axes.set_ylabel(r"$\max_t |\delta_i|$ [m]")
    axes.legend()


def plot_ensemble(
    first: Axes, last: Axes, ensemble: Ensemble, expectation: Trajectory, run: Trajectory
) -> None:
    """Draw the band of many noisy runs around their mean, for the first and last follower."""
    for axes, column in ((first, 0), (last, ensemble.mean.shape[1] - 1)):
        rows = np.linspace(0, len(expectation.time) - 1, POINTS).astype(np.int64)
        axes.fill_between(
            expectation.time[rows],
            ensemble.low[rows, column],
            ensemble.high[rows, column],
            color=BLUE,
            alpha=0.2,
            label=f"{ensemble.runs} noisy runs",
        )
        own = reduce(run.time, run.spacing_error[:, column])
        axes.plot(*own, color=GREY, linewidth=0.7, label="this run")
        mean = reduce(expectation.time, ensemble.mean[:, column])
        axes.plot(*mean, color=ORANGE, linewidth=2.0, label="their mean")
        drawn = reduce(expectation.time, expectation.spacing_error[:, column])
        axes.plot(*drawn, color=RED, linestyle="--", linewidth=1.0, label="expectation run")
        axes.set_ylabel(rf"$\delta_{{{run.scenario.indices[column]}}}$ [m]")
    first.legend(ncols=2)
    last.set_xlabel("time [s]")
