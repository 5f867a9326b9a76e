"""Figures of one run over time: spacing errors, platoon length, speed, gap."""

from __future__ import annotations

from cacc_platoon.analysis.figures.style import BLUE, ORANGE, Axes, reduce, vehicle_colours
from cacc_platoon.simulation import Trajectory
from cacc_platoon.simulation.trajectory import Array

_LEGEND_LIMIT = 14


def draw_spacing_errors(axes: Axes, run: Trajectory) -> None:
    """Draw delta_i of every follower (paper, spacing error figures)."""
    draw_per_vehicle(axes, run.time, run.spacing_error, first=1)
    axes.set_ylabel(r"spacing error $\delta_i$ [m]")


def draw_speeds(axes: Axes, run: Trajectory) -> None:
    """Draw the speed of every vehicle, the leader included."""
    draw_per_vehicle(axes, run.time, run.velocity, first=0)
    axes.set_ylabel(r"speed $v_i$ [m/s]")


def draw_gaps(axes: Axes, run: Trajectory) -> None:
    """Draw the gap in front of every follower."""
    draw_per_vehicle(axes, run.time, run.gap, first=1)
    axes.set_ylabel(r"gap $x_{i-1} - x_i$ [m]")


def draw_platoon_length(axes: Axes, run: Trajectory, expectation: Trajectory) -> None:
    """Draw x_0 - x_N of a run and of its expectation."""
    axes.plot(*reduce(run.time, run.platoon_length), color=BLUE, label="this run")
    axes.plot(
        *reduce(expectation.time, expectation.platoon_length),
        color=ORANGE,
        linestyle="--",
        label="expectation run, w = E[w]",
    )
    axes.set_xlabel("time [s]")
    axes.set_ylabel("platoon length $x_0 - x_N$ [m]")
    axes.legend()


def draw_per_vehicle(axes: Axes, time: Array, values: Array, first: int) -> None:
    """Draw one line per vehicle, coloured along the platoon."""
    count = values.shape[1]
    shown = set(range(count))
    if count > _LEGEND_LIMIT:
        shown = {round(i * (count - 1) / 7) for i in range(8)}
    for column, colour in enumerate(vehicle_colours(count)):
        label = f"{column + first}" if column in shown else None
        axes.plot(*reduce(time, values[:, column]), color=colour, label=label, linewidth=1.0)
    axes.set_xlabel("time [s]")
    axes.legend(
        title="vehicle",
        ncols=2 if len(shown) > 7 else 1,
        loc="center left",
        bbox_to_anchor=(1.0, 0.5),
    )
