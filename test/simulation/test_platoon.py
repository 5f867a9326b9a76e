"""The whole platoon: the published figures, and a slow reference written out step by step."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from cacc_platoon.model import State
from cacc_platoon.model.channel import packets_by_sample
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import initial_positions, propagate, simulate
from cacc_platoon.simulation.links import links_of, plan_links

CONFIG = Path(__file__).parents[2] / "config"


@pytest.fixture(scope="module", params=["paper_a", "paper_b", "paper_c"])
def case(request):
    scenario = load_scenario(CONFIG / f"{request.param}.yaml")
    return request.param, simulate(scenario, "expected")


# max|delta_1|, max|delta_12| [m] at 100 Hz under zero-order hold with w = E[w], length at rest
# [m]: known values of the three published cases, computed independently of this package.
PUBLISHED = {
    "paper_a": (1.596227, 1.544609, 345.0),
    "paper_b": (0.882905, 0.888412, 255.0),
    "paper_c": (0.926459, 0.921985, 324.0),
}
PEAK_LENGTH = {"paper_a": 436.729, "paper_c": 416.683}


@pytest.mark.slow
def test_the_published_spacing_errors(case):
    name, run = case
    peaks = np.abs(run.spacing_error).max(axis=0)
    first, last, _ = PUBLISHED[name]
    assert peaks[0] == pytest.approx(first, abs=1e-6)
    assert peaks[-1] == pytest.approx(last, abs=1e-6)
    if name == "paper_b":
        assert peaks[-1] > peaks[0]
    else:
        assert np.all(np.diff(peaks) < 0.0)


def test_the_published_platoon_lengths(case):
    name, run = case
    length = PUBLISHED[name][2]
    assert run.platoon_length[0] == pytest.approx(length, abs=1e-9)
    if name in PEAK_LENGTH:
        assert run.platoon_length.max() == pytest.approx(PEAK_LENGTH[name], abs=1e-3)
    else:
        assert run.platoon_length.max() > length


@pytest.mark.slow
def test_a_vanishing_step_gives_the_figures_of_the_continuous_law():
    # docs/theory.md, section 1 (Setting): case A under the continuous law has max|delta_1| =
    # 1.595944 and max|delta_12| = 1.543560 m, and a largest length of 436.718 m; two steps
    # extrapolated to zero lead there
    values = load_scenario(CONFIG / "paper_a.yaml").values()
    figures = []
    for step in (0.01, 0.005):
        run = simulate(Scenario.from_values({**values, "run.step": step}), "expected")
        peaks = np.abs(run.spacing_error).max(axis=0)
        figures.append(np.array([peaks[0], peaks[-1], np.max(run.platoon_length)]))
    limit = 2.0 * figures[1] - figures[0]
    assert limit[:2] == pytest.approx([1.595944, 1.543560], abs=1e-5)
    assert limit[2] == pytest.approx(436.718, abs=1e-3)


MIXED = Scenario.from_values(
    {
        "platoon.followers": 4,
        "platoon.initial_speed": 20.0,
        "vehicle.tau": [0.5, 0.3, 0.2, 0.45],
        "leader.start": 0.5,
        "leader.angular_frequency": 1.5,
        "run.step": 0.02,
        "run.duration": 6.0,
        "v2v.hold": 0.06,
    },
    overrides={2: {"controller.k_v": 0.9, "v2v.rho": 3.0}, 3: {"v2v.noise": "expected"}},
)


@pytest.mark.slow
def test_a_platoon_of_unlike_vehicles_against_a_reference_written_out():
    """Every follower by matrix exponentials, sample by sample, from the paper's equations."""
    run, step, profile = simulate(MIXED), MIXED.run.step, MIXED.leader_profile()
    states = [profile.at(0.0)]
    for follower in MIXED.followers:
        gap = 5.0 + follower.gains.time_headway * 20.0
        states.append(State(states[-1].position - gap, 20.0, 0.0))
    for k in range(MIXED.samples):
        states[0] = profile.at(k * step)
        for i, state in enumerate(states):
            mine = (run.position[k, i], run.velocity[k, i], run.acceleration[k, i])
            assert mine == pytest.approx(tuple(state), rel=1e-11, abs=1e-9)
        following = []
        for follower in MIXED.followers:
            ahead, own = states[follower.index - 1], states[follower.index]
            w = follower.noise().factors(k, k + 1)[0]
            headway, k_a, k_v, k_p = follower.gains
            delta = own.position - ahead.position + 5.0 + headway * own.velocity
            u = k_a * w * ahead.acceleration - k_v * (own.velocity - ahead.velocity) - k_p * delta
            generator = np.zeros((4, 4))
            generator[0, 1] = generator[1, 2] = 1.0
            generator[2, 2:] = -1.0 / follower.tau, 1.0 / follower.tau
            following.append(State(*(expm(generator * step)[:3] @ [*own, u])))
            assert run.received[k, follower.index - 1] == pytest.approx(
                w * ahead.acceleration, abs=1e-10
            )
        states[1:] = following


