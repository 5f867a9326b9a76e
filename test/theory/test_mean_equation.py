"""E[exp(A t)] = exp(E[A] t): exact for independent links, and for nothing less."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import StateSpace, lsim

from cacc_platoon.model import Gains
from cacc_platoon.theory import DesignError, frequency_response
from cacc_platoon.theory.mean_equation import link_outcomes, matrix_exponential, platoon_matrix

A = Gains(0.95, 0.5, 0.63, 0.009)
LOW, HIGH, MEAN = 0.8, 1.2, 1.048


def relative(one, other):
    return np.max(np.abs(one - other)) / np.max(np.abs(other))


@pytest.mark.parametrize("time", [0.0, 0.3, 10.0, 100.0])
def test_exponential_against_scipy(time):
    matrix = platoon_matrix(A, 0.5, [0.8, 1.1, 1.2]) * time
    assert relative(matrix_exponential(matrix), expm(matrix)) < 1e-12


@pytest.mark.parametrize("size", [1e-3, 1.0, 30.0])
def test_exponential_of_any_matrices(size):
    matrices = size * np.random.default_rng(3).normal(size=(5, 6, 6))
    expected = np.array([expm(one) for one in matrices])
    found = matrix_exponential(matrices)
    assert max(relative(*pair) for pair in zip(found, expected, strict=True)) < 1e-10


def test_the_matrix_is_the_platoon_of_the_transfer_functions():
    """|a_2/a_0| of the matrix at some frequencies against H^2, with one factor per link."""
    matrix = platoon_matrix(A, 0.5, [0.9, 1.1])
    omega = np.array([0.02, 0.3, 2.0])
    into = np.zeros((9, 1))
    into[2] = 1.0  # what drives a_0
    states = [np.linalg.solve(1j * w * np.eye(9) - matrix, into)[:, 0] for w in omega]
    found = np.array([state[8] / state[2] for state in states])
    hops = [frequency_response(A, 0.5, 0.5 * w, omega) for w in (0.9, 1.1)]
    assert np.allclose(found, hops[0] * hops[1], rtol=1e-9)


@pytest.mark.parametrize("time", [0.5, 5.0, 50.0])
def test_mean_of_the_exponential(time):
    factors, probability = link_outcomes((LOW, HIGH), MEAN, 3)
    every = np.array([expm(platoon_matrix(A, 0.5, w) * time) for w in factors])
    mean = np.tensordot(probability, every, axes=1)
    assert relative(mean, expm(platoon_matrix(A, 0.5, [MEAN] * 3) * time)) < 1e-12


def test_a_common_factor_has_another_mean():
    up = (MEAN - LOW) / (HIGH - LOW)
    every = [expm(platoon_matrix(A, 0.5, [w] * 3) * 2.0) for w in (LOW, HIGH)]
    mean = (1 - up) * every[0] + up * every[1]
    exact = expm(platoon_matrix(A, 0.5, [MEAN] * 3) * 2.0)
    assert np.abs(mean - exact)[3:6, :3].max() < 1e-14  # over one link nothing is multiplied
    assert np.abs(mean - exact)[8, 2] > 1e-3  # over two the mean of w^2 enters


def test_a_factor_may_change_in_time_in_any_way():
    """Second draws that are the opposite of the first ones: links stay independent, times not."""
    factors, probability = link_outcomes((LOW, HIGH), MEAN, 3)
    first, second = (
        np.array([expm(platoon_matrix(A, 0.5, w) * 1.5) for w in draws])
        for draws in (factors, LOW + HIGH - factors)
    )
    mean = np.tensordot(probability, second @ first, axes=1)
    steps = [expm(platoon_matrix(A, 0.5, [w] * 3) * 1.5) for w in (LOW + HIGH - MEAN, MEAN)]
    assert relative(mean, steps[0] @ steps[1]) < 1e-12


def test_mean_motion_of_a_whole_run():
    """Mean of all eight runs under a leader's signal against the run with the mean factors."""
    time = np.linspace(0.0, 40.0, 801)
    drive = np.sin(0.3 * time)
    into = np.zeros((12, 1))
    into[2] = 2.0

    def motion(w):
        system = StateSpace(platoon_matrix(A, 0.5, w), into, np.eye(12), np.zeros((12, 1)))
        return lsim(system, drive, time)[1]

    factors, probability = link_outcomes((LOW, HIGH), MEAN, 3)
    mean = sum(p * motion(w) for p, w in zip(probability, factors, strict=True))
    assert np.abs(mean - motion([MEAN] * 3)).max() < 1e-9
    assert np.abs(motion(factors[0]) - mean).max() > 0.1


def test_outcomes_have_the_mean():
    factors, probability = link_outcomes((LOW, HIGH), MEAN, 4)
    assert probability.sum() == pytest.approx(1.0)
    assert probability @ factors == pytest.approx([MEAN] * 4)
    assert probability @ (factors[:, 0] * factors[:, 3]) == pytest.approx(MEAN**2)


def test_what_does_not_exist_is_refused():
    with pytest.raises(DesignError, match="not between"):
        link_outcomes((LOW, HIGH), 1.3, 2)
    with pytest.raises(DesignError, match="tau"):
        platoon_matrix(A, 0.0, [1.0])
