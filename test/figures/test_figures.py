"""Figures show what the records hold."""

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from cacc_platoon.analysis import compute_metrics
from cacc_platoon.figures import channel, motion, propagation, style
from cacc_platoon.figures.picture import Picture
from cacc_platoon.figures.topology import plot_topology
from cacc_platoon.simulation import monte_carlo, simulate


@pytest.fixture
def axes():
    return Figure().subplots()


def test_reduce_keeps_peaks_and_gaps():
    time = np.arange(50_000.0)
    values = np.sin(time / 300.0)
    values[31_234] = 7.0
    values[40_000:42_000] = np.nan
    t, v = style.reduce(time, values)
    assert len(t) == 2 * style.POINTS
    assert np.nanmax(v) == 7.0
    assert t[np.nanargmax(v)] == 31_234.0
    assert np.isnan(v).any()
    assert (np.diff(t) >= 0).all()


def test_spacing_errors_are_the_lines(axes, scenario):
    run = simulate(scenario)
    motion.plot_spacing_errors(axes, run)
    lines = axes.get_lines()
    assert len(lines) == 3
    for column, line in enumerate(lines):
        assert line.get_ydata().tolist() == run.spacing_error[:, column].tolist()
    assert axes.get_ylabel().endswith("[m]")


@pytest.mark.parametrize("followers", [1, 40])
def test_any_number_of_vehicles(bags, followers):
    run = simulate(bags.scenario({"platoon.followers": followers}))
    for draw in (
        motion.plot_spacing_errors,
        motion.plot_speeds,
        motion.plot_accelerations,
        motion.plot_gaps,
        motion.plot_space_time,
        motion.plot_waterfall,
    ):
        axes = Figure().subplots()
        draw(axes, run)
        assert 1 <= len(axes.get_lines()) <= 2 * motion.MOST_LINES
        assert axes.get_xlabel() == "time [s]"


def test_noise_figure(scenario):
    run = simulate(scenario)
    noise, signal = Figure().subplots(2)
    channel.plot_noise(noise, signal, run, 2)
    shown = noise.get_lines()[0].get_ydata()
    shown = shown[np.isfinite(shown)]
    assert 0.8 <= shown.min() <= shown.max() <= 1.2
    sent = next(line for line in signal.get_lines() if "sent" in line.get_label())
    assert sent.get_ydata().tolist() == run.acceleration[:, 1].tolist()


def drawn_cells(axes):
    """Return the cells of each colour as (begin, end, row), those of a patch together."""
    corners = [patch.get_path().vertices.reshape(-1, 5, 2) for patch in axes.patches]
    return [
        [(box[0, 0], box[1, 0], round(box[:4, 1].mean())) for box in boxes] for boxes in corners
    ]


@pytest.mark.parametrize("followers", [1, 12, 40])
def test_packets_figure(bags, followers):
    """One link is dark from 4 to 6 s; the others lose nothing and take 0.03 s."""
    dark = {"v2v.period": 0.1, "v2v.latency": 0.03, "vehicle_1.v2v.blackouts": [4.0, 6.0]}
    long = {"platoon.followers": followers, "run.duration": 20.0}
    run = simulate(bags.scenario(long).with_values(dark))
    first, second, third = Figure().subplots(3)
    channel.plot_packets(first, second, third, run)
    sent, lost, late = map(drawn_cells, (first, second, third))
    assert lost == [[(4.0, 6.0, 0)]]
    assert sum(len(cells) for cells in sent) >= followers
    [whole] = late
    assert (0.0, 4.0, 0) in whole
    assert (6.0, 20.0, 0) in whole
    assert len(whole) == followers + 1
    names = [label.get_text() for label in third.get_yticklabels()]
    assert names[0] == "0 to 1"
    assert len(names) == {1: 1, 12: 6, 40: 7}[followers]


