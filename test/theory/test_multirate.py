"""V2V at its own rate: every frequency that mixes, waves in the time domain, phases, losses."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cacc_platoon.model import Gains
from cacc_platoon.simulation.brute_force import lifted_growth, norm_ratios, response
from cacc_platoon.theory import (
    DesignError,
    certify,
    exact_region,
    explain_verdict,
    guarantees,
    minimum_headway,
    worst_sure_gain,
)
from cacc_platoon.theory.end_to_end import end_to_end_gain
from cacc_platoon.theory.lifted_hop import PacketTimes, packet_interval, spectral_radius
from cacc_platoon.theory.multirate import (
    bears_v2v_period,
    critical_v2v_period,
    multirate_growth,
    worst_multirate_growth,
)
from cacc_platoon.theory.phases import mean_phase_growth, worst_phase_growth

A = Gains(0.95, 0.5, 0.63, 0.009)
C = Gains(0.88, 0.318305009, 0.85, 0.003)
D = Gains(0.95, 0.5, 0.75, 1.0)
E = Gains(0.75, 0.5, 0.8, 0.5)
STIFF = Gains(0.8, 0.6104166666666666, 0.10012604732092761, 40.0)
"""It amplifies signals faster than half a packet a second where packets come every 0.5 s."""
FAST = Gains(0.32519953101693766, 0.965174129353234, 0.005252662821851819, 6.628358526900128)
"""At a lag of 0.3 s a period of 5 ms and a latency of two are too much for it."""
QUESTION = (5.0, 0.5, 0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gains", "interval", "growth", "omega"),
    [
        (A, 20, 1.0029958, 0.393),
        (A, 50, 1.0345083, 0.582),
        (D, 50, 1.1149186, 1.572),
        (E, 16, 1.0293930, 1.0997),
        (STIFF, 50, 3.9131739, 0.0),
    ],
)
def test_growth_of_given_designs(gains, interval, growth, omega):
    found = multirate_growth(gains, 0.5, 1.2 * gains.k_a, 0.01, interval)
    assert found.growth == pytest.approx(growth, rel=2e-6)
    assert not omega or found.omega == pytest.approx(omega, rel=2e-3)
    assert lifted_growth(gains, 0.5, 1.2 * gains.k_a, 0.01, interval) == pytest.approx(
        growth, rel=5e-4
    )


def test_a_narrow_peak_is_found():
    """Between two of 300 angles; it decides, and its height is known."""
    found = worst_multirate_growth(FAST, 200.0, 0.3, 0.005, 4, latency=0.006)
    k = (1 - 1 / 200) * FAST.k_a
    brute = lifted_growth(FAST, 0.3, k, 0.005, 4, age=2, count=60_000)
    assert (found.tau, found.k_effective) == (0.3, pytest.approx(k))
    assert brute > 1.08
    assert found.growth == pytest.approx(brute, rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gains", "worst", "mean"), [(A, 15, 37), (C, 7, 18), (D, 32, 41), (E, 8, 13), (STIFF, 7, 8)]
)
def test_critical_periods(gains, worst, mean):
    """E[w] of the paper's channel is 1.048173687744. Whole platoons on all sides of the limits."""
    assert critical_v2v_period(gains, *QUESTION) == pytest.approx(0.01 * worst)
    k = 1.048173687744 * gains.k_a
    assert critical_v2v_period(gains, *QUESTION, k_effective=k) == pytest.approx(0.01 * mean)
    assert lifted_growth(gains, 0.5, 1.2 * gains.k_a, 0.01, worst) <= 1.0
    assert lifted_growth(gains, 0.5, 1.2 * gains.k_a, 0.01, worst + 1, count=900) > 1.0
    assert lifted_growth(gains, 0.5, k, 0.01, mean) <= 1.0
    assert lifted_growth(gains, 0.5, k, 0.01, mean + 1) > 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gains", "interval", "close"), [(D, 50, 1e-4), (E, 16, 3e-5), (E, 9, 2e-5)]
)
def test_what_grows_in_theory_grows_in_the_time_domain(gains, interval, close):
    found = multirate_growth(gains, 0.5, 0.6, 0.01, interval)
    samples, wave = 12_000, 2.0 * math.pi / found.omega / 0.01
    command = np.cos(found.omega * 0.01 * np.arange(samples))
    since = samples - int(10 * wave)
    ratios = norm_ratios(
        gains, 0.5, 0.6, 0.01, command, vehicles=40, interval=interval, since=since
    )
    assert ratios[20:].mean() == pytest.approx(found.growth, abs=close)


