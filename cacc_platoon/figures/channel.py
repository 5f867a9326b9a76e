"""Figures of the V2V channel: the noise factor and what a follower received."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from cacc_platoon.analysis.age import link_ages
from cacc_platoon.analysis.link_packets import packets_over_time
from cacc_platoon.analysis.monitor import MonitorUse
from cacc_platoon.analysis.noise import LinkNoise, noise_factor
from cacc_platoon.figures.style import (
    BLUE,
    GREY,
    ORANGE,
    PURPLE,
    RED,
    Axes,
    draw_cells,
    reduce,
    shades,
)
from cacc_platoon.model import Link, ReceptionState, factor_interval
from cacc_platoon.simulation import Trajectory
from cacc_platoon.simulation.course import reception_state
from cacc_platoon.simulation.trajectory import Array

_BESIDE = 0.2


def plot_noise(noise: Axes, signal: Axes, run: Trajectory, follower: int) -> None:
    """Draw w and the communicated acceleration of one link (the paper's link 1 -> 2).

    Parameters
    ----------
    noise, signal : Axes
        For w, and for the accelerations below it.
    run : Trajectory
        Whose link.
    follower : int
        The receiver; the sender is the vehicle before it.
    """
    rho = run.scenario.follower(follower).v2v.rho
    column = run.scenario.topology.links.index(Link(follower - 1, follower))
    factor = noise_factor(run)[:, column]
    noise.plot(*reduce(run.time, factor), color=BLUE, linewidth=0.4)
    for limit in factor_interval(rho):
        noise.axhline(limit, color=RED, linestyle="--", linewidth=1.0)
    noise.set_ylabel("noise factor $w$ [-]")
    noise.set_title(rf"link {follower - 1} to {follower}; dashed: $1 - 1/\rho$ and $1 + 1/\rho$")
    received = reduce(run.time, run.received[:, column])
    signal.plot(*received, color=ORANGE, linewidth=0.6, label=f"received by vehicle {follower}")
    sent = reduce(run.time, run.sent[:, column])
    signal.plot(*sent, color=BLUE, linewidth=1.2, label=f"sent by vehicle {follower - 1}")
    signal.set_xlabel("time [s]")
    signal.set_ylabel("acceleration [m/s$^2$]")
    signal.legend()


def plot_age(axes: Axes, run: Trajectory, link: Link, margin: float = math.nan) -> None:
    """Draw the age of information of one link over time [s], and the latency its design bears."""
    age = link_ages(run)[run.scenario.topology.links.index(link)]
    axes.plot(*reduce(run.time, age), color=BLUE, linewidth=0.6)
    if 0.0 < margin < math.inf:
        axes.axhline(margin, color=RED, linestyle="--", linewidth=1.0)
        axes.set_title(f"dashed: the latency margin, {margin:.3g} s")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("age of information [s]")


_SHARES = (0.0, 0.05, 0.2, 0.5, 0.99, 1.0)
_LEVELS, _MOST_TICKS = 4, 7
_ROUND = np.array([1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0])
_ABOUT = 1.02  # bins do not all hold the same number of samples


def plot_packets(sent: Axes, lost: Axes, late: Axes, run: Trajectory) -> None:
    """Draw how many packets each link sends, which share is lost, and how late the others are."""
    found = packets_over_time(run)
    rate = found.sent / np.diff(found.edges)
    with np.errstate(invalid="ignore"):
        share = found.lost / found.sent
    for axes, title, none, values, limits, colour in (
        (sent, "packets sent [1/s]", "none sent", rate, _round_limits(rate), BLUE),
        (lost, "share of them lost [-]", "none lost", share, np.array(_SHARES), RED),
        (
            *(late, "mean time to arrival [s]", "none late"),
            *(found.delay, _round_limits(found.delay), PURPLE),
        ),
    ):
        colours = shades(colour, len(limits) - 1)
        level = np.searchsorted(limits, np.where(values > 0.0, values, 0.0)) - 1
        draw_cells(axes, found.edges, np.minimum(level, len(colours) - 1), colours)
        something = bool((level >= 0).any())
        _add_levels(axes, limits if something else limits[:0], colours)
        if not something:
            axes.text(0.5, 0.5, none, transform=axes.transAxes, ha="center", va="center")
        axes.set_title(title, loc="left")
        _name_links(axes, run.scenario.topology.links)
    for axes in (sent, lost):
        axes.tick_params(labelbottom=False)
    late.set_xlabel("time [s]")


def _round_limits(values: Array) -> Array:
    """Return equal round steps from 0 to about the largest value."""
    most = float(np.max(values, initial=0.0, where=np.isfinite(values)))
    if not most:
        return np.arange(_LEVELS + 1.0)
    power = 10.0 ** np.floor(np.log10(most / _LEVELS))
    step = power * _ROUND[np.argmax(_ABOUT * _ROUND * power >= most / _LEVELS)]
    return np.asarray(np.arange(_LEVELS + 1) * step, np.float64)


def _name_links(axes: Axes, links: Sequence[Link]) -> None:
    shown = range(0, len(links), -(-len(links) // _MOST_TICKS))
    axes.set_yticks(shown, [f"{links[i].sender} to {links[i].receiver}" for i in shown])
    axes.set_ylabel("link")
    axes.grid(visible=False, axis="y")


def _add_levels(axes: Axes, limits: Array, colours: list[object]) -> None:
    """Show which colour stands for which values."""
    from matplotlib.cm import ScalarMappable  # noqa: PLC0415
    from matplotlib.colors import BoundaryNorm, ListedColormap  # noqa: PLC0415

    levels = ScalarMappable(BoundaryNorm(range(len(colours) + 1), len(colours)))
    levels.set_cmap(ListedColormap(colours))
    scale = axes.figure.colorbar(levels, ax=axes, pad=0.02, aspect=12)
    scale.set_ticks(range(len(limits)), labels=[f"{limit:.3g}" for limit in limits])
    scale.ax.minorticks_off()
    scale.ax.tick_params(length=0)
    scale.outline.set_visible(False)


STATES = {
    ReceptionState.DEGRADING: (ORANGE, "blends to the law without V2V"),
    ReceptionState.FALLBACK: (RED, "law without V2V"),
    ReceptionState.RECOVERING: (BLUE, "blends back"),
}


def plot_reception(axes: Axes, run: Trajectory) -> None:
    """Draw when each follower fell back to a law without V2V; `run` has shares."""
    assert run.share is not None
    step = run.scenario.run.step
    for number, follower in enumerate(run.scenario.indices):
        states = reception_state(run.share[:, number])
        turns = np.flatnonzero(np.diff(states)) + 1
        for begin, end in pairwise([0, *turns.tolist(), len(states)]):
            if (state := ReceptionState(states[begin])) in STATES:
                span = [(begin * step, (end - begin) * step)]
                axes.broken_barh(span, (follower - 0.35, 0.7), color=STATES[state][0])
    for color, label in STATES.values():
        axes.broken_barh([], (0.0, 0.0), color=color, label=label)
    axes.set_xlim(0.0, run.scenario.run.duration)
    axes.set_ylim(run.scenario.indices[-1] + 0.5, run.scenario.indices[0] - 0.5)
    axes.yaxis.get_major_locator().set_params(integer=True)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("follower")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.2), ncols=3)


def plot_alarms(axes: Axes, run: Trajectory, monitors: Sequence[MonitorUse]) -> None:
    """Draw when each monitor had an alarm, and when packets of its link were false."""
    indices, end = run.scenario.indices, run.scenario.run.duration
    for one in monitors:
        false = [(found.begin, found.end - found.begin) for found in one.detections]
        axes.broken_barh(false, (one.follower - 0.45, 0.9), color=GREY, alpha=0.4)
        alarms = [(begin, until - begin) for begin, until in one.spans]
        axes.broken_barh(alarms, (one.follower - 0.25, 0.5), color=RED)
    axes.broken_barh([], (0.0, 0.0), color=RED, label="alarm")
    axes.broken_barh([], (0.0, 0.0), color=GREY, alpha=0.4, label="false data")
    axes.set_xlim(0.0, end)
    axes.set_ylim(indices[-1] + 0.5, indices[0] - 0.5)
    axes.yaxis.get_major_locator().set_params(integer=True)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("follower")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.2), ncols=2)


def plot_link_noise(axes: Axes, links: list[LinkNoise]) -> None:
    """Draw the realised mean and range of w on every link beside what the parameters say.

    Links from further vehicles are drawn to the right of that from the predecessor.
    """
    used = [link for link in links if link.samples]
    index = [link.follower + _BESIDE * (link.follower - link.sender - 1) for link in used]
    mean = np.array([link.mean for link in used])
    low = np.array([link.low for link in used])
    high = np.array([link.high for link in used])
    axes.vlines(index, low, high, color=GREY, linewidth=1.5, label="smallest to largest")
    axes.plot(index, mean, "o", color=BLUE, markersize=4, label="mean")
    expected = [link.expected_mean for link in used]
    axes.plot(index, expected, "_", color=RED, markersize=9, label="$E[w]$ of the parameters")
    axes.set_xlabel("receiving vehicle")
    axes.set_ylabel("noise factor $w$ [-]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, 1.17), ncols=3)