def test_equal_cells_are_drawn_as_one(axes):
    level = np.array([[0, 0, 1, -1], [1, 1, 1, 1]])
    style.draw_cells(axes, np.array([0.0, 1.0, 2.0, 3.0, 4.0]), level, ["red", "blue"])
    assert drawn_cells(axes) == [[(0.0, 2.0, 0)], [(2.0, 3.0, 0), (0.0, 4.0, 1)]]


def test_age_figure_shows_the_margin(axes, bags):
    run = simulate(bags.scenario({"v2v.period": 0.1}))
    channel.plot_age(axes, run, run.scenario.topology.links[1], 0.07)
    age, margin = axes.get_lines()
    assert np.max(age.get_ydata()) == pytest.approx(0.09)
    assert set(margin.get_ydata()) == {0.07}
    assert "0.07 s" in axes.get_title()


def test_ensemble_band_holds_the_run(scenario):
    run, expectation = simulate(scenario), simulate(scenario, "expected")
    ensemble = monte_carlo(scenario, 5)
    assert (ensemble.low <= run.spacing_error + 1e-12).all()  # the run is the first of them
    first, last = Figure().subplots(2)
    propagation.plot_ensemble(first, last, ensemble, expectation, run)
    axes = Figure().subplots()
    propagation.plot_peaks(axes, compute_metrics(run), compute_metrics(expectation), ensemble)
    expected = next(line for line in axes.get_lines() if "expectation" in str(line.get_label()))
    assert np.asarray(expected.get_ydata()).tolist() == (
        compute_metrics(expectation).max_abs_spacing_error.tolist()
    )


def test_svg_stands_alone_and_is_the_same_every_time():
    def draw(axes):
        axes.plot([0, 1], [1, 0])

    one, two = (style.draw_svg("a <test>", draw) for _ in range(2))
    assert one == two
    assert "http" not in one
    assert 'aria-label="a &lt;test&gt;"' in one


def test_one_file_says_how_figures_look():
    room = Path(style.__file__).parent
    for pattern, where in (
        (r"rcParams|rc_context|FigureCanvas", room.parent),
        (r"#[\dA-Fa-f]{6}", room),
    ):
        files = [path for path in where.rglob("*.py") if re.search(pattern, path.read_text())]
        assert files == [Path(style.__file__)]


def test_png_and_svg_show_the_same(tmp_path):
    picture = Picture("one", "One", "A line.", lambda axes: axes.plot([0, 1]), height=2.0)
    svg, png = picture.save(tmp_path)
    assert svg.read_text() == style.standalone(picture.svg())
    width, height = np.frombuffer(png.read_bytes()[16:24], ">u4")  # of the PNG header
    assert (width, height) == (style.WIDTH * style.PIXELS_PER_INCH, 2 * style.PIXELS_PER_INCH)


def test_colours_differ_in_lightness():
    """Neighbours along the platoon differ in one direction of lightness, for any colour vision."""
    colours = np.array(style.vehicle_colours(12))[:, :3]
    lightness = colours @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(lightness) > 0).all()


@pytest.mark.parametrize(("followers", "links"), [(1, [1]), (4, [1, 2, 3, 4]), (12, [1, 2, 12])])
def test_topology_shows_who_hears_whom(axes, followers, links):
    """Every link that is drawn goes from i - 1 to i, and back to where that one is."""
    plot_topology(axes, followers)
    words = [text.get_text() for text in axes.texts]
    heard = [f"$w_{{{i},{i - 1}}}\\,a_{{{i - 1}}}$" for i in links]
    assert [word for word in words if word.startswith("$w")] == heard
    assert [word for word in words if word.isdigit()] == [str(i) for i in (0, *links)]
    assert ("..." in words) == (followers > 4)
    arrows = [text for text in axes.texts if getattr(text, "arrow_patch", None) is not None]
    assert len(arrows) == 2 * len(links) + 1
    radio, sensor = arrows[:2]
    assert radio.xy[0] < radio.get_position()[0]
    assert sensor.xy[0] > sensor.get_position()[0]
