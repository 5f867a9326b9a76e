"""Figures of the propagation |H(j omega)| from one vehicle to the next."""

from __future__ import annotations

import numpy as np

from cacc_platoon.figures.style import BLUE, RED, Axes, fill
from cacc_platoon.theory.response_band import ResponseBand

HOP = r"$|H(j\omega)|$"
GROWTH = "growth per hop"


def plot_response(far: Axes, close: Axes, band: ResponseBand, quantity: str = HOP) -> None:
    """Draw ``|H|`` over frequency with the band of lag and effective gain, whole and close to 1."""
    peak = max(1.0, float(np.max(band.high)))
    zoom = (1.0 - max(0.004, 2.0 * (peak - 1.0)), peak + max(0.001, 0.5 * (peak - 1.0)))
    for axes, limits in ((far, (0.0, 1.1 * peak)), (close, zoom)):
        uncertain = r"$\tau \in (0, \tau_0]$, $\tilde k_a \in I$"
        fill(axes, band.omega, band.low, band.high, label=uncertain)
        nominal = rf"$\tau = \tau_0$, $\tilde k_a$ = {band.k_effective:.4g}"
        axes.plot(band.omega, band.nominal, color=BLUE, label=nominal)
        axes.axhline(1.0, color=RED, linestyle="--", linewidth=1.0, label=f"{quantity} = 1")
        axes.set_xscale("log")
        axes.set_ylim(*limits)
        axes.set_xlabel(r"$\omega$ [rad/s]")
        axes.set_ylabel(f"{quantity} [-]")
    far.legend(loc="lower left")
