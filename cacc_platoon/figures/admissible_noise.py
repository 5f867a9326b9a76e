"""Figures of what the paper allows the channel to do, with what it did (the paper's Figs. 2, 3)."""

from __future__ import annotations

import numpy as np

from cacc_platoon.figures.style import BLUE, GREY, INK, ORANGE, RED, Axes, fill
from cacc_platoon.simulation import Trajectory
from cacc_platoon.simulation.trajectory import Array
from cacc_platoon.theory import effective_interval

_DOTS = 500


def plot_noise_cone(axes: Axes, run: Trajectory, column: int) -> None:
    """Draw the noise (w - 1) a over the acceleration a inside of |noise| <= |a|/rho (Fig. 2).

    Parameters
    ----------
    axes : Axes
        Where to draw.
    run : Trajectory
        Whose samples are the dots.
    column : int
        The link, 0 for leader to first follower.
    """
    sent, received = _dots(run, column)
    rho = run.scenario.followers[column].v2v.rho
    reach = _reach(sent)
    fill(axes, reach, -np.abs(reach) / rho, np.abs(reach) / rho, label="admissible")
    axes.plot(sent, received - sent, ".", color=ORANGE, markersize=3, label="samples of the run")
    axes.set_xlabel("acceleration sent $a_{i-1}$ [m/s$^2$]")
    axes.set_ylabel("noise $(w - 1)\\,a_{i-1}$ [m/s$^2$]")
    axes.legend()


def plot_received(axes: Axes, run: Trajectory, column: int) -> None:
    """Draw the received acceleration over the one sent, between (1 -+ 1/rho) a (Fig. 3)."""
    sent, received = _dots(run, column)
    rho = run.scenario.followers[column].v2v.rho
    reach = _reach(sent)
    _plot_limits(axes, reach, reach, rho)
    axes.plot(reach, reach, color=GREY, linewidth=0.8, label="without noise")
    axes.plot(sent, received, ".", color=ORANGE, markersize=3, label="samples of the run")
    axes.set_xlabel("acceleration sent $a_{i-1}$ [m/s$^2$]")
    axes.set_ylabel("received $w\\,a_{i-1}$ [m/s$^2$]")
    axes.legend()


def plot_noise_regions(plane: Axes, time: Axes, rho: float) -> None:
    """Draw the admissible received accelerations, over the true one and over time (Figs. 2, 3)."""
    a = np.linspace(-1.0, 1.0, 101)
    t = np.linspace(0.0, 2.0 * np.pi / 0.1, 400)
    signal = 0.5 * np.sin(0.1 * t)
    for axes, x, y in ((plane, a, a), (time, t, signal)):
        _plot_limits(axes, x, y, rho)
        axes.plot(x, y, color=BLUE, label="sent")
        axes.axhline(0.0, color=INK, lw=0.6)
        axes.set_ylabel(r"$w\,a_{i-1}$ [m/s$^2$]")
        axes.legend()
    plane.set_xlabel(r"$a_{i-1}$ [m/s$^2$]")
    time.set_xlabel("time [s]")


def _plot_limits(axes: Axes, x: Array, sent: Array, rho: float) -> None:
    """Draw what may be received of an acceleration that is sent, over any `x`."""
    low, high = effective_interval(1.0, rho)
    fill(axes, x, low * sent, high * sent, label=rf"admissible, $\rho$ = {rho:g}")
    for limit, line in ((low, ":"), (high, "--")):
        label = f"{limit:.4g} $a_{{i-1}}$"
        axes.plot(x, limit * sent, color=RED, linestyle=line, linewidth=1.0, label=label)


def _dots(run: Trajectory, column: int) -> tuple[Array, Array]:
    """Return sent and received accelerations at some of the samples that carry a signal."""
    sent, received = run.sent[:, column], run.received[:, column]
    rows = np.flatnonzero((sent != 0.0) & np.isfinite(sent) & np.isfinite(received))
    rows = rows[:: max(1, len(rows) // _DOTS)]
    return sent[rows], received[rows]


def _reach(sent: Array) -> Array:
    largest = float(np.max(np.abs(sent), initial=1e-3))
    return np.array([-largest, 0.0, largest])
