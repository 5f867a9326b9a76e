"""Every published figure of the design theory, to the digits given."""

import numpy as np
import pytest

from cacc_platoon.model import Gains, expected_factor, factor_variance
from cacc_platoon.theory import (
    NoiseStatistics,
    certify,
    effective_interval,
    exact_region,
    headway_bound,
    headway_slope,
    headway_slope_roots,
    infimum_headway,
    is_robustly_string_stable,
    k_a_max,
    l2_gain,
    linf_gain,
    mean_square_index,
    minimum_headway,
    optimum,
    paper_region,
    rho_from_snr_db,
    snr_db_from_rho,
)

RHO, TAU = 5.0, 0.5
BITS = [0.8055, 0.5767, 0.1829, 0.2399, 0.8865, 0.0287, 0.4899, 0.1679]
BITS += [0.9787, 0.7127, 0.5005, 0.4711, 0.0596, 0.6820, 0.0424, 0.0714]
MEAN, VARIANCE = expected_factor(RHO, BITS), factor_variance(RHO, BITS)
A = Gains(0.95, 0.5, 0.63, 0.009)
B = A._replace(time_headway=0.65)
C = Gains(0.88, optimum(RHO, TAU).k_a, 0.85, 0.003)


def near(value, digits):
    """Accept what rounds to `value` at `digits` decimals."""
    return pytest.approx(value, abs=0.51 * 10.0**-digits, rel=0)


def test_bounds_of_the_paper():
    assert k_a_max(RHO) == near(0.833333, 6)
    assert headway_bound(0.5, RHO, TAU) == pytest.approx(0.9375, abs=1e-12)
    assert optimum(RHO, TAU) == (near(0.318305009, 9), near(0.872677996, 9))
    assert effective_interval(0.5, RHO) == pytest.approx((0.4, 0.6))


def test_noise_of_case_a():
    assert near(1.048173687744, 12) == MEAN
    assert near(0.009215195660, 12) == VARIANCE
    assert near(0.524086844, 9) == 0.5 * MEAN


def test_region_of_case_a():
    region = paper_region(0.5, 0.95, RHO, TAU)
    assert region[:4] == (near(0.64, 6), near(0.673684, 6), near(0.631579, 6), near(1.329640, 6))
    expected = [(0, 0.631579), (0.0177285, 0.623158), (0, 0.64)]
    assert np.allclose(region.polygon, expected, atol=0.5e-6)
    assert region.area == near(7.4646e-5, 9)
    assert region.nonempty


def test_region_of_case_b_is_empty():
    region = paper_region(0.5, 0.65, RHO, TAU)
    assert (region.polygon, region.area, region.nonempty) == ((), 0.0, False)


def test_peaks_at_the_mean_gain():
    assert l2_gain(A, TAU, 0.5 * MEAN) == (1.0, 0.0)
    assert l2_gain(C, TAU, C.k_a * MEAN) == (1.0, 0.0)
    gain, omega = l2_gain(B, TAU, 0.5 * MEAN)
    assert gain == near(1.001163718, 9)
    assert omega == near(0.037939, 6)


def test_l_infinity_gains():
    assert linf_gain(A, TAU, 0.5 * MEAN) == near(1.0214, 4)
    assert linf_gain(C, TAU, C.k_a * MEAN) == near(1.0605, 4)
    assert linf_gain(A, TAU, 0.6) == near(1.0396, 4)
    assert linf_gain(C, TAU, 1.2 * C.k_a) == near(1.0661, 4)


def test_exact_headways():
    assert minimum_headway(0.5, RHO, TAU) == near(0.714286, 6)
    assert infimum_headway(RHO, TAU) == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("gains", "figures"),
    [(A, (95.9, 44.3, 81.8, 6.3e-5, 69)), (C, (34.5, 19.6, 45.4, 3.9e-5, 283))],
    ids=["A", "C"],
)
def test_tolerances(gains, figures):
    certificate = certify(gains, RHO, TAU, noise=NoiseStatistics(MEAN, VARIANCE, 0.01))
    fresh, stale, latency, index, slowest = figures
    assert certificate.critical_period * 1e3 == near(fresh, 1)
    assert certificate.joint_critical_period * 1e3 == near(stale, 1)
    assert certificate.latency_margin * 1e3 == near(latency, 1)
    k = gains.k_a * MEAN
    assert mean_square_index(gains, TAU, k, variance=VARIANCE, redraw_period=0.01) == near(index, 6)
    assert certificate.slowest_time_constant == near(slowest, 0)


def test_verdicts_of_the_three_cases():
    assert [is_robustly_string_stable(g, RHO, TAU) for g in (A, B, C)] == [True, False, True]
    assert not exact_region(0.5, 0.65, RHO, TAU).nonempty


def test_slope_of_the_bound_vanishes_at_its_roots_and_only_the_first_is_admissible():
    first, second = headway_slope_roots(RHO)
    assert first == pytest.approx(optimum(RHO, TAU).k_a, rel=1e-14)
    assert first < k_a_max(RHO) < second
    assert headway_slope(first, RHO) == pytest.approx(0, abs=1e-14)
    assert headway_slope(second, RHO) == pytest.approx(0, abs=1e-13)
    numeric = np.gradient([headway_bound(k, RHO, TAU) for k in np.linspace(0, 0.8, 801)], 1e-3)
    slope = [headway_slope(k, RHO) for k in np.linspace(0, 0.8, 801)]
    assert np.all((numeric > 0)[5:-5] == (np.array(slope) > 0)[5:-5])


def test_noise_free_limit():
    assert optimum(np.inf, TAU) == (1.0, TAU)
    assert headway_bound(0.4, 1e15, TAU) == pytest.approx(2 * TAU / 1.4, rel=1e-12)
    assert minimum_headway(0.4, np.inf, TAU) == pytest.approx(2 * TAU / 1.4)
    assert k_a_max(np.inf) == 1.0


def test_snr_in_decibels():
    assert snr_db_from_rho(5.0) == pytest.approx(20 * np.log10(5), abs=1e-13)
    assert rho_from_snr_db(snr_db_from_rho(5.0)) == pytest.approx(5.0, rel=1e-14)
