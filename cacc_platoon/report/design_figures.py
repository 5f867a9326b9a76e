"""The pictures of one design question, saved as SVG and PNG."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from cacc_platoon.figures.admissible_noise import plot_noise_regions
from cacc_platoon.figures.frequency_response import GROWTH, plot_response
from cacc_platoon.figures.gain_region import plot_regions
from cacc_platoon.figures.headway_bounds import (
    plot_headway_bounds,
    plot_headway_over_snr,
    plot_slope,
)
from cacc_platoon.figures.pareto_front import plot_pareto_front
from cacc_platoon.figures.picture import Picture
from cacc_platoon.theory import DesignError, exact_region, paper_region
from cacc_platoon.theory.headway_curves import bound_curves, headway_over_snr, slope_curve
from cacc_platoon.theory.lifted_hop import PacketTimes, packet_interval
from cacc_platoon.theory.response_band import packet_response_band, response_band

if TYPE_CHECKING:
    from cacc_platoon.design import Recommendation, Requirements
    from cacc_platoon.figures.style import Axes
    from cacc_platoon.model import Gains

__all__ = ["save_design_figures"]

_RHOS = (2.0, 5.0, 20.0, 1000.0)


def save_design_figures(
    folder: Path,
    gains: Gains,
    rho: float,
    tau_max: float,
    *,
    k_effective: float | None = None,
    requirements: Requirements | None = None,
    recommendation: Recommendation | None = None,
) -> list[Path]:
    """Draw and save every picture of a design question.

    Parameters
    ----------
    folder : Path
        Made when missing; pictures of the same names in it are replaced.
    gains : Gains
        Operating point.
    rho, tau_max : float
        SNR and largest lag [s].
    k_effective : float, optional
        Effective gain of the nominal response.
    requirements : Requirements, optional
        Its reception shrinks the regions where losses count as zero; its latency and V2V period
        add the growth per hop with such packets.
    recommendation : Recommendation, optional
        Adds the Pareto front.

    Returns
    -------
    list of Path
        Files written, SVG and PNG of each picture.

    Raises
    ------
    DesignError
        If the folder cannot be written or matplotlib is not installed.
    """
    reception = requirements.counted_as_zero if requirements else 1.0
    pictures = [
        *_stability_pictures(gains, rho, tau_max, k_effective, reception),
        *_packet_pictures(gains, rho, tau_max, requirements),
        *_headway_pictures(rho, tau_max),
        *_pareto_pictures(recommendation),
    ]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return [path for picture in pictures for path in picture.save(folder)]
    except ImportError as error:
        raise DesignError(
            "matplotlib is not installed: no picture can be drawn. Install it or leave the "
            "pictures out."
        ) from error
    except OSError as error:
        raise DesignError(
            f"{folder} cannot be written ({error.strerror}): the pictures are lost. Choose "
            "another folder."
        ) from error


def _stability_pictures(
    gains: Gains, rho: float, tau_max: float, k_effective: float | None, reception: float
) -> Iterator[Picture]:
    question = (gains.k_a, gains.time_headway, rho, tau_max)
    paper = paper_region(*question, reception=reception)
    exact = exact_region(*question, reception=reception)
    band = response_band(gains, rho, tau_max, k_effective=k_effective, reception=reception)

    def draw_regions(near: Axes, far: Axes) -> None:
        plot_regions(near, paper, exact, gains)
        plot_regions(far, paper, exact, gains, wide=True)

    yield Picture(
        "feasible_regions",
        "Feasible gains",
        "Gains that are string stable, exactly and by the paper, from near and from afar.",
        draw_regions,
        height=3.8,
        columns=2,
    )
    yield Picture(
        "frequency_response",
        "Propagation |H(jw)|",
        "From one vehicle to the next, and close to 1.",
        lambda far, close: plot_response(far, close, band),
        height=3.8,
        columns=2,
    )
    yield Picture(
        "noise_regions",
        "Admissible communicated acceleration",
        "Over the acceleration sent, and over time.",
        lambda plane, time: plot_noise_regions(plane, time, rho),
        height=3.8,
        columns=2,
    )


def _packet_pictures(
    gains: Gains, rho: float, tau_max: float, ask: Requirements | None
) -> Iterator[Picture]:
    if ask is None or (ask.v2v_period is None and ask.latency == 0):
        return
    apart = ask.v2v_period or ask.period
    packets = PacketTimes.of(ask.period, packet_interval(apart, ask.period), ask.latency, ask.held)
    reception = ask.counted_as_zero
    band = packet_response_band(gains, rho, tau_max, packets, reception=reception)
    yield Picture(
        "packet_response",
        "Growth per hop with such packets",
        f"One every {apart:g} s, {ask.latency:g} s late; control every {ask.period:g} s.",
        lambda far, close: plot_response(far, close, band, GROWTH),
        height=3.8,
        columns=2,
    )


def _headway_pictures(rho: float, tau_max: float) -> Iterator[Picture]:
    yield Picture(
        "headway_slope",
        "f(k_a)",
        "Its smaller root is k_a*, where the headway bound is least.",
        lambda axes: plot_slope(axes, slope_curve(rho)),
        height=3.8,
    )
    rhos = sorted({*_RHOS, rho}) if rho < 1e6 else _RHOS
    yield Picture(
        "headway_bounds",
        "Headway over k_a",
        "The paper's bound and the exact minimum for several SNR.",
        lambda axes: plot_headway_bounds(axes, bound_curves(rhos, tau_max)),
        height=3.8,
    )
    yield Picture(
        "headway_over_snr",
        "Headway over SNR",
        "The paper's least bound, the exact minimum, and the infimum.",
        lambda axes: plot_headway_over_snr(axes, headway_over_snr(tau_max)),
        height=3.8,
    )


def _pareto_pictures(found: Recommendation | None) -> Iterator[Picture]:
    if found is not None:
        yield Picture(
            "pareto_front",
            "Pareto set",
            "What a shorter headway costs.",
            lambda axes: plot_pareto_front(axes, found.front, found.designs, 3.0 * found.tau_max),
            height=4.2,
        )
