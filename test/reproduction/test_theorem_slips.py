"""The slips of theorems, definitions and notation are shown, and the check of each can fail."""

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import trapezoid

from cacc_platoon.model import Gains
from cacc_platoon.reproduction import theorem_slips as module
from cacc_platoon.theory import L2Gain, paper_region
from cacc_platoon.theory.theorem2 import PaperRegion

MEAN = 1.048173687744


def slips():
    return list(module.theorem_slips(MEAN))


def slip(words):
    (found,) = [one for one in slips() if words in one.paper]
    return found


def test_all_are_shown():
    for one in slips():
        assert one.shown is True, one
        assert all(part.strip() and part.isascii() for part in one[:4])
    assert len(slips()) >= 13


def largest(gains, k, tau, omega):
    """sup|H| over frequencies, by the definition of H."""
    s = 1j * omega
    damping = gains.k_v + gains.time_headway * gains.k_p
    loop = tau * s**3 + s**2 + damping * s + gains.k_p
    return np.abs((k * s**2 + gains.k_v * s + gains.k_p) / loop).max()


OMEGA = np.geomspace(1e-4, 1e3, 4000)


@pytest.mark.parametrize("gains", [module.OUTSIDE_S, module.BELOW_BOUND])
def test_designs_beyond_the_paper_are_stable_by_a_sweep(gains):
    for k in np.linspace(0.4, 0.6, 5):
        for tau in (0.01, 0.1, 0.3, 0.5):
            assert largest(gains, k, tau, OMEGA) <= 1 + 1e-9
            damping = gains.k_v + gains.time_headway * gains.k_p
            assert np.roots([tau, 1.0, damping, gains.k_p]).real.max() < 0


def test_a_negative_gain_is_stable_by_a_sweep():
    gains = module.NEGATIVE_GAIN
    assert all(largest(gains, -0.2, tau, OMEGA) <= 1 + 1e-9 for tau in (0.01, 0.1, 0.3, 0.5))


def test_two_norms_by_a_simulated_impulse_response():
    found = slip("in the frequency domain").check.split("L-infinity gain ")[1].split(", ")
    time = np.linspace(0.0, 3000.0, 150_001)
    for gains, text in zip((module.A, module.C), found, strict=True):
        damping = gains.k_v + gains.time_headway * gains.k_p
        hop = [gains.k_a * MEAN, gains.k_v, gains.k_p], [0.5, 1.0, damping, gains.k_p]
        _, h = signal.impulse(hop, T=time)
        norm = trapezoid(np.abs(h), time)
        assert float(text.split()[0]) == pytest.approx(norm, abs=2e-4)


def test_case_b_depends_on_the_bits_by_a_sweep():
    slow = np.geomspace(1e-3, 10, 4000)
    sizes = [largest(module.B, k, 0.5, slow) for k in (0.588, 0.589, 0.6, 0.6240, 0.6245)]
    assert [size <= 1 + 1e-12 for size in sizes] == [False, True, True, True, False]
    assert "from 0.588599 to 0.624019" in slip("exhibits string instability").check


def test_figures_of_the_checks():
    text = " ".join(one.check for one in slips())
    for figure in ("1.0214", "1.0605", "6.03 %", "0.714286 s", "-132.3", "49.15", "1.16319"):
        assert figure in text
    assert "600 of 600" in slip("a_1 >= a_2 or b_1 >= b_2").check


def empty(*_):
    return PaperRegion(0.5, 0.6, 0.7, 1.4, (), 0.0)


def full(*_):
    return PaperRegion(0.7, 0.8, 0.6, 1.2, ((0, 0), (0, 1), (1, 0)), 0.5)


WRONG = [
    ("linf_gain", lambda *_: 1.0, "in the frequency domain"),
    ("l2_gain", lambda *_: L2Gain(1.1, 0.2), "in the frequency domain"),
    ("paper_region", full, "again in its proof"),
    ("paper_region", empty, "again in its proof"),
    ("headway_bound", lambda *_: 1.0, "a_1 >= a_2 or b_1 >= b_2"),
    ("OUTSIDE_S", module.A, "intersection of F(k)"),
    ("OUTSIDE_S", module.B, "intersection of F(k)"),
    ("BELOW_BOUND", module.B, "lower bounds of the time headway"),
    ("BELOW_BOUND", module.A, "lower bounds of the time headway"),
    ("paper_region", full, "'employing'"),
    ("NEGATIVE_GAIN", Gains(1.1, -0.2, 0.8, 0.1), "implies 0 < k_a E[w] < 1"),
    ("slow_error_ratio", lambda *_: 1.0, "carries the vehicle i"),
    ("exponential_gaps", lambda *_: [1e-16] * 3, "lower triangular"),
    ("stable_gain_range", lambda *_: (0.61, 0.62), "exhibits string instability"),
    ("stable_gain_range", lambda *_: None, "exhibits string instability"),
    ("sure_gain", lambda *_: 1.0, "cyber-attacks"),
    ("PAPER_BITS", (0.63855,), "n counts the bits"),
    ("l2_gain", lambda *_: L2Gain(1.0, 0.0), "hw-0point75"),
]


@pytest.mark.parametrize(("name", "wrong", "words"), WRONG)
def test_each_check_can_fail(monkeypatch, name, wrong, words):
    monkeypatch.setattr(module, name, wrong)
    assert not slip(words).shown


def test_the_formula_for_an_empty_region_is_compared_with_its_sections(monkeypatch):
    def swapped(*question):
        region = paper_region(*question)
        return region._replace(a1=region.a2, a2=region.a1)

    monkeypatch.setattr(module, "paper_region", swapped)
    assert not slip("a_1 >= a_2 or b_1 >= b_2").shown