def design_in_the_region(draw):
    stretch, k_a, k_p, place = draw
    headway = stretch * minimum_headway(k_a, 5.0, 0.5)
    k_p = max(exact_region(k_a, headway, 5.0, 0.5).k_p_min, 1e-3) * k_p
    low, high = exact_region(k_a, headway, 5.0, 0.5).bounds(np.array([k_p]))
    return Gains(headway, k_a, float(low[0] + place * (high[0] - low[0])), k_p)


@pytest.mark.slow
@given(
    st.tuples(
        st.floats(1.01, 2.0),
        st.floats(0.05, 0.8),
        st.floats(0.01, 4.6).map(math.exp),
        st.floats(0.05, 0.95),
    ),
    st.integers(1, 25),
    st.sampled_from([0, 0, 3, 20, 50]),
    st.sampled_from([1.0, 1.0, 0.6]),
)
@settings(max_examples=12)
def test_random_designs_against_all_frequencies_that_mix(draw, interval, late, held):
    gains = design_in_the_region(draw)
    assume(gains.k_v > 0 and certify(gains, 5.0, 0.5).sampled_string_stable)
    channel = {"latency": 0.01 * late, "held": held}
    found = worst_multirate_growth(gains, *QUESTION, interval, **channel).growth
    assert bears_v2v_period(gains, *QUESTION, interval, **channel) == (found == 1.0)
    brute = max(
        lifted_growth(
            gains, 0.5 * share, k * gains.k_a, 0.01, interval, age=late, held=held, count=120
        )
        for k in (0.8, 1.0, 1.2)
        for share in (0.05, 1.0)
    )
    assert found > brute * (1 - 1e-6) or brute <= 1 + 1e-9
    if found > 1 + 1e-3:
        assert brute > 1 - 1e-3


@given(
    st.integers(1, 60),
    st.sampled_from([0.1, 0.5, 1.0]),
    st.floats(-2, 0.5).map(lambda x: 10**x),
    st.floats(0.05, 1.0),
)
def test_spectral_radius_is_that_of_the_whole_matrix(interval, tau, k_p, k):
    """Where it is near one or above; below, any eigenvalue does."""
    packets = PacketTimes.of(0.01, interval, 0.02, 0.9)
    angle = np.geomspace(1e-2, np.pi, 12)
    diagonal, u = packets.hop(Gains(0.8, 0.5, 0.4, k_p), tau, k, angle)
    whole = np.eye(interval) * diagonal[:, :, np.newaxis] + u[:, :, np.newaxis]
    radius = np.abs(np.linalg.eigvals(whole)).max(axis=1)
    found = spectral_radius((diagonal, u))
    near = np.maximum(radius, found) > 0.9
    assert found[near] == pytest.approx(radius[near], rel=1e-5)


@pytest.mark.parametrize(
    ("gains", "interval", "bears"),
    [(A, 15, True), (A, 16, False), (E, 8, True), (E, 9, False), (FAST, 1, False)],
)
def test_bearing_packets_is_not_growing(gains, interval, bears):
    late = 0.01 if gains is FAST else 0.0
    question = (5.0, 0.3, 0.005) if gains is FAST else QUESTION
    grown = worst_multirate_growth(gains, *question, interval, latency=late)
    assert bears_v2v_period(gains, *question, interval, latency=late) is bears
    assert (grown.growth == 1.0) is bears


def test_a_packet_every_period_is_the_sampled_loop():
    for gains in (A, E):
        found = multirate_growth(gains, 0.5, 0.6, 0.2, 1)
        omega = np.geomspace(1e-2, np.pi / 0.2, 4000)
        sampled = np.abs(response(gains, 0.5, 0.6, 0.2, omega)).max()
        assert found.growth == pytest.approx(max(sampled, 1.0), rel=1e-5)


