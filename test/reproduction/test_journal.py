"""What the journal version shows is near ours as far as it can be read; the rest is a question."""

import numpy as np
import pytest
from scipy import signal

from cacc_platoon.model import Gains
from cacc_platoon.reproduction import journal as module
from cacc_platoon.reproduction.cases import CASES
from cacc_platoon.theory import frequency_response

MEAN = 1.048173687744
A = Gains(0.95, 0.5, 0.63, 0.009)


def claim(reports, words):
    (found,) = [one for one in module.journal_claims(reports) if words in one.what]
    return found


@pytest.mark.slow
def test_all_that_can_be_read_agrees(reports):
    claims = module.journal_claims(reports)
    assert [one.agrees for one in claims] == [True] * 5 + [None]
    assert all(part.strip() and part.isascii() for one in claims for part in one[:4])


@pytest.mark.slow
def test_what_cannot_be_compared_is_a_question(reports):
    found = claim(reports, "optimal k_a")
    assert found.agrees is None
    assert found.measured == "0.9265 and 0.9220"
    assert "?" in found.basis


@pytest.mark.slow
def test_lengths(reports):
    assert claim(reports, "at rest").measured == "345.000 and 324.000"
    assert claim(reports, "at most").measured == "436.729 and 416.683"
    swapped = {"A": reports["C"], "C": reports["A"]}
    assert claim(swapped, "at rest").agrees is False
    assert claim(swapped, "at most").agrees is False


def chain_of_case_5():
    """(a_i, delta_i) of the vehicles from transfer functions of the continuous law (scipy)."""
    h, k, k_v, k_p = A.time_headway, A.k_a * MEAN, A.k_v, A.k_p
    time = np.linspace(0.0, 100.0, 10_001)
    a = np.where((time > 10) & (time < 10 + 20 * np.pi), 0.5 * np.sin(0.1 * (time - 10)), 0.0)
    peaks, errors = [], []
    for lag in module.LAGS:
        loop = [lag, 1.0, k_v + h * k_p, k_p]
        delta = signal.lsim(([h * k - lag, k + h * k_v - 1.0], loop), a, time)[1]
        a = signal.lsim(([k, k_v, k_p], loop), a, time)[1]
        peaks.append(np.abs(a).max())
        errors.append(np.abs(delta).max())
    return np.array(peaks), np.array(errors)


@pytest.mark.slow
def test_case_5_against_transfer_functions(reports):
    peaks, errors = chain_of_case_5()
    found = claim(reports, "max|a_1| and max|a_12|").measured.split(" and ")
    assert [float(one) for one in found] == pytest.approx([peaks[0], peaks[-1]], abs=6e-4)
    text = claim(reports, "max|delta_i| from").measured
    grows = int((np.diff(errors) > 0).sum())
    assert text.startswith(f"grows at {grows} of 11 hops")
    low, high = (float(one) for one in text.split(", ")[1].split(" m;")[0].split(" to "))
    assert (low, high) == pytest.approx((errors.min(), errors.max()), abs=2e-3)


def test_ratio_of_neighbouring_errors():
    """Phi_i H_{i-1}/Phi_{i-1} from the definitions of Phi and H, largest over the hops."""
    k = A.k_a * MEAN
    omega = np.geomspace(1e-4, 1e2, 2000)
    s = 1j * omega

    def phi(lag):
        above = (A.time_headway * k - lag) * s + k + A.time_headway * A.k_v - 1.0
        damping = A.k_v + A.time_headway * A.k_p
        return above / (lag * s**3 + s**2 + damping * s + A.k_p)

    pairs = zip(module.LAGS[1:], module.LAGS[:-1], strict=True)
    largest = max(
        np.abs(phi(own) / phi(ahead) * frequency_response(A, ahead, k, omega)).max()
        for own, ahead in pairs
    )
    assert module.spacing_error_ratio(A, k) == pytest.approx(largest, rel=1e-9)
    assert largest == pytest.approx(1.976, abs=5e-4)


def test_equal_lags_do_not_show_it(monkeypatch, reports):
    """With tau_0 everywhere delta_i = H delta_{i-1} holds, and errors fall."""
    monkeypatch.setattr(module, "LAGS", (0.5,) * 12)
    assert claim(reports, "max|delta_i| from").agrees is False
    assert module.spacing_error_ratio(A, A.k_a * MEAN) == pytest.approx(1.0, abs=1e-6)


def test_a_hop_that_amplifies_is_seen(monkeypatch, reports):
    """Case B, whose C < 0 at the mean gain does not depend on the lag."""
    monkeypatch.setattr(module, "CASES", (CASES[1], *CASES[1:]))
    assert claim(reports, "accelerations from vehicle").agrees is False


def test_other_gains_are_not_what_the_figure_shows(monkeypatch, reports):
    monkeypatch.setattr(module, "CASES", (CASES[2], *CASES[1:]))
    assert claim(reports, "max|a_1| and max|a_12|").agrees is False
