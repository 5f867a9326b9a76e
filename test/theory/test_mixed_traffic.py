"""Mixed traffic: random strings of vehicles, and drivers with a delay, from their own equations."""

import random

import numpy as np
import pytest

from cacc_platoon.model import Gains
from cacc_platoon.theory import (
    ConnectedVehicles,
    DesignError,
    HumanDriver,
    is_string_stable,
    least_connected_share,
    longest_delay,
    mixed_traffic_growth,
)
from cacc_platoon.theory.mixed_traffic import _least_shares

E = Gains(0.75, 0.5, 0.8, 0.5)
VEHICLES = ConnectedVehicles(E, 0.5, (0.4, 0.6))
SLOW = HumanDriver(0.5, 0.1, 1.4, 0.4)
RINGING = HumanDriver(0.6, 0.2, 1.4, 1.0)
QUICK = HumanDriver(1.5, 1.0, 1.0, 0.47)
OWN_LAG = HumanDriver(0.8, 0.3, 1.0, 0.3, lag=0.2)


def hop(gains, tau, k, omega):
    h, _, k_v, k_p = gains
    s = 1j * omega
    return (k * s**2 + k_v * s + k_p) / (tau * s**3 + s**2 + (k_v + h * k_p) * s + k_p)


def driver_hop(human, omega):
    s = 1j * omega
    seen = np.exp(-s * human.delay)
    law = human.k_v * s + human.k_p
    own = (human.lag * s + 1) * s**2 + seen * (law + human.k_p * human.time_headway * s)
    return seen * law / own


def log_gain_of_random_strings(share, factors, *, seed, strings=60, vehicles=2000):
    """Log of the gain of each string, vehicle by vehicle in a drawn order."""
    cacc, acc, human = factors
    connected = np.random.default_rng(seed).random((strings, vehicles + 1)) < share
    factor = np.where(
        connected[:, 1:],
        np.where(connected[:, :-1], cacc, acc),
        human,
    )
    return np.log(factor).sum(axis=1)


@pytest.mark.parametrize(
    ("human", "slow"),
    [(SLOW, True), (RINGING, False), (OWN_LAG, False), (QUICK, False)],
    ids=["slow", "rings", "lag", "quick"],
)
def test_random_strings_grow_below_the_least_share_and_shrink_above(human, slow):
    least = least_connected_share(VEHICLES, human)
    assert least is not None
    assert (least.omega == 0.0) == slow
    omega = least.omega or 0.02
    lag = min(0.5, (E.k_v + E.time_headway * E.k_p) / omega**2)
    k = max(VEHICLES.k_effective, key=lambda end: abs(hop(E, lag, end, omega)))
    factors = (
        abs(hop(E, lag, k, omega)),
        abs(hop(E, lag, 0.0, omega)),
        abs(driver_hop(human, omega)),
    )
    for share, sign in ((least.share - 0.03, 1), (0.5 * (1 + least.share) + 0.005, -1)):
        logs = log_gain_of_random_strings(share, factors, seed=11)
        assert (np.sign(logs) == sign).mean() > 0.95
        [mean] = mixed_traffic_growth(share, [omega], VEHICLES, human)
        error = logs.std() / np.sqrt(logs.size)
        assert logs.mean() == pytest.approx(2000 * mean, abs=4 * error)


def test_no_frequency_lag_or_gain_grows_from_the_least_share_on():
    """Brute force over lags, effective gains and shares; just below it some frequency grows."""
    omega = np.geomspace(1e-3, 20, 1500)
    for human in (SLOW, RINGING, OWN_LAG, QUICK):
        least = least_connected_share(VEHICLES, human)
        assert least is not None
        human_log = np.log(abs(driver_hop(human, omega)))
        for tau in (0.01, 0.1, 0.3, 0.5):
            acc = np.log(abs(hop(E, tau, 0.0, omega)))
            for k in (0.4, 0.5, 0.6):
                cacc = np.log(abs(hop(E, tau, k, omega)))
                for p in np.linspace(least.share, 1.0, 6):
                    mean = p * p * cacc + p * (1 - p) * acc + (1 - p) * human_log
                    assert (mean <= 1e-9 * omega**2).all()
        near = np.append(omega, max(least.omega, 1e-3))
        below = mixed_traffic_growth(least.share - 1e-3, near, VEHICLES, human)
        assert below.max() > 0


def test_growth_is_that_of_the_three_hops():
    omega = np.geomspace(0.05, 8, 40)
    vehicles = ConnectedVehicles(E, 0.5, (0.5,), acc_headway=1.3, shorter_lags=False)
    found = mixed_traffic_growth(0.6, omega, vehicles, OWN_LAG)
    parts = (
        0.36 * np.log(abs(hop(E, 0.5, 0.5, omega))),
        0.24 * np.log(abs(hop(E._replace(time_headway=1.3), 0.5, 0.0, omega))),
        0.4 * np.log(abs(driver_hop(OWN_LAG, omega))),
    )
    assert found == pytest.approx(sum(parts), rel=1e-9)


