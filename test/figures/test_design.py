"""Pictures: both formats, labelled axes with units, no warning, the same bytes every time."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from matplotlib.figure import Figure

from cacc_platoon.design import Requirements, recommend
from cacc_platoon.figures import design as draw
from cacc_platoon.model import Gains
from cacc_platoon.report.design_figures import save_gallery
from cacc_platoon.theory import DesignError, exact_region, paper_region
from cacc_platoon.theory.curves import bound_curves, headway_over_snr, response_band, slope_curve

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
def test_gallery_is_saved_in_both_formats(tmp_path, gains, rho):
    files = save_gallery(tmp_path / "new", gains, rho, 0.5)
    assert sorted({path.stem for path in files}) == NAMES
    assert sorted({path.suffix for path in files}) == [".png", ".svg"]
    for path in files:
        if path.suffix == ".svg":
            ET.parse(path)
        else:
            assert path.read_bytes()[:4] == b"\x89PNG"


def test_pareto_front_is_drawn_and_svg_is_reproducible(tmp_path):
    found = recommend(5.0, 0.5, Requirements(k_a=0.5))
    first = save_gallery(tmp_path / "a", A, 5.0, 0.5, recommendation=found)
    assert "pareto_front" in {path.stem for path in first}
    second = save_gallery(tmp_path / "b", A, 5.0, 0.5)
    same = {path.name: path.read_bytes() for path in first if path.suffix == ".svg"}
    for path in second:
        if path.suffix == ".svg":
            assert path.read_bytes() == same[path.name]


def test_every_axis_has_a_label_with_a_unit():
    figure = Figure()
    axes = figure.subplots(2, 4).ravel()
    draw.plot_regions(
        axes[0], paper_region(0.5, 0.95, 5, 0.5), exact_region(0.5, 0.95, 5, 0.5), A, 0.02
    )
    draw.plot_response(axes[1], response_band(A, 5.0, 0.5))
    draw.plot_response(axes[2], response_band(A, 5.0, 0.5), close=True)
    draw.plot_slope(axes[3], slope_curve(5.0))
    draw.plot_headway_bounds(axes[4], bound_curves([2.0, 5.0], 0.5))
    draw.plot_headway_over_snr(axes[5], headway_over_snr(0.5))
    draw.plot_noise_regions(axes[6], axes[7], 5.0)
    for panel in axes:
        for label in (panel.get_xlabel(), panel.get_ylabel()):
            assert "[" in label, label
            assert "]" in label, label


def test_the_picture_shows_the_numbers():
    figure = Figure()
    axes = figure.subplots()
    band = response_band(A._replace(time_headway=0.65), 5.0, 0.5, k_effective=0.524086844)
    draw.plot_response(axes, band)
    curve = np.asarray(axes.lines[0].get_ydata())
    assert np.max(curve) == pytest.approx(1.001163718, abs=1e-6)
    assert np.max(band.high) == pytest.approx(1.0034999, abs=1e-5)
    low, high = axes.get_ylim()
    assert low == 0
    assert high > 1.0035


def test_a_place_that_cannot_be_written_is_refused(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(DesignError, match="Choose another folder"):
        save_gallery(blocked, A, 5.0, 0.5)
