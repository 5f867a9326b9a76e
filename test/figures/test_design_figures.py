"""Pictures: both formats, labelled axes with units, no warning, the same bytes every time."""

import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from matplotlib.figure import Figure

from cacc_platoon.design import Requirements, assess, recommend
from cacc_platoon.figures.admissible_noise import plot_noise_regions
from cacc_platoon.figures.frequency_response import plot_response
from cacc_platoon.figures.gain_region import plot_regions
from cacc_platoon.figures.headway_bounds import (
    plot_headway_bounds,
    plot_headway_over_snr,
    plot_slope,
)
from cacc_platoon.figures.pareto_front import plot_pareto_front
from cacc_platoon.model import Gains
from cacc_platoon.report.design_figures import save_design_figures
from cacc_platoon.theory import DesignError, exact_region, paper_region
from cacc_platoon.theory.headway_curves import bound_curves, headway_over_snr, slope_curve
from cacc_platoon.theory.lifted_hop import PacketTimes
from cacc_platoon.theory.multirate import worst_multirate_growth
from cacc_platoon.theory.response_band import packet_response_band, response_band

A = Gains(0.95, 0.5, 0.63, 0.009)
NAMES = ["feasible_regions", "frequency_response", "headway_bounds", "headway_over_snr"]
NAMES += ["headway_slope", "noise_regions"]


@pytest.mark.parametrize(
    ("gains", "rho"),
    [
        (A._replace(time_headway=0.65), 5.0),  # both regions empty
        (A._replace(time_headway=0.8), 5.0),  # the paper's empty, the exact one not
        (A._replace(k_a=0.0), 1.0001),
    ],
)
def test_figures_are_saved_in_both_formats(tmp_path, gains, rho):
    files = save_design_figures(tmp_path / "new", gains, rho, 0.5)
    assert sorted({path.stem for path in files}) == NAMES
    assert sorted({path.suffix for path in files}) == [".png", ".svg"]
    for path in files:
        if path.suffix == ".svg":
            ET.parse(path)
        else:
            assert path.read_bytes()[:4] == b"\x89PNG"


def test_pareto_front_is_drawn_and_svg_is_reproducible(tmp_path):
    found = recommend(5.0, 0.5, Requirements(k_a=0.5))
    first = save_design_figures(tmp_path / "a", A, 5.0, 0.5, recommendation=found)
    assert "pareto_front" in {path.stem for path in first}
    second = save_design_figures(tmp_path / "b", A, 5.0, 0.5)
    same = {path.name: path.read_bytes() for path in first if path.suffix == ".svg"}
    for path in second:
        if path.suffix == ".svg":
            assert path.read_bytes() == same[path.name]


def test_rare_and_late_packets_are_drawn(tmp_path):
    ask = Requirements(k_a=0.5, v2v_period=0.2, latency=0.02)
    found = recommend(5.0, 0.5, ask)
    drawn = save_design_figures(tmp_path, A, 5.0, 0.5, requirements=ask, recommendation=found)
    assert "packet_response" in {path.stem for path in drawn}
    packets = PacketTimes.of(0.01, 20, latency=0.02, held=1.0)
    grown = worst_multirate_growth(A, 5.0, 0.5, 0.01, 20, latency=0.02).growth
    band = packet_response_band(A, 5.0, 0.5, packets)
    assert band.high.max() == pytest.approx(grown, abs=1e-4)
    axes = Figure().subplots()
    plot_pareto_front(axes, found.front, (), latency_cap=1.5)
    written = {text.get_text() for text in axes.texts}
    for design in found.front:
        critical = design.certificate.critical_v2v_period
        assert (f"{critical:.3g}" if math.isfinite(critical) else "any") in written


def test_every_axis_has_a_label_with_a_unit():
    figure = Figure()
    axes = figure.subplots(2, 5).ravel()
    paper, exact = paper_region(0.5, 0.95, 5, 0.5), exact_region(0.5, 0.95, 5, 0.5)
    plot_regions(axes[0], paper, exact, A)
    plot_regions(axes[1], paper, exact, A, wide=True)
    plot_response(axes[2], axes[3], response_band(A, 5.0, 0.5))
    plot_slope(axes[4], slope_curve(5.0))
    plot_headway_bounds(axes[5], bound_curves([2.0, 5.0], 0.5))
    plot_headway_over_snr(axes[6], headway_over_snr(0.5))
    plot_noise_regions(axes[7], axes[8], 5.0)
    designs = [assess(A, 5.0, 0.5, name="A"), assess(A._replace(time_headway=1.1), 5.0, 0.5)]
    plot_pareto_front(axes[9], designs, designs[:1], latency_cap=0.1)
    for panel in axes:
        for label in (panel.get_xlabel(), panel.get_ylabel()):
            assert "[" in label, label
            assert "]" in label, label


def test_the_response_shows_the_numbers():
    far, close = Figure().subplots(2)
    band = response_band(A._replace(time_headway=0.65), 5.0, 0.5, k_effective=0.524086844)
    plot_response(far, close, band)
    for axes in (far, close):
        assert np.max(axes.lines[0].get_ydata()) == pytest.approx(1.001163718, abs=1e-6)
        assert axes.get_ylim()[1] > np.max(band.high) == pytest.approx(1.0034999, abs=1e-5)
    assert far.get_ylim()[0] == 0
    assert 0.99 < close.get_ylim()[0] < 1


def test_the_operating_point_is_in_sight_from_near_and_from_afar():
    far_out = A._replace(k_v=2.0, k_p=1.0)
    paper, exact = paper_region(0.5, 0.65, 5, 0.5), exact_region(0.5, 0.65, 5, 0.5)
    for gains in (A, far_out):
        near, wide = Figure().subplots(2)
        plot_regions(near, paper, exact, gains)
        plot_regions(wide, paper, exact, gains, wide=True)
        for axes in (near, wide):
            for limits, value in ((axes.get_xlim(), gains.k_p), (axes.get_ylim(), gains.k_v)):
                assert limits[0] <= value <= limits[1]
        assert wide.get_xlim()[1] >= max(8 * near.get_xlim()[1], 1 / 0.5**2)


def test_designs_in_one_place_share_a_label_inside_of_the_axes():
    one, other = assess(A, 5.0, 0.5, name="one"), assess(A, 5.0, 0.5, name="other")
    wide = assess(Gains(1.3, 0.5, 0.62, 0.1), 5.0, 0.5, name="wide")
    axes = Figure().subplots()
    plot_pareto_front(axes, [one, wide], [one, other, wide], latency_cap=0.1)
    labels = {text.get_text(): text.get_horizontalalignment() for text in axes.texts}
    assert labels == {"one, other": "left", "wide": "right"}
    assert np.asarray(axes.collections[1].get_offsets()).tolist() == [[1.3, 0.1]]  # beyond the axis


def test_a_place_that_cannot_be_written_is_refused(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(DesignError, match="Choose another folder"):
        save_design_figures(blocked, A, 5.0, 0.5)