def test_without_v2v_no_rate_matters():
    silent = Gains(1.1, 0.0, 0.9, 0.1)
    assert critical_v2v_period(silent, *QUESTION) == math.inf
    assert critical_v2v_period(silent._replace(time_headway=0.9), *QUESTION) == 0.0


@pytest.mark.parametrize("phases", [[0], [0, 2, 5], [0] * 12, [3 * i % 10 for i in range(12)]])
def test_end_to_end_gain_is_the_largest_singular_value(phases):
    """The product of whole matrices, from the plant's own response."""
    interval, best = 10, 0.0
    for angle in np.geomspace(1e-3, np.pi, 150):
        turn = (angle + 2 * np.pi * np.arange(interval)) / interval
        silent = response(A, 0.5, 0.0, 0.01, turn / 0.01)
        heard = (response(A, 0.5, 0.6, 0.01, turn / 0.01) - silent) / interval
        heard = heard * np.exp(-1j * np.outer(turn, np.arange(interval))).sum(axis=1)
        product = np.eye(interval, dtype=np.complex128)
        for phase in phases:
            e = np.exp(1j * turn * phase)
            product = (np.diag(silent) + np.outer(heard / e, e)) @ product
        best = max(best, np.linalg.svd(product, compute_uv=False)[0])
    gain = end_to_end_gain(A, 0.5, 0.6, 0.01, interval, vehicles=len(phases), phases=phases)
    assert best * (1 - 1e-9) <= gain <= best * (1 + 5e-3)


def test_phases_of_their_own_mix_nothing_in_the_mean():
    """The mean of all hops is diagonal: what the lifted one does at each frequency alone."""
    packets = PacketTimes.of(0.01, 12, 0.0, 1.0)
    angle = np.array([0.02, 0.7, 3.0])
    diagonal, u = packets.hop(D, 0.5, 0.6, angle)
    turn = (angle[:, np.newaxis] + 2 * np.pi * packets.aliases) / 12
    mean = np.zeros((3, 12, 12), dtype=complex)
    for phase in range(12):
        e = np.exp(1j * turn * phase)
        mean += (u / e)[:, :, np.newaxis] * e[:, np.newaxis, :] / 12
    assert np.allclose(mean, np.eye(12) * u[:, :, np.newaxis])
    found = mean_phase_growth(D, 0.5, 0.6, 0.01, 50).growth
    packets = PacketTimes.of(0.01, 50, 0.0, 1.0)
    diagonal, u = packets.hop(D, 0.5, 0.6, np.linspace(1e-3, np.pi, 3000))
    assert found == pytest.approx(np.abs(diagonal + u).max(), rel=1e-5)


def test_certificate():
    asked = certify(A, 5.0, 0.5, v2v_period=0.2)
    assert asked.v2v_growth is not None
    assert asked.v2v_growth.growth == pytest.approx(1.0029958, rel=2e-6)
    assert asked.critical_v2v_period == pytest.approx(0.15)
    assert asked.v2v_end_to_end_gain(12) == pytest.approx(2.1765, rel=1e-3)
    assert certify(A, 5.0, 0.5).v2v_growth is None
    assert certify(A, 5.0, 0.5).v2v_end_to_end_gain(12) is None


