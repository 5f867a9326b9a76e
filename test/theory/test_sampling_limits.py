"""Every period and share of losses that is named as a way out holds, at all values below it.

With a headway above ``2 tau_0`` next to no V2V is stable too: where packets are held, stability is
lost in a band of periods and losses, and returns beyond it.
"""

from dataclasses import replace

import numpy as np
import pytest

from cacc_platoon.model import Gains
from cacc_platoon.theory import (
    Certificate,
    certify,
    critical_loss,
    critical_period,
    exact_region,
    minimum_headway,
    rounded_down,
    sampled_stability_map,
)

A = Gains(0.95, 0.5, 0.63, 0.009)
LAGS = 0.5 * np.linspace(0.0, 1.0, 17)
BELOW = np.concatenate((np.geomspace(1e-4, 1, 80), np.linspace(0.02, 1, 40))) * (1 - 1e-9)
FOUND = [
    (Gains(2.26, 0.5, 0.58, 0.018), 0.005, 0.01),
    (Gains(2.32, 0.5, 0.49, 0.045), 0.02, 0.01),
    (Gains(2.44, 0.5, 0.59, 0.035), 0.1, 0.01),
]


def all_hold(certificate, periods, held):
    h, _, k_v, k_p = certificate.gains
    grid = np.broadcast_arrays(np.reshape(periods, (-1, 1, 1)), np.reshape(held, (-1, 1, 1)))
    ends = np.array(certificate.interval)
    return sampled_stability_map(
        h, k_v, k_p, LAGS[:, np.newaxis], ends, period=grid[0], held=grid[1]
    ).all()


def follow(certificate: Certificate) -> int:
    """Follow what is named at many values below it; return how many ways out there were."""
    assert not certificate.sampled_string_stable
    period = float(rounded_down(certificate.critical_period))
    assert period <= certificate.period
    assert not period or all_hold(certificate, period * BELOW, certificate.held)
    if not certificate.fails_held:
        return period > 0
    share = float(rounded_down(certificate.critical_loss))
    assert share <= 1 - certificate.held
    assert not share or all_hold(certificate, certificate.period, 1 - share * BELOW)
    delays = share / (1 - share) * BELOW  # of held packets, in periods: losses close to one
    assert not share or all_hold(certificate, certificate.period, 1 / (1 + delays))
    return (period > 0) + (share > 0)


@pytest.mark.parametrize(("gains", "period", "held"), FOUND)
def test_a_way_out_lies_before_the_band_where_stability_is_lost(gains, period, held):
    certificate = certify(gains, 5.0, 0.5, period=period, held=held)
    assert follow(certificate) >= 1
    assert certificate.critical_period < period
    beyond = (replace(certificate, held=1e-4), replace(certificate, period=0.7))
    assert any(one.sampled_string_stable for one in beyond)


@pytest.mark.parametrize(
    ("k_a", "width"), [(0.25, 4.0), (0.218, 0.2), (0.217688, 0.02), (0.2176827, 0.002)]
)
def test_a_band_that_hardly_opens_is_seen(k_a, width):
    """Less k_a closes the band between 54 and 57 ms; half of `width` above its start it fails."""
    certificate = certify(Gains(2.26, k_a, 0.58, 0.018), 5.0, 0.5, held=0.01)
    first = certificate.critical_period
    above, beyond = first * (1 + width / 2), first * (1 + 2 * width)
    assert not replace(certificate, period=above).sampled_string_stable
    assert replace(certificate, period=beyond).sampled_string_stable
    assert follow(replace(certificate, period=above)) == 2


def test_without_a_band_nothing_is_found():
    closed = Gains(2.26, 0.21768, 0.58, 0.018)
    assert critical_period(closed, 5.0, 0.5, held=0.01) > 0.8
    assert critical_loss(closed, 5.0, 0.5, 0.005) == 1.0


def test_what_is_named_is_not_above_what_is_known_to_fail():
    for known in (1e-12, 1e-4, 0.01, 0.0444):
        assert critical_period(A, 5.0, 0.5, held=0.5, lost_at=known) <= known
        assert critical_loss(A, 5.0, 0.5, 0.01, lost_at=known) == known
    assert critical_loss(A, 5.0, 0.5, 0.01, lost_at=0.99) == pytest.approx(0.8806, abs=1e-4)


def random_design(rng):
    while True:
        k_a, h = rng.uniform(0.05, 0.8), rng.uniform(1.5, 3.0)
        if h < minimum_headway(k_a, 5.0, 0.5):
            continue
        region = exact_region(k_a, h, 5.0, 0.5)
        k_p = max(np.exp(rng.uniform(-5, 0)), 1.0001 * region.k_p_min)
        low, high = (float(x) for x in region.bounds(np.float64(k_p)))
        if high > low:
            k_v = low + rng.uniform() * (high - low)
            return Gains(h, k_a, max(k_v, 1e-3), float(k_p))


def test_no_way_out_of_random_designs_has_a_hole_below_it():
    rng, ways = np.random.default_rng(7), 0
    while ways < 50:
        period = float(np.exp(rng.uniform(np.log(1e-3), np.log(0.5))))
        held = float(np.exp(rng.uniform(np.log(0.01), np.log(0.5))))
        certificate = certify(random_design(rng), 5.0, 0.5, period=period, held=held)
        if not certificate.sampled_string_stable:
            ways += follow(certificate)