def test_node_arithmetic_is_the_array_arithmetic_to_the_last_bit():
    """Scalars stepped one by one, as a node does, against the arrays."""
    run = simulate(MIXED)
    plants = [follower.plant(MIXED.run.step) for follower in MIXED.followers]
    laws = [follower.law() for follower in MIXED.followers]
    streams = [packets_by_sample(follower.channel(), MIXED.samples) for follower in MIXED.followers]
    leader = MIXED.leader_profile()
    states = [State(x, 20.0, 0.0) for x in initial_positions(MIXED)]
    for k in range(MIXED.samples):
        states[0] = leader.at(k * MIXED.run.step)
        rows = (run.position[k], run.velocity[k], run.acceleration[k])
        assert [tuple(state) for state in states] == list(zip(*rows, strict=True))
        after = list(states)
        for i, (plant, law, stream) in enumerate(zip(plants, laws, streams, strict=True)):
            ahead, own = states[i], states[i + 1]
            [packet] = next(stream)
            assert packet.source == k
            received = packet.value(ahead.acceleration)
            assert received == run.received[k, i]
            command = law.command(
                own.position, own.velocity, ahead.position, ahead.velocity, received
            )
            after[i + 1] = plant.advance(own, command)
        states = after


def test_the_continuous_system_is_approached_as_the_step_shrinks():
    """One follower and no noise, against an integration of the closed loop's own ODE."""
    values = {
        "platoon.followers": 1,
        "v2v.noise": "none",
        "leader.start": 0.0,
        "leader.angular_frequency": 1.0,
        "run.duration": 10.0,
    }
    scenario = Scenario.from_values(values)
    law, leader = scenario.follower(1).law(), scenario.leader_profile()

    def slope(time, y):
        ahead = leader.at(time)
        u = law.command(y[0], y[1], ahead.position, ahead.velocity, ahead.acceleration)
        return [y[1], y[2], (u - y[2]) / 0.5]

    start = [initial_positions(scenario)[1], 25.0, 0.0]
    exact = solve_ivp(slope, (0.0, 10.0), start, rtol=1e-10, atol=1e-10, max_step=0.05).y[:, -1]
    errors = []
    for step in (0.04, 0.02, 0.01):
        run = simulate(Scenario.from_values({**values, "run.step": step}))
        errors.append(abs(run.position[-1, 1] - exact[0]))
    assert errors[0] < 0.02
    assert errors[1] < 0.6 * errors[0]
    assert errors[2] < 0.6 * errors[1]


def test_runs_in_a_batch_do_not_touch_each_other():
    plans = [plan_links(MIXED, noise) for noise in ("bits", "none")]
    together = propagate(MIXED, links_of(MIXED.topology.senders, plans), runs=2)
    for r in range(2):
        alone = propagate(MIXED, links_of(MIXED.topology.senders, plans[r : r + 1]))
        for whole, single in zip(together, alone, strict=True):
            np.testing.assert_array_equal(whole[:, r], single[:, 0])


def test_a_follower_feels_only_what_is_ahead():
    base = simulate(MIXED)
    own = {**MIXED.overrides, 3: {"v2v.noise": "expected", "controller.k_v": 0.5}}
    changed = simulate(Scenario.from_values(MIXED.values(), own))
    for name in ("position", "velocity", "acceleration"):
        before, after = getattr(base, name), getattr(changed, name)
        np.testing.assert_array_equal(before[:, :3], after[:, :3])
        assert not np.array_equal(before[:, 3], after[:, 3])
        assert not np.array_equal(before[:, 4], after[:, 4])


def test_equilibrium_lasts():
    run = simulate(Scenario.from_values({"leader.profile": "constant", "run.duration": 20.0}))
    assert np.abs(run.spacing_error).max() < 1e-9
    assert np.abs(run.acceleration).max() < 1e-9
    np.testing.assert_allclose(run.gap, 5.0 + 0.95 * 25.0, atol=1e-9)


def test_what_a_trajectory_says_of_itself():
    run = simulate(MIXED)
    assert run.time[[0, 1, -1]] == pytest.approx([0.0, 0.02, 6.0])
    assert run.position.shape == (301, 5)
    assert run.received.shape == run.spacing_error.shape == run.gap.shape == (301, 4)
    np.testing.assert_allclose(run.gap.sum(axis=1), run.platoon_length)
    # gap = d + h_w v_i - delta_i
    headway = np.array([follower.gains.time_headway for follower in MIXED.followers])
    np.testing.assert_allclose(run.gap, 5.0 + headway * run.velocity[:, 1:] - run.spacing_error)


def test_progress_is_reported():
    calls = []
    simulate(Scenario.from_values({"run.duration": 15.0}), progress=lambda *at: calls.append(at))
    assert calls == [(0, 1501), (500, 1501), (1000, 1501)]


@pytest.mark.parametrize("first", [1, 40])
def test_every_link_draws_its_own_noise(first):
    followers = {"platoon.followers": 12, "platoon.first_follower": first}
    scenario = Scenario.from_values({**followers, "run.duration": 1.0})
    links = [scenario.follower(i).noise().factors(0, 200) for i in scenario.indices]
    for one, link in enumerate(links):
        for other in links[:one]:
            assert (link != other).mean() > 0.5  # 16 bits: two draws are hardly ever equal
    plans = [plan.factor for plan in plan_links(scenario)]
    np.testing.assert_array_equal(np.array(plans)[:, :101], np.array(links)[:, :101])