def test_what_is_guaranteed_is_of_packets_at_their_own_rate():
    """An old acceleration is in use: the peaks are those of one that may be late in any way."""
    fresh, rare = certify(D, 5.0, 0.5), certify(D, 5.0, 0.5, v2v_period=1.0)
    late = worst_sure_gain(D, 5.0, 0.5, late=True)
    assert rare.worst_sure_gain == late != fresh.worst_sure_gain
    assert certify(D, 5.0, 0.5, v2v_period=0.01).worst_sure_gain == fresh.worst_sure_gain
    energy, peaks, errors, _, frozen = guarantees(rare)
    assert energy.mean.startswith(
        "grows by 1.38221 per hop in the long run with a packet every 1 s"
    )
    assert "not known" in energy.mean_square
    assert peaks.mean.endswith("of the loop without a V2V period of its own")
    assert errors.mean == "may grow"
    kept = certify(D, 5.0, 0.5, v2v_period=0.3)
    assert guarantees(kept)[2].mean == "not known: packets have a period of their own"
    assert "not known" in frozen.mean_square
    assert "with one every 1 s accelerations grow by 1.38221 per hop" in explain_verdict(rare)
    long = "does not grow in the long run with a packet every 0.3 s"
    assert guarantees(kept)[0].mean.startswith(long)
    assert "with one every" not in explain_verdict(kept)


LATER = Gains(1.0276291, 0.5204794, 0.4646634, 0.3213722)
"""String stable with a packet every 14 periods of 40 ms, two of them late, all sent at once."""


@pytest.mark.slow
def test_phases_may_be_worse_than_the_same_instants():
    question = (LATER, 0.5, (1 + 1 / 6.2338) * LATER.k_a, 0.04, 14)
    assert multirate_growth(*question, latency=0.08).growth == 1.0
    found = worst_phase_growth(*question, latency=0.08)
    assert found.step == 2
    assert found.growth.growth == pytest.approx(1.0116, abs=1e-4)
    ends = [
        end_to_end_gain(*question, vehicles=n, phases=[2 * i % 14 for i in range(n)], latency=0.08)
        for n in (40, 80)
    ]
    assert (ends[1] / ends[0]) ** (1 / 40) == pytest.approx(found.growth.growth, abs=1e-5)
    assert worst_phase_growth(D, 0.5, 0.6, 0.01, 20) == (multirate_growth(D, 0.5, 0.6, 0.01, 20), 0)
    assert worst_phase_growth(D, 0.5, 0.6, 0.01, 1).step == 0


@pytest.mark.parametrize("late", [0.5, 10.0])
def test_many_packets_on_their_way(late):
    growth = multirate_growth(A, 0.5, 0.6, 0.01, 10, latency=late).growth
    brute = lifted_growth(A, 0.5, 0.6, 0.01, 10, age=round(late / 0.01), count=3000)
    assert growth == pytest.approx(brute, rel=2e-3)
    assert growth > brute * (1 - 1e-3)


@pytest.mark.parametrize(
    ("v2v_period", "words"),
    [
        (0.105, "no whole multiple of the control period 0.01 s"),
        (3.0, "more than 256 control periods"),
        (0.001, "no whole multiple"),
        (0.0, "not a positive finite number"),
        (math.inf, "not a positive finite number"),
    ],
)
def test_periods_that_are_none(v2v_period, words):
    with pytest.raises(DesignError, match=words):
        packet_interval(v2v_period, 0.01)
    with pytest.raises(DesignError, match=words):
        certify(A, 5.0, 0.5, v2v_period=v2v_period)


def test_wrong_values():
    with pytest.raises(DesignError, match="interval = 0"):
        multirate_growth(A, 0.5, 0.6, 0.01, 0)
    with pytest.raises(DesignError, match="latency = -1"):
        multirate_growth(A, 0.5, 0.6, 0.01, 2, latency=-1.0)
    with pytest.raises(DesignError, match="more than 100000 control periods"):
        multirate_growth(A, 0.5, 0.6, 0.01, 2, latency=1e4)
    with pytest.raises(DesignError, match="held = 0"):
        multirate_growth(A, 0.5, 0.6, 0.01, 2, held=0.0)
    with pytest.raises(DesignError, match="phases = 2 values for vehicles = 3"):
        end_to_end_gain(A, 0.5, 0.6, 0.01, 2, vehicles=3, phases=[0, 1])
    loose = Gains(0.95, 0.5, 300.0, 0.009)
    assert multirate_growth(loose, 0.5, 0.6, 0.01, 2).growth == math.inf
    assert end_to_end_gain(loose, 0.5, 0.6, 0.01, 2, vehicles=3) == math.inf
    assert critical_v2v_period(loose, *QUESTION) == 0.0
