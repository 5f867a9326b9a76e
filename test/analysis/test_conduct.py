"""What a verdict says of fallbacks, limits, sensors and packets that say something else."""

from pathlib import Path

import numpy as np
import pytest

from cacc_platoon.analysis import compute_metrics, judge
from cacc_platoon.analysis.age import link_reception
from cacc_platoon.analysis.fallback import (
    FallbackUse,
    fallback_premises,
    fallback_use,
)
from cacc_platoon.analysis.limits import limit_use
from cacc_platoon.analysis.premises import Conduct, restored
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import monte_carlo, simulate, simulate_mean
from cacc_platoon.simulation.course import reception_state

SHORT = {"platoon.followers": 2, "run.duration": 30.0}


def judged(values):
    run = simulate(Scenario.from_values({**SHORT, **values}))
    measured = compute_metrics(run)
    conduct = Conduct(measured.fallback, measured.limits)
    return judge(run.scenario, measured.noise, None, measured.reception, conduct)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"v2v.send_rule": "cam"}, "packets are sent as the sender moves"),
        ({"v2v.jitter": 0.05}, "packets take different times (v2v.jitter, up to 0.05 s"),
        ({"v2v.bias": 0.2, "v2v.noise_std": 0.1}, "v2v.bias, v2v.noise_std: up to 0.8 m/s^2)"),
        ({"v2v.quantum": 0.1}, "the expectation run neither rounds nor cuts"),
        ({"v2v.false_data": ("12 14 replay=2",)}, "false data between 12 and 14 s on 2 links"),
        ({"sensing.delay": 0.1}, "sensing.delay up to 0.1 s): what is proven is of sensors"),
        ({"sensing.range_std": 0.1}, "sensing.range_std up to 0.1 m)"),
        (
            {"v2v.reception": "fallback", "v2v.blackouts": (12.0, 15.0)},
            "2 of 2 vehicles fell back to a law without V2V, between 12.49 and",
        ),
        (
            {"vehicle.limits": "constant", "vehicle.max_jerk": 0.04},
            "limits of actuators acted on 2 of 2 vehicles between 10.",
        ),
    ],
)
def test_what_voids_a_certificate(values, words):
    verdict = judged(values)
    assert not verdict.certified
    assert any(words in reason for reason in verdict.void), verdict.void


@pytest.mark.slow
@pytest.mark.parametrize(
    "values",
    [
        {"vehicle.limits": "iso15622", "v2v.noise": "expected"},
        {"vehicle.limits": "constant"},
        {"vehicle.stops": True},
        {"v2v.reception": "fallback"},
        {"v2v.reception": "fallback", "v2v.loss": 0.1},
        {"v2v.in_order": True},
    ],
)
def test_what_does_not_act_voids_nothing(values):
    verdict = judged(values)
    assert verdict.certified, verdict.void


@pytest.mark.slow
def test_after_blackout_and_fallback_it_holds_again():
    silent = {"v2v.reception": "fallback", "v2v.blackouts": (12.0, 15.0)}
    verdict = judged(silent)
    used = fallback_use(simulate(Scenario.from_values({**SHORT, **silent})))
    assert verdict.holds_from == used[0].end
    assert "when that is over" in verdict.afterwards
    assert judged({**silent, "v2v.false_data": ("1 2 frozen",)}).holds_from is None


@pytest.mark.slow
def test_a_law_of_ones_own_is_not_said_to_blend_well(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "system"))
    silent = {"v2v.reception": "fallback", "v2v.blackouts": (12.0, 15.0)}
    for law, proven in (("", True), ("own_parts:Cautious", False)):
        words = " ".join(judged({**silent, "controller.law": law}).void)
        assert ("can destabilise a vehicle" in words) is proven
        assert ("nothing is proven of a vehicle that goes from one" in words) is not proven


def test_states_follow_the_share():
    share = np.array([1.0, 0.5, 0.0, 0.0, 0.5, 1.0, 1.0, 0.5, 1.0])
    assert reception_state(share).tolist() == [0, 1, 2, 2, 3, 0, 0, 1, 0]


def test_where_a_vehicle_stands_counts_as_a_limit():
    values = {**SHORT, "vehicle.stops": True, "leader.profile": "brake", "platoon.followers": 1}
    run = simulate(Scenario.from_values({**values, "leader.deceleration": 6.0}))
    assert run.velocity[:, 1:].min() >= 0.0
    (used,) = limit_use(run)
    assert 0.0 < used.share < 0.01  # it stands for a moment, and then creeps up
    assert used.begin > 15.0


@pytest.mark.slow
def test_links_that_send_as_they_move_know_what_was_sent():
    for extra in ({}, {"v2v.loss": 0.3}, {"v2v.latency": 0.05, "v2v.jitter": 0.1}):
        run = simulate(Scenario.from_values({**SHORT, "v2v.send_rule": "cam", **extra}))
        for link in link_reception(run):
            assert link.age_max >= 0.1
            assert link.sent > 100
            assert not link.loses_too_much
            assert (link.loss == 0.0) == ("v2v.loss" not in extra)


