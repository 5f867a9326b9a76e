"""Figures of the headway: the paper's bound over k_a and over SNR, beside the exact minimum."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cacc_platoon.figures.style import BLUE, GREEN, INK, LINES, RED, Axes
from cacc_platoon.theory.headway_curves import BoundCurve, HeadwayOverSnr, SlopeCurve


def plot_slope(axes: Axes, curve: SlopeCurve) -> None:
    """Draw the paper's f(k_a) with both roots and the cap."""
    axes.plot(curve.k_a, curve.slope, color=BLUE, label=r"$f(k_a) = -mnk_a^2 + 2nk_a - m$")
    axes.axhline(0.0, color=INK, lw=0.8)
    axes.axvline(curve.k_a_max, color=RED, ls="--", label=f"cap $k_a$ < {curve.k_a_max:.4g}")
    shown = [root for root in curve.roots if root <= curve.k_a[-1]]
    axes.plot(
        shown,
        np.zeros(len(shown)),
        "o",
        color=INK,
        mfc="white",
        label="roots " + ", ".join(f"{root:.4g}" for root in curve.roots),
    )
    axes.set_xlabel(r"$k_a$ [-]")
    axes.set_ylabel(r"$f(k_a)$ [-]")
    axes.legend(loc="lower left", bbox_to_anchor=(0.38, 0.02))


def plot_headway_bounds(axes: Axes, curves: Sequence[BoundCurve]) -> None:
    """Draw the paper's bound over k_a for several SNR, the exact minimum thin below each."""
    top = 0.0
    for curve, (color, style) in zip(curves, LINES * len(curves), strict=False):
        axes.plot(curve.k_a, curve.paper, color=color, ls=style, label=rf"$\rho$ = {curve.rho:g}")
        axes.plot(curve.k_a, curve.exact, color=color, lw=0.8)
        axes.plot(*curve.optimum, "o", color=color, mfc="white")
        top = max(top, 1.6 * float(curve.paper[0]))
    axes.plot([], [], color=INK, lw=0.8, label="exact minimum (thin)")
    axes.plot([], [], "o", color=INK, mfc="white", label=r"$(k_a^*, h^*)$")
    axes.set_ylim(0.0, top)
    axes.set_xlabel(r"$k_a$ [-]")
    axes.set_ylabel(r"headway bound $h_{w,lb}$ [s]")
    axes.legend()


def plot_headway_over_snr(axes: Axes, curve: HeadwayOverSnr) -> None:
    """Draw minimal headways over SNR: the paper's, the exact one at k_a*, the infimum."""
    axes.plot(curve.snr_db, curve.paper, color=BLUE, label=r"paper, $h^*$")
    axes.plot(curve.snr_db, curve.exact, color=GREEN, ls="-.", label=r"exact at $k_a^*$")
    axes.plot(curve.snr_db, curve.infimum, color=RED, ls="--", label=r"infimum over $k_a$")
    axes.set_ylim(0.0, 1.08 * float(np.max(curve.paper)))
    axes.set_xlabel("SNR [dB]")
    axes.set_ylabel("minimal headway [s]")
    axes.legend()
