"""Figures of one run over time: spacing errors, speeds, gaps, platoon length, space and time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cacc_platoon.figures.style import (
    BLUE,
    FAINT,
    GREY,
    ORANGE,
    RED,
    Axes,
    reduce,
    spread,
    vehicle_colours,
)
from cacc_platoon.simulation import Trajectory
from cacc_platoon.simulation.trajectory import Array

MOST_LINES = 25
"""More vehicles than this are thinned out evenly; the first and the last stay."""

_MOST_TICKS = 7
_ON_TIME = 1e-4  # control periods: less is drawn as this, since decades have no zero


def plot_spacing_errors(axes: Axes, run: Trajectory) -> None:
    """Draw delta_i of every follower (the paper's spacing error figures), changes dashed."""
    plot_per_vehicle(axes, run.time, run.spacing_error, run.scenario.indices)
    for change in run.scenario.changes:
        if change.sample < run.scenario.samples:
            axes.axvline(change.sample * run.scenario.run.step, color=GREY, ls="--", lw=0.8)
    axes.set_ylabel(r"spacing error $\delta_i$ [m]")


def plot_speeds(axes: Axes, run: Trajectory) -> None:
    """Draw the speed of every vehicle, the leader included."""
    plot_per_vehicle(axes, run.time, run.velocity, run.scenario.vehicles)
    axes.set_ylabel(r"speed $v_i$ [m/s]")


def plot_accelerations(axes: Axes, run: Trajectory) -> None:
    """Draw the acceleration of every vehicle, the leader included."""
    plot_per_vehicle(axes, run.time, run.acceleration, run.scenario.vehicles)
    axes.set_ylabel(r"acceleration $a_i$ [m/s$^2$]")


def plot_gaps(axes: Axes, run: Trajectory) -> None:
    """Draw the gap in front of every follower."""
    plot_per_vehicle(axes, run.time, run.gap, run.scenario.indices)
    axes.set_ylabel(r"gap $x_{i-1} - x_i$ [m]")


def plot_space_time(axes: Axes, run: Trajectory) -> None:
    """Draw every path as seen from a frame that keeps the initial speed."""
    speed = run.scenario.platoon.initial_speed
    relative = run.position - speed * run.time[:, np.newaxis]
    plot_per_vehicle(axes, run.time, relative, run.scenario.vehicles)
    axes.set_ylabel(rf"position $x_i - {speed:g}$ m/s $\cdot\ t$ [m]")


def plot_waterfall(axes: Axes, run: Trajectory) -> None:
    """Draw the spacing errors one below the other, so that a wave can be seen to travel."""
    errors = run.spacing_error
    finite = np.abs(errors[np.isfinite(errors)])
    scale = float(np.max(finite)) if finite.size and np.max(finite) > 0 else 1.0
    columns = spread(errors.shape[1], MOST_LINES)
    distance = (columns[-1] - columns[0]) / max(len(columns) - 1, 1) or 1.0
    colours = vehicle_colours(errors.shape[1])
    for column in columns:
        base = float(run.scenario.indices[column])
        time, values = reduce(run.time, errors[:, column])
        axes.plot(time, base - 1.6 * distance * values / scale, color=colours[column])
        axes.axhline(base, color=FAINT, linewidth=0.5, zorder=0)
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set_yticks([run.scenario.indices[column] for column in columns[:: -(-len(columns) // 13)]])
    axes.set_xlabel("time [s]")
    axes.set_ylabel("vehicle")
    axes.set_title(f"from line to line: {scale / 1.6:.3g} m of error, positive upwards")


def plot_platoon_length(axes: Axes, runs: dict[str, Trajectory]) -> None:
    """Draw x_0 - x_N of one run or several (the paper's comparison of lengths).

    Parameters
    ----------
    axes : Axes
        Where to draw.
    runs : dict of str to Trajectory
        Runs by the text of the legend.
    """
    looks = ((BLUE, "-"), (ORANGE, "--"), (GREY, ":"))
    for (label, run), (colour, line) in zip(runs.items(), looks, strict=False):
        length = reduce(run.time, run.platoon_length)
        axes.plot(*length, color=colour, linestyle=line, label=label)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("platoon length $x_0 - x_N$ [m]")
    axes.legend()


def plot_lateness(axes: Axes, run: Trajectory) -> None:
    """Draw how late each follower took its samples [control periods], on a scale of decades."""
    assert run.timing is not None
    late = np.maximum(run.timing.lateness, _ON_TIME)
    plot_per_vehicle(axes, run.time, late, run.scenario.indices)
    axes.axhline(1.0, color=RED, linestyle="--", linewidth=1.0)
    axes.set_yscale("log")
    axes.set_ylabel("lateness [control periods]")


def plot_per_vehicle(axes: Axes, time: Array, values: Array, vehicles: range) -> None:
    """Draw one line per vehicle, coloured along the platoon, with a scale of the colours.

    Parameters
    ----------
    axes : Axes
        Where to draw.
    time : ndarray, shape (samples,)
        Time [s].
    values : ndarray, shape (samples, n)
        One column per vehicle.
    vehicles : range
        Index of the vehicle in each column.
    """
    columns = spread(values.shape[1], MOST_LINES)
    colours = vehicle_colours(len(columns))
    for column, colour in zip(columns, colours, strict=True):
        axes.plot(*reduce(time, values[:, column]), color=colour, linewidth=1.0)
    axes.set_xlabel("time [s]")
    _add_colour_scale(axes, [vehicles[column] for column in columns], colours)


def _add_colour_scale(axes: Axes, vehicles: list[int], colours: list[object]) -> None:
    from matplotlib.cm import ScalarMappable  # noqa: PLC0415
    from matplotlib.colors import BoundaryNorm, ListedColormap  # noqa: PLC0415

    count = len(vehicles)
    norm = BoundaryNorm([i - 0.5 for i in range(count + 1)], count)
    mappable = ScalarMappable(norm, ListedColormap(colours))
    scale = axes.figure.colorbar(mappable, ax=axes, pad=0.02, aspect=30)
    shown = spread(count, _MOST_TICKS if count > _MOST_TICKS + 6 else count)
    scale.set_ticks(shown, labels=[str(vehicles[i]) for i in shown])
    scale.ax.minorticks_off()
    scale.ax.tick_params(length=0)
    scale.ax.set_title("vehicle", fontsize=8.5)
    scale.outline.set_visible(False)


def plot_compared_errors(
    axes: Axes, time: Array, errors: Mapping[str, Array], vehicle: int
) -> None:
    """Draw spacing errors [m] of one vehicle over time [s], one curve a label."""
    for colour, (label, error) in zip((BLUE, ORANGE), errors.items(), strict=True):
        axes.plot(*reduce(time, error), color=colour, label=label)
    axes.set_xlabel("time [s]")
    axes.set_ylabel(rf"spacing error $\delta_{{{vehicle}}}$ [m]")
    axes.legend()
