"""Blends of two laws: the circle criterion against eigenvalues, Lyapunov functions, random runs."""

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov

from cacc_platoon.model.control import Gains
from cacc_platoon.model.fallback import gains_without_v2v
from cacc_platoon.theory import certify
from cacc_platoon.theory.switching import blend_is_stable

LAGS = np.geomspace(1e-3, 1.0, 25)


def matrix(gains, tau):
    """Return x' = A x of a vehicle behind one that stands."""
    c = gains.k_v + gains.k_p * gains.time_headway
    return np.array([[0, 1, 0], [0, 0, 1], [-gains.k_p / tau, -c / tau, -1 / tau]])


def shorten_narendra(first, second, tau):
    """Both stable, and no negative real eigenvalue of the product."""
    A, B = matrix(first, tau), matrix(second, tau)
    if max(np.linalg.eigvals(A).real.max(), np.linalg.eigvals(B).real.max()) >= 0:
        return False
    values = np.linalg.eigvals(A @ B)
    return not ((np.abs(values.imag) < 1e-9 * np.abs(values)) & (values.real < 0)).any()


def test_it_is_the_theorem_on_products_at_every_lag():
    rng = np.random.default_rng(1)
    decided = []
    for _ in range(600):
        one, other = (Gains(rng.uniform(0.1, 2), 0.0, *10 ** rng.uniform(-2, 1.3, 2)) for _ in "12")
        tau_max = float(10 ** rng.uniform(-2, 0))
        holds = all(shorten_narendra(one, other, tau_max * share) for share in LAGS)
        found = blend_is_stable(one, other, tau_max)
        decided.append(found)
        assert found <= holds
        if holds and not found:  # between the lags that were tried
            near = np.linspace(1e-3, 1.0, 20_000)
            assert not all(shorten_narendra(one, other, tau_max * share) for share in near)
    assert 0.2 < np.mean(decided) < 0.8


@pytest.mark.parametrize("tau_max", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("margin", [0.01, 0.1, 0.5])
def test_the_law_without_v2v_is_string_stable_for_every_lag(tau_max, margin):
    gains = gains_without_v2v(tau_max, 2.0 * (1.0 + margin) * tau_max)
    found = certify(gains, 5.0, tau_max, period=0.001 * tau_max)
    assert found.string_stable
    assert found.internally_stable
    assert found.sampled_string_stable


def test_a_blend_at_random_decays():
    """Shares that change at random at every sample, of the sampled loop of 10 ms."""
    first, second = Gains(0.95, 0.5, 0.63, 0.009), gains_without_v2v(0.5, 1.1)
    assert blend_is_stable(first, second, 0.5)
    rng = np.random.default_rng(2)
    for tau in (0.05, 0.25, 0.5):
        loops = [expm(matrix(law, tau) * 0.01) for law in (first, second)]
        P = solve_continuous_lyapunov(matrix(first, tau).T, -np.eye(3))
        assert np.linalg.eigvalsh(P).min() > 0
        state = np.array([1.0, 1.0, 0.0])
        for _ in range(60_000):
            state = loops[rng.integers(2)] @ state
        assert np.linalg.norm(state) < 1e-3


def test_laws_that_cannot_be_blended():
    first, second = Gains(0.95, 0.5, 0.1, 0.01), Gains(0.1, 0.0, 0.1, 20.0)
    assert not blend_is_stable(first, second, 0.001)
    assert not blend_is_stable(first, Gains(0.1, 0.0, 0.0, 3.0), 0.5)  # not stable itself