@pytest.mark.slow
def test_the_expectation_run_is_the_mean_of_errors_false_data_and_losses():
    values = {
        **SHORT,
        "run.duration": 18.0,
        "v2v.bias": 0.1,
        "v2v.noise_std": 0.2,
        "v2v.loss": 0.3,
        "v2v.period": 0.05,
        "v2v.false_data": ("11 12 factor=-2", "13 14 replay=1.5", "15 16 frozen"),
    }
    scenario = Scenario.from_values(values)
    ensemble, mean = monte_carlo(scenario, runs=400), simulate_mean(scenario)
    apart = np.abs(ensemble.mean - mean.spacing_error)
    assert (apart <= 4.5 * ensemble.standard_error + 1e-9).all()


def test_a_headway_that_moves_further_than_a_lyapunov_function_serves_is_named():
    moves = ("1 vehicle_1 controller.time_headway=30",)
    stiff = {"controller.k_v": 0.1, "controller.k_p": 20.0, "controller.time_headway": 0.6}
    for gains, wrong in (({}, False), (stiff, True)):
        one = Scenario.from_values(
            {**gains, "run.timeline": moves, "controller.headway_rate": 1.0, "run.duration": 60.0}
        )
        void = judge(one).void
        assert any("no Lyapunov function serves all in between" in line for line in void) == wrong
        assert any(line.startswith("parameters change from 1 s on") for line in void)


@pytest.mark.parametrize(
    ("changes", "rate", "until"),
    [
        (("1 vehicle_1 controller.time_headway=1.5", "9 vehicle_1 {}"), 0.5, 9.0 + 0.55 / 0.5),
        (("1 vehicle_1 controller.time_headway=1.5", "9 vehicle_1 {}"), 0.05, None),
        (("1 link_1 v2v.loss=0.5", "9 link_1 v2v.loss=0", "12 link_1 v2v.loss=0"), 1.0, 9.0),
    ],
)
def test_all_is_as_before_when_the_last_headway_has_come_back(changes, rate, until):
    back = f"controller.time_headway={Scenario.from_values({}).follower(1).gains.time_headway}"
    texts = tuple(text.format(back) for text in changes)
    values = {"run.timeline": texts, "controller.headway_rate": rate, "run.duration": 16.0}
    found = restored(Scenario.from_values({"platoon.followers": 2, **values}))
    assert found == (until if until is None else pytest.approx(until, abs=0.011))


def test_a_change_to_what_is_so_already_voids_nothing():
    texts = ("1 link_1 v2v.loss=0", "2 link_1 v2v.latency=0")
    verdict = judge(Scenario.from_values({"run.timeline": texts}))
    assert verdict.certified, verdict.void
    silent = {"v2v.reception": "fallback", "v2v.blackouts": (12.0, 15.0)}
    changing = judged({**silent, "run.timeline": texts})
    assert changing.holds_from == judged(silent).holds_from
    assert changing.holds_from is not None


def test_what_helps_against_growth_can_be_done():
    late: dict[str, object] = {"v2v.latency": 0.2}
    rare, prompt, moved = (
        " ".join(judge(Scenario.from_values(values)).void)
        for values in ({"v2v.period": 0.3}, late, {**late, "v2v.send_rule": "cam"})
    )
    assert ": send more often, or take gains" in rare
    assert "0.2 s late, accelerations grow" in prompt
    assert "0.2 s late (v2v.send_rule = cam sends less often), accelerations grow" in moved
    assert all("send more often" not in text for text in (prompt, moved))
    assert all(": send with less latency, or take gains" in text for text in (prompt, moved))


def test_a_blend_is_judged_at_every_time_headway_of_the_run():
    """At 1.2 s these gains blend with the law without V2V, at 0.5 s they do not."""
    values = {
        "controller.k_v": 0.2,
        "controller.k_p": 1.0,
        "controller.time_headway": 1.2,
        "v2v.reception": "fallback",
        "v2v.fallback_headway": 1.1,
        "run.duration": 20.0,
    }
    cases = [
        ((), "no blend of the two, however it changes, can"),
        (("1 vehicle_1 controller.time_headway=1.3",), "changes, while its time headway stays"),
        (("1 vehicle_1 controller.time_headway=0.5",), "nothing is proven of a vehicle that goes"),
    ]
    for timeline, said in cases:
        scenario = Scenario.from_values({**values, "run.timeline": timeline})
        used = FallbackUse(scenario.followers[0].index, (0.5, 0.1, 0.3, 0.1), 2.0, 9.0, 1)
        (line,) = fallback_premises(scenario, [used])
        assert said in line
