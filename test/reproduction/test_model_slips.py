"""The slips of noise model, example and figures are shown by the runs, and each check can fail."""

import dataclasses
import itertools

import numpy as np
import pytest
from scipy import signal

from cacc_platoon.reproduction import model_slips as module
from cacc_platoon.reproduction.cases import case_scenario
from cacc_platoon.scenario.v2v_parameters import PAPER_BITS
from cacc_platoon.theory import EffectiveInterval


def slip(reports, words):
    (found,) = [one for one in module.model_slips(reports) if words in one.paper]
    return found


def test_all_are_shown(reports):
    found = list(module.model_slips(reports))
    assert len(found) >= 11
    for one in found:
        assert one.shown is True, one
        assert all(part.strip() and part.isascii() for part in one[:4])


def test_values_of_w_are_those_of_the_sum(monkeypatch):
    """All words of six bits, added up one by one."""
    monkeypatch.setattr(module, "PAPER_BITS", PAPER_BITS[:6])
    values = {
        0.8 + 0.2 * sum(z / 2**j for j, z in enumerate(word))
        for word in itertools.product((0, 1), repeat=6)
    }
    largest, count = module.noise_values()
    assert f"largest {max(values):.9f}, not 1.2" in largest.check
    assert count.check == f"64 values of w, {np.diff(sorted(values)).max():.3e} apart"


def test_probability_of_the_word_of_zeros(reports):
    chance = np.exp(np.log1p(-np.array(PAPER_BITS)).sum())
    assert f"{chance:.4e} a draw" in slip(reports, "rho = min over t").check
    assert f"{chance:.4e}" == "1.0287e-06"


def test_first_error_is_that_of_scipy(reports):
    """max|Phi a_0| of the published continuous law: docs/theory.md, section 1 (Setting)."""
    a = module.A
    k = a.k_a * 1.048173687744
    time = np.linspace(0.0, 200.0, 20_001)
    a_0 = np.where((time > 10) & (time < 10 + 20 * np.pi), 0.5 * np.sin(0.1 * (time - 10)), 0.0)
    loop = [0.5, 1.0, a.k_v + a.time_headway * a.k_p, a.k_p]
    above = [a.time_headway * k - 0.5, k + a.time_headway * a.k_v - 1.0]
    delta = np.abs(signal.lsim((above, loop), a_0, time)[1]).max()
    command = signal.lsim(([1.0], [0.5, 1.0]), a_0, time)[1]
    other = np.abs(signal.lsim((above, loop), command, time)[1]).max()
    assert delta == pytest.approx(1.595944, abs=2e-6)
    found = slip(reports, "perturbation").check.split("max|delta_1| ")[1].split(" m or ")
    assert float(found[0]) == pytest.approx(delta, abs=1e-4)
    assert float(found[1].split()[0]) == pytest.approx(other, abs=1e-4)


def test_figures_of_the_checks(reports):
    text = " ".join(one.check for one in module.model_slips(reports))
    for figure in ("1.199993896", "65536", "13.9794", "231 and 345 m", "6.435e-05", "69 s (A)"):
        assert figure in text
    assert "283 s (C)" in text
    assert "1.31 m" in text
    assert "0.30 % a hop" in text


WRONG = [
    ("effective_interval", lambda *_: EffectiveInterval(0.8, 1.19), "<= w <="),
    ("PAPER_BITS", (1e-9,) * 16, "rho = min over t"),
    ("_first_error", lambda _, a_0: 2.0 * a_0, "nothing is said of the first"),
    ("_first_error", lambda _, a_0: np.ones_like(a_0), "perturbation"),
    ("sampled_mean_square_index", lambda *_, **__: 1e-4, "z_{i,j}(t) changes"),
    ("slowest_time_constant", lambda *_: 5.0, "how fast errors vanish"),
    ("capacity", lambda *_: 3000.0, "positions are those of points"),
]


@pytest.mark.parametrize(("name", "wrong", "words"), WRONG)
def test_each_check_can_fail(monkeypatch, reports, name, wrong, words):
    monkeypatch.setattr(module, name, wrong)
    assert not slip(reports, words).shown


def test_initial_speed_is_compared_in_runs(monkeypatch, reports):
    scale = iter((0.6, 0.63))

    def other(case, settings):
        return case_scenario(case, {**settings, "controller.k_v": next(scale)})

    monkeypatch.setattr(module, "case_scenario", other)
    assert not slip(reports, "initial state").shown


def test_a_run_without_noise_shows_neither_scatter_nor_distance(reports):
    a = reports["A"]
    quiet = dataclasses.replace(
        a,
        run=dataclasses.replace(a.run, trajectory=a.expectation),
        measured=dataclasses.replace(
            a.measured, max_abs_spacing_error=a.expected.max_abs_spacing_error
        ),
        ensemble=None,
    )
    assert not module.single_run(quiet).shown
    assert not module.not_convergence(quiet).shown
