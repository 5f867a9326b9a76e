"""Lossy links in arrays: independent references, the mean system, channels from outside."""

import numpy as np
import pytest

from cacc_platoon.model import ComposedChannel, ConstantNoise, ContentNoise, IndependentLoss
from cacc_platoon.scenario import Follower, Scenario, ScenarioError
from cacc_platoon.simulation import monte_carlo, simulate, simulate_mean

SHORT = {"platoon.followers": 4, "run.duration": 30.0, "leader.start": 1.0, "v2v.loss": 0.4}


def lossy(reception="hold", **more):
    return Scenario.from_values({**SHORT, "v2v.reception": reception, **more})


@pytest.mark.parametrize("reception", ["hold", "zero"])
def test_what_is_used_is_the_last_that_arrived_or_zero(reception):
    run = simulate(lossy(reception))
    noise = lossy().follower(2).noise().factors(0, len(run.time))
    assert run.arrivals is not None
    arrived = set(run.arrivals[1].source.tolist())
    assert 0.5 < len(arrived) / len(run.time) < 0.7
    used = 0.0
    for k, actual in enumerate(run.received[:, 1]):
        if k in arrived:
            used = noise[k] * run.acceleration[k, 1]
        elif reception == "zero":
            used = 0.0
        assert actual == used


@pytest.mark.slow
def test_without_loss_there_is_one_system():
    whole = simulate(Scenario.from_values({**SHORT, "v2v.loss": 0.0}))
    assert whole.arrivals is None
    outside = simulate(
        lossy(), channel=lambda f: ComposedChannel([ContentNoise(f.noise()), Nothing()])
    )
    assert (outside.position == whole.position).all()
    assert (outside.received == whole.received).all()


class Nothing(IndependentLoss):
    """Says that it may lose packets, and loses none."""

    def __init__(self):
        super().__init__(0.0, 1, 1)


class Late:
    """Delays every packet by three samples."""

    prompt = False
    longest_delay = 3

    def apply(self, packets):
        return packets._replace(delay=packets.delay + 3)


def test_a_channel_of_ones_own_may_be_late():
    run = simulate(lossy(), channel=lambda _: ComposedChannel([Late()]))
    np.testing.assert_array_equal(run.received[3:, 0], run.acceleration[:-3, 0])
    assert (run.received[:3] == 0.0).all()


@pytest.mark.slow
@pytest.mark.parametrize("reception", ["hold", "zero"])
def test_the_mean_of_400_runs_is_the_mean_system(reception):
    scenario = lossy(reception, **{"run.duration": 20.0, "run.step": 0.02})
    mean, ensemble = simulate_mean(scenario), monte_carlo(scenario, 400)
    deviation = np.abs(ensemble.mean - mean.spacing_error)
    known = ensemble.standard_error > 1e-9  # below, the spread is rounding
    assert known.mean() > 0.5
    assert np.max(deviation[known] / ensemble.standard_error[known]) < 4.0
    # the wrong mean is far away: a receiver that holds has not the mean of one that takes zero
    other = simulate_mean(scenario.with_values({"v2v.reception": OTHER[reception]}))
    wrong = np.abs(ensemble.mean - other.spacing_error)
    assert np.max(wrong[known] / ensemble.standard_error[known]) > 20.0


OTHER = {"hold": "zero", "zero": "hold"}


@pytest.mark.slow
def test_a_link_that_loses_everything():
    for reception in ("hold", "zero"):
        run = simulate(lossy(reception, **{"v2v.loss": 1.0}))
        assert (run.received == 0.0).all()
        deaf = simulate(lossy(reception, **{"v2v.loss": 0.0, "controller.k_a": 0.0}))
        assert (run.position == deaf.position).all()


def test_one_lossy_link_among_others():
    scenario = Scenario.from_values({**SHORT, "v2v.loss": 0.0}, {2: {"v2v.loss": 0.5}})
    run, whole = simulate(scenario), simulate(Scenario.from_values({**SHORT, "v2v.loss": 0.0}))
    assert (run.position[:, :2] == whole.position[:, :2]).all()
    assert (run.position[:, 2] != whole.position[:, 2]).any()
    assert run.arrivals is not None
    assert (run.arrivals[0].sample == np.arange(len(run.time))).all()


def test_a_law_of_ones_own():
    class Deaf:
        def __init__(self, follower):
            self.law = follower.spacing_policy()

        def command(self, *inputs):
            return self.law.command(*inputs[:-1], 0.0)

    scenario = Scenario.from_values({**SHORT, "v2v.loss": 0.0})
    run = simulate(scenario, law=Deaf)
    same = simulate(scenario.with_values({"controller.k_a": 0.0}))
    assert (run.position == same.position).all()


def test_a_choice_without_its_branch_is_refused():
    with pytest.raises(ScenarioError, match=r"noise = 'bitz' must be bits | expected | none"):
        simulate(lossy(), "bitz")


def test_constant_noise_and_loss_worked_out():
    p, w = 0.6, 1.25
    channel = ComposedChannel([ContentNoise(ConstantNoise(w)), IndependentLoss(1 - p, 1, 1)])
    run = simulate(lossy("zero"), channel=lambda _: channel)
    share = np.count_nonzero(run.received[200:1500, 0]) / 1300
    assert abs(share - p) < 4 * np.sqrt(p * (1 - p) / 1300)


@pytest.mark.slow
def test_another_kind_of_law_is_never_taken_for_the_usual_one(monkeypatch):
    """Where `Follower.law` gives another class, the arrays use it."""

    class Timid:
        def __init__(self, law):
            self.law = law

        def command(self, *inputs):
            return 0.5 * self.law.command(*inputs)

    scenario = Scenario.from_values({**SHORT, "v2v.loss": 0.0})
    usual = simulate(scenario)
    monkeypatch.setattr(Follower, "law", lambda self: Timid(self.spacing_policy()))
    assert (simulate(scenario).position != usual.position).any()


def test_any_impairment_that_is_not_prompt_is_counted(monkeypatch):
    follower = Scenario.from_values({**SHORT, "v2v.loss": 0.0}).follower(1)
    assert not follower.counted
    monkeypatch.setattr(Follower, "composed", lambda *_: ComposedChannel([Late()]))
    assert follower.counted