def test_the_least_share_is_the_largest_that_grows():
    """Quadratics with every sign, a share counted off a fine grid; not all fall with the share."""
    rng = np.random.default_rng(2)
    cacc, acc, human = -abs(rng.standard_normal(600)), *rng.standard_normal((2, 600))
    cacc[:40], acc[40:80], human[80:120], acc[120:160] = 0.0, 0.0, 0.0, cacc[120:160]
    cacc[160:170] = acc[160:170] = human[160:170] = -0.5  # vehicles all alike
    share = np.linspace(0, 1, 4001)[:, np.newaxis]
    mean = share**2 * cacc + share * (1 - share) * acc + (1 - share) * human
    grows = mean > 1e-12
    counted = np.where(grows, share, 0.0).max(axis=0)
    assert _least_shares(cacc, acc, human) == pytest.approx(counted, abs=1e-3)
    returns = (grows[1:] > grows[:-1]).any(axis=0)
    assert 20 < returns.sum() < 580


def test_a_longer_headway_behind_drivers_needs_fewer_connected_vehicles():
    short, long = (
        least_connected_share(VEHICLES._replace(acc_headway=h), SLOW) for h in (None, 1.4)
    )
    assert short is not None
    assert long is not None
    assert long.share < short.share - 0.05


def test_a_shorter_lag_may_ask_for_more():
    """QUICK swings at 2.8 rad/s, above ``sqrt(gamma/tau_0)`` = 1.5 rad/s."""
    every, longest = (
        least_connected_share(VEHICLES._replace(shorter_lags=lags), QUICK) for lags in (True, False)
    )
    assert every is not None
    assert longest is not None
    assert every.share > longest.share + 0.05


def test_drivers_who_do_not_amplify_need_none_and_a_design_that_does_has_none():
    calm = HumanDriver(1.0, 0.2, 2.0, 0.1)
    assert (abs(driver_hop(calm, np.geomspace(1e-3, 30, 3000))) <= 1).all()
    wide = Gains(1.6, 0.1, 0.7, 0.05)
    assert is_string_stable(wide, 0.5, 0.0)
    least = least_connected_share(ConnectedVehicles(wide, 0.5, (0.08, 0.12)), calm)
    assert least is not None
    assert least.share == 0.0
    case_b = VEHICLES._replace(gains=Gains(0.65, 0.5, 0.63, 0.009))
    assert least_connected_share(case_b, calm) is None


def test_a_driver_is_stable_up_to_the_longest_delay():
    """A delay by Pade's approximation of order 8, the roots of the polynomial that it leaves."""
    order = 8
    coefficients = [1.0]
    for i in range(1, order + 1):
        coefficients.append(coefficients[-1] * (order - i + 1) / (i * (2 * order - i + 1)))
    draw = random.Random(1)
    for _ in range(30):
        human = HumanDriver(
            draw.uniform(0, 1.5), 10 ** draw.uniform(-2, 0), draw.uniform(0.5, 2), 0.0,
            lag=draw.choice([0.0, draw.uniform(0.05, 0.3)]),
        )  # fmt: skip
        longest = longest_delay(human)
        for share, stable in ((0.97, True), (1.03, False)):
            pade = [c * (share * longest) ** i for i, c in enumerate(coefficients)]
            late = np.array([c * (-1) ** i for i, c in enumerate(pade)])[::-1]
            open_loop = np.polymul([human.lag, 1.0, 0.0, 0.0], pade[::-1])
            closed = np.polyadd(open_loop, np.polymul([human.damping, human.k_p], late))
            assert (np.roots(closed).real.max() < 0) == stable, (human, share)


def test_excess_at_zero_is_the_limit():
    for human in (SLOW, RINGING, OWN_LAG):
        still, near = human.excess([0.0, 1e-3])
        assert near == pytest.approx(still, rel=1e-3)
        omega = np.array([0.1, 0.7, 2.0])
        direct = (1 - abs(driver_hop(human, omega)) ** 2) / omega**2
        assert human.excess(omega) == pytest.approx(direct, rel=1e-9)


@pytest.mark.parametrize(
    ("gains", "human", "words"),
    [
        (E, SLOW._replace(delay=2.04), "human delay = 2.04 s is not below 2.033 s"),
        (E, SLOW._replace(lag=5.0), "human delay = 0.4 s is not below 0.2851 s"),
        (E, SLOW._replace(lag=9.0), "human delay = 0.4 s is not below -"),
        (E, SLOW._replace(k_p=0.0), "human k_p = 0 is not from 1e-06"),
        (E, SLOW._replace(delay=float("nan")), "human delay = nan"),
        (E._replace(k_p=50.0, k_v=0.1, time_headway=0.2), SLOW, "not stable behind a connected"),
    ],
)
def test_traffic_with_an_unstable_vehicle_is_refused(gains, human, words):
    with pytest.raises(DesignError, match=words):
        least_connected_share(VEHICLES._replace(gains=gains), human)
