"""The theorems' statements agree, against independent computations, and each can fail."""

import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import minimize_scalar

from cacc_platoon.model import Gains
from cacc_platoon.reproduction import mean_claims as mean_module
from cacc_platoon.reproduction import theorem_claims as module
from cacc_platoon.theory import (
    Optimum,
    headway_bound,
    headway_slope_roots,
    minimum_headway,
)
from cacc_platoon.theory.mean_equation import platoon_matrix
from cacc_platoon.theory.theorem2 import GammaRange

MEAN = 1.048173687744
K = 0.5 * MEAN


def all_claims():
    return [*module.theorem_claims(K), *mean_module.mean_claims(MEAN)]


def claim(words):
    (found,) = [one for one in all_claims() if words in one.what]
    return found


def test_all_agree_and_say_on_what_they_rest():
    for one in all_claims():
        assert one.agrees is True, one
        assert all(part.strip() for part in (one.where, one.what, one.paper, one.measured))
        assert one.basis
        assert one.paper.isascii()
        assert one.measured.isascii()


def test_known_gain_against_a_frequency_sweep():
    """|H| of k_v = (1 - k^2)/(2 tau_0), k_p = 0.1 at the headway, by its definition."""
    found = claim("known (case A)")
    assert found.measured.startswith("0.656130")
    headway, k_v, k_p = float(found.measured[:11]) + 1e-9, 1.0 - K * K, 0.1
    s = 1j * np.geomspace(1e-4, 1e3, 20_000)
    hop = (K * s * s + k_v * s + k_p) / (0.5 * s**3 + s * s + (k_v + headway * k_p) * s + k_p)
    assert np.abs(hop).max() <= 1.0 + 1e-9
    assert ": yes; 0.1 % below it 0 of" in found.measured


def test_slope_changes_sign_where_scipy_finds_the_minimum():
    def bound(k_a):
        return (1 - 0.8 * k_a) / (1 - 1.44 * k_a * k_a)

    least = minimize_scalar(bound, bounds=(0.0, 0.83), method="bounded", options={"xatol": 1e-9}).x
    assert float(claim("smaller root").measured.split()[0]) == pytest.approx(least, abs=1e-6)
    roots = np.roots([-0.8 * 1.44, 2 * 1.44, -0.8])
    assert float(claim("larger root").measured.split()[0]) == pytest.approx(max(roots), abs=1e-8)
    falling, rising = (claim(f"k_a in {name} ").measured for name in ("(0, r_1)", "(r_1, 1/M)"))
    assert all(float(end) < 0 for end in falling.split(" to "))
    assert all(float(end) > 0 for end in rising.split(" to "))


def test_range_of_gamma_and_throughput():
    assert (
        claim("gamma = k_v + h_w k_p at h_w = 0.95").measured == "0.638514 <= 0.638550 <= 0.640000"
    )
    text = claim("h* = 0.8727").measured
    assert [f" {n}" in f" {text}" for n in (3464, 3260, 4086, 4696)] == [True] * 4
    assert claim("h_w = 0.88 s against").measured == "3439 against 3224"


def test_bound_that_the_paper_drops():
    found = claim("largest 2 tau_0/(1 + k)")
    assert found.measured.startswith(f"{1 / 1.4:.6f}; robustly string stable gains there: yes")
    assert found.measured.endswith("below: no")


def test_internal_stability_is_that_of_the_roots():
    real = np.roots([0.5, 1.0, 0.85 + 0.88 * 0.003, 0.003]).real.max()
    text = claim("internal stability").measured
    assert float(text.split("rightmost pole ")[1].split()[0]) == pytest.approx(real, abs=1e-5)
    assert text.startswith(f"{(1 + 5**-0.5) ** 2 / 1.2:.6f}")


WRONG = [
    (module, "minimum_headway", lambda *a: 0.98 * minimum_headway(*a), "known (case A)"),
    (module, "minimum_headway", lambda *a: 1.02 * minimum_headway(*a), "known (case A)"),
    (module, "minimum_headway", lambda *a: 1.02 * minimum_headway(*a), "largest 2 tau_0/(1 + k)"),
    (module, "gamma_range", lambda *_: GammaRange(0.6386, 0.64), "at h_w = 0.95 s"),
    (module, "gamma_range", lambda *_: GammaRange(0.6, 0.6385), "at h_w = 0.95 s"),
    (module, "headway_slope_roots", lambda rho: (0.3, headway_slope_roots(rho)[1]), "smaller root"),
    (
        module,
        "headway_slope_roots",
        lambda rho: (0.35, headway_slope_roots(rho)[1]),
        "k_a in (0, r_1)",
    ),
    (
        module,
        "headway_slope_roots",
        lambda rho: (0.29, headway_slope_roots(rho)[1]),
        "k_a in (r_1, 1/M)",
    ),
    (module, "headway_slope_roots", lambda rho: (headway_slope_roots(rho)[0], 2.0), "larger root"),
    (module, "headway_slope", lambda k_a, _: k_a - 1.5, "beyond r_2"),
    (module, "headway_bound", lambda k_a, *_: 1.0 / (1 + k_a * k_a), "without noise"),
    (module, "headway_bound", lambda k_a, _, tau: headway_bound(k_a, 1e9, tau), "as rho falls"),
    (module, "k_a_max", lambda rho: min(rho / (1.0 + rho), 0.9), "largest k_a with noise"),
    (module, "optimum", lambda rho, _: Optimum(0.3, 0.9 - 1 / rho), "as rho grows"),
    (module, "optimum", lambda rho, tau: Optimum(0.3, 0.9 * tau), "internal stability"),
    (module, "poles", lambda gains, tau: np.zeros((len(tau), 3)), "internal stability"),
    (module, "capacity", lambda h, *_: h, "h_w = 0.88 s against"),
    (module, "capacity", lambda h, *_: h, "h* = 0.8727"),
    (mean_module, "matrix_exponential", lambda A: A @ A @ A + (A @ A) ** 2, "exp(A t)"),
    (mean_module, "matrix_exponential", lambda A: A**2, "exp(A t)"),
]


@pytest.mark.parametrize(("where", "name", "wrong", "words"), WRONG)
def test_each_can_fail(monkeypatch, where, name, wrong, words):
    monkeypatch.setattr(where, name, wrong)
    assert claim(words).agrees is False


def test_a_matrix_that_is_not_linear_in_w_is_seen(monkeypatch):
    monkeypatch.setattr(
        mean_module, "platoon_matrix", lambda *a: platoon_matrix(a[0], a[1], np.square(a[2]))
    )
    assert claim("E[A] = A(E[w])").agrees is False


def test_difference_of_exponentials_is_that_of_scipy():
    """With one factor for all links, where the difference is not rounding."""
    gains = Gains(0.95, 0.5, 0.63, 0.009)
    up = (MEAN - 0.8) / 0.4
    weights = np.array([1 - up, up])
    common = np.array([[0.8] * 3, [1.2] * 3])
    found = mean_module.exponential_gaps(gains, common, weights, MEAN)

    def exponential(w, t):
        return expm(platoon_matrix(gains, 0.5, w) * t)

    for t, gap in zip(mean_module.TIMES, found, strict=True):
        mean = sum(p * exponential(w, t) for p, w in zip(weights, common, strict=True))
        exact = exponential([MEAN] * 3, t)
        assert gap == pytest.approx(np.abs(mean - exact).max() / np.abs(exact).max(), rel=1e-6)
        assert gap > 1e-7
    assert math.isfinite(max(found))
