"""Packets that are rare or late: the simulation beside theory, and what a run says of them."""

import numpy as np
import pytest

from cacc_platoon.analysis import judge
from cacc_platoon.analysis.age import link_reception
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.parameter import ScenarioError
from cacc_platoon.simulation import simulate
from cacc_platoon.simulation.mean_links import nominal
from cacc_platoon.simulation.monte_carlo import monte_carlo
from cacc_platoon.simulation.platoon import simulate_mean
from cacc_platoon.theory import certify
from cacc_platoon.theory.multirate import critical_v2v_period, worst_multirate_growth

STEP = 0.01
C = {"controller.time_headway": 0.88, "controller.k_a": 0.3183050093750877}
C |= {"controller.k_v": 0.85, "controller.k_p": 0.003}
D = {"controller.time_headway": 0.95, "controller.k_a": 0.5, "controller.k_v": 0.75}
D |= {"controller.k_p": 1.0}
FALLING = {"run.timeline": ("2 link_1 v2v.latency=0.5", "3 link_1 v2v.latency=0")}
DESIGNS = {"A": {}, "C": C, "D": D}
"""Cases A and C of the paper, and one of our own."""


def scenario(**values):
    """Values by dotted name, a dot being two underscores; noise at its mean unless given."""
    given = {name.replace("__", "."): value for name, value in values.items()}
    return Scenario.from_values({"v2v.noise": "expected", **given})


@pytest.mark.slow
@pytest.mark.parametrize("reception", ["hold", "zero"])
@pytest.mark.parametrize("loss", [0.0, 1.0])
def test_the_expectation_run_is_the_run_without_chance(loss, reception):
    """A channel that leaves nothing to chance: the mean of all runs is each of them."""
    packets = {"v2v__period": 0.1, "v2v__phase": "random", "v2v__latency": 0.035}
    one = scenario(run__duration=15.0, v2v__loss=loss, v2v__reception=reception, **packets)
    run, mean = simulate(one), simulate_mean(one)
    np.testing.assert_array_equal(run.received, mean.received)
    np.testing.assert_array_equal(run.position, mean.position)
    assert np.any(run.received != 0.0) == (loss == 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("reception", ["hold", "zero"])
def test_the_mean_of_lossy_runs_is_the_expectation_run(reception):
    """Within 4 standard errors of 400 runs, at every sample of three vehicles."""
    values = {"platoon__followers": 3, "run__duration": 16.0, "leader__start": 1.0}
    packets = {"v2v__period": 0.1, "v2v__latency": 0.03, "v2v__loss": 0.3}
    one = scenario(**values, **packets, v2v__reception=reception, leader__angular_frequency=0.8)
    ensemble, mean = monte_carlo(one, 400), simulate_mean(one)
    apart = np.abs(ensemble.mean - mean.spacing_error)
    error = ensemble.standard_error
    assert np.mean(apart <= 2.0 * error + 1e-12) > 0.9
    assert np.max(apart - 4.5 * error) < 1e-9
    assert np.max(error) > 1e-4


BURSTS = {"v2v__burst_begin": 0.3, "v2v__burst_end": 0.3, "v2v__burst_loss": 0.95}


@pytest.mark.slow
@pytest.mark.parametrize("reception", ["hold", "zero"])
def test_the_mean_of_runs_with_bursts_is_the_expectation_run(reception):
    values = {"platoon__followers": 3, "run__duration": 16.0, "leader__start": 1.0}
    packets = {"v2v__period": 0.1, "v2v__latency": 0.03, "v2v__blackouts": (6.0, 7.5), **BURSTS}
    one = scenario(**values, **packets, v2v__reception=reception, leader__angular_frequency=0.8)
    ensemble, mean = monte_carlo(one, 400), simulate_mean(one)
    apart, error = np.abs(ensemble.mean - mean.spacing_error), ensemble.standard_error
    assert np.mean(apart <= 2.0 * error + 1e-12) > 0.9
    assert np.max(apart - 4.5 * error) < 1e-9
    assert np.max(error) > 1e-4


@pytest.mark.parametrize("reception", ["hold", "zero"])
def test_in_a_blackout_the_last_packet_is_held_or_zero_used(reception):
    packets = {"v2v__period": 0.1, "v2v__blackouts": (12.0, 15.0), "v2v__reception": reception}
    one = scenario(run__duration=20.0, **packets)
    run, mean = simulate(one), simulate_mean(one)
    np.testing.assert_array_equal(run.received, mean.received)
    dark = (run.time >= 12.0) & (run.time < 15.0)
    used = np.unique(run.received[dark, 0])
    assert used.tolist() == ([run.received[1199, 0]] if reception == "hold" else [0.0])
    for link in link_reception(run):
        assert (link.loss, link.age_max) == (0.0, pytest.approx(3.09))
    assert any("blackouts" in reason for reason in judge(one).void)


@pytest.mark.parametrize(("reception", "covered"), [("zero", True), ("hold", False)])
def test_bursts_are_judged_by_their_share_where_losses_count_as_zero(reception, covered):
    one = scenario(**BURSTS, v2v__reception=reception, controller__time_headway=1.2)
    verdict = judge(one)
    assert ("bursts" in "".join(verdict.void)) != covered
    certificate = verdict.weakest.certificate
    assert certificate is not None
    assert (certificate.reception == pytest.approx(0.525)) == covered
    rare = judge(one.with_values({"v2v.period": 0.5, "controller.time_headway": 0.95}))
    assert ("if losses did not depend on each other" in "".join(rare.void)) != covered
    run = simulate(one.with_values({"run.duration": 60.0}))
    assert not any(link.loses_too_much for link in link_reception(run))


def growth_in_time(values, growth, *, lasting, hops, swings=6):
    """Growth per hop of the mean system far behind a leader that swings at a frequency for ever.

    The last `hops` of three times as many vehicles, over the last swings; w = 1, so that the run is
    its own expectation, at the lag and the effective gain of `growth`.
    """
    times = np.arange(0.0, lasting + 0.1, 0.05)
    speeds = 25.5 - 0.5 * np.cos(growth.omega * times)
    leader = {"leader.profile": "csv", "leader.times": tuple(times.round(9).tolist())}
    leader |= {"leader.speeds": tuple(speeds.tolist())}
    size = {"platoon.followers": 3 * hops, "run.duration": lasting, "v2v.noise": "none"}
    loop = {"vehicle.tau": growth.tau, "controller.k_a": growth.k_effective, "v2v.rho": 1e9}
    run = simulate(Scenario.from_values({**values, **leader, **size, **loop}))
    last = run.time > lasting - swings * 2.0 * np.pi / growth.omega
    time = run.time[last]
    angle = growth.omega * time
    parts = np.stack((np.cos(angle), np.sin(angle), np.ones_like(time), time), axis=1)
    fit = np.linalg.lstsq(parts, run.acceleration[last], rcond=None)[0]
    swing = np.hypot(*fit[:2])
    return (swing[-1] / swing[-1 - hops]) ** (1.0 / hops)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("design", "interval", "lasting"), [("A", 20, 250.0), ("C", 20, 250.0), ("D", 34, 100.0)]
)
def test_growth_per_hop_is_that_of_theory(design, interval, lasting):
    """At the worst lag and gain of a design, held packets: case A at 0.2 s grows by 1.003."""
    gains = Scenario.from_values(DESIGNS[design]).follower(1).gains
    found = worst_multirate_growth(gains, 5.0, 0.5, STEP, interval)
    assert found.growth > 1.001
    values = {**DESIGNS[design], "v2v.period": interval * STEP}
    grown = growth_in_time(values, found, lasting=lasting, hops=8)
    assert grown == pytest.approx(found.growth, abs=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("design", "lasting"), [("A", 250.0), ("C", 250.0), ("D", 100.0)])
def test_latency_is_borne_up_to_the_margin_and_not_above(design, lasting):
    """The last control period below the margin and the first above, where the latter grows most."""
    gains = Scenario.from_values(DESIGNS[design]).follower(1).gains
    below = int(certify(gains, 5.0, 0.5, period=STEP).joint_latency_margin / STEP)
    latencies = [round(steps * STEP, 3) for steps in (below, below + 1)]
    kept, lost = (
        worst_multirate_growth(gains, 5.0, 0.5, STEP, 1, latency=late) for late in latencies
    )
    assert kept.growth == 1.0 < lost.growth
    held, grown = (
        growth_in_time({**DESIGNS[design], "v2v.latency": late}, lost, lasting=lasting, hops=2)
        for late in latencies
    )
    assert held < 1.0 < grown
    assert grown == pytest.approx(lost.growth, abs=2e-6)
    for late, bears in zip(latencies, (True, False), strict=True):
        one = Scenario.from_values({**DESIGNS[design], "v2v.latency": late})
        assert judge(one).certified is bears


@pytest.mark.parametrize("design", DESIGNS)
def test_the_verdict_turns_at_the_critical_period(design):
    gains = Scenario.from_values(DESIGNS[design]).follower(1).gains
    critical = critical_v2v_period(gains, 5.0, 0.5, STEP)
    for period, bears in ((critical, True), (critical + STEP, False)):
        one = Scenario.from_values({**DESIGNS[design], "v2v.period": round(period, 3)})
        verdict = judge(one)
        assert verdict.certified is bears
        assert verdict.string_stable
        assert ("nothing grows in the long run" in verdict.guarantee) is bears
        assert any("accelerations grow in the mean" in reason for reason in verdict.void) != bears
        assert "growth per hop in the long run" in verdict.basis


@pytest.mark.parametrize(("late", "bears"), [(0.07, True), (0.3, False)])
def test_latency_alone_is_judged_too(late, bears):
    verdict = judge(Scenario.from_values({"v2v.latency": late}))
    assert verdict.certified is bears
    assert ("packets 0.07 s late" in verdict.guarantee) is bears
    assert verdict.weakest.loop == "with packets that are prompt"


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"v2v.phase": "random"}, "links send at different instants"),
        ({"vehicle_2": {"v2v.period": 0.05}}, "on unequal links"),
        ({"vehicle_2": {"v2v.phase": 0.03}}, "on unequal links"),
    ],
)
def test_what_no_theorem_covers_voids_the_certificate(values, words):
    own = {2: values.pop("vehicle_2")} if "vehicle_2" in values else None
    verdict = judge(Scenario.from_values({"v2v.period": 0.1, **values}, own))
    assert not verdict.certified
    assert any(words in reason for reason in verdict.void)


def test_what_was_sent_is_counted_by_packets():
    one = scenario(run__duration=20.0, v2v__period=0.1, v2v__latency=0.03, v2v__phase=0.05)
    for link in link_reception(simulate(one)):
        assert (link.sent, link.arrived, link.loss) == (200, 200, 0.0)
        assert link.age_max == pytest.approx(0.12)
    lost = scenario(run__duration=200.0, v2v__period=0.1, v2v__loss=0.25)
    links = link_reception(simulate(lost))
    share = sum(link.sent - link.arrived for link in links) / sum(link.sent for link in links)
    assert abs(share - 0.25) < 4.0 * np.sqrt(0.25 * 0.75 / (12 * 2001))


def test_phases_are_drawn_by_link_and_seed():
    def phases(**values):
        one = scenario(v2v__period=1.0, v2v__phase="random", platoon__followers=200, **values)
        return [follower.send_times.phase for follower in one.followers]

    assert phases() == phases()
    assert phases() != phases(run__seed=2)
    assert np.ptp(phases()) > 80
    assert abs(np.mean(phases()) - 49.5) < 4.0 * 100.0 / np.sqrt(12.0 * 200.0)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"v2v__period": 0.015}, r"v2v.period = 0.015 s must be a multiple of 0.01 s"),
        ({"v2v__period": -0.1}, r"v2v.period = -0.1 s must be >= 0 and <= 1000"),
        ({"v2v__period": "cam"}, r"v2v.period = 'cam' s must be a number"),
        ({"v2v__period": 0.1, "v2v__phase": 0.1}, r"v2v.phase = 0.1 s must be a multiple of"),
        ({"v2v__period": 0.1, "v2v__phase": 0.005}, r"v2v.phase = 0.005 s must be a multiple of"),
        ({"v2v__phase": 0.01}, r"v2v.phase = 0.01 s must be .* below the period, 0.01 s"),
        ({"v2v__phase": "late"}, r"v2v.phase = 'late' s must be >= 0 | aligned | random"),
        ({"v2v__phase": -0.01}, r"v2v.phase = -0.01 s must be >= 0"),
        (
            {"v2v__blackouts": (1.0,)},
            r"v2v.blackouts = \[1.0\] s must be pairs of",
        ),
        ({"v2v__blackouts": (2.0, 1.0)}, r"v2v.blackouts = \[2.0, 1.0\] s must be pairs"),
        ({"v2v__burst_begin": 1.5}, r"v2v.burst_begin = 1.5 must be >= 0 and <= 1"),
        ({"v2v__burst_end": 0.0}, r"v2v.burst_end = 0.0 must be > 0 and <= 1"),
        ({"v2v__burst_loss": -0.1}, r"v2v.burst_loss = -0.1 must be >= 0 and <= 1"),
        ({"v2v__latency": -1.0}, r"v2v.latency = -1.0 s must be >= 0"),
        ({"v2v__latency": float("inf")}, r"v2v.latency = inf s must be finite"),
    ],
)
def test_wrong_packets_are_refused_in_one_line(values, words):
    with pytest.raises(ScenarioError, match=words) as told:
        scenario(**values)
    assert "\n" not in str(told.value)


@pytest.mark.slow
@pytest.mark.parametrize("reception", ["hold", "zero"])
@pytest.mark.parametrize("rule", [{"v2v.period": 0.1}, {"v2v.send_rule": "cam"}, {}])
@pytest.mark.parametrize("late", [("2", "3"), ("11", "13")])
def test_a_packet_that_was_overtaken_is_of_no_use_in_the_mean(reception, rule, late):
    """Nothing is left to chance: the latency falls, or falls where newer ones are lost."""
    rises, falls = late
    changes = (f"{rises} link_1 v2v.latency=0.55", f"{falls} link_1 v2v.latency=0")
    for more in ((), (f"{falls} link_1 v2v.loss=1", "14 link_1 v2v.loss=0")):
        values = {"platoon.followers": 4, "v2v.reception": reception, "run.duration": 16.0, **rule}
        values |= {"v2v.noise": "none", "leader.start": 1.0, "run.timeline": (*changes, *more)}
        one = Scenario.from_values(values)
        run, mean = simulate(one), simulate_mean(one)
        np.testing.assert_allclose(run.position, mean.position, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"v2v.loss": 0.3, "v2v.period": 0.1, "v2v.bias": 0.1, "v2v.reception": "fallback"}, "who"),
        ({"v2v.jitter": 0.1}, "packets take the mean latency"),
        ({"v2v.saturation": 3.0}, "packets are neither rounded nor cut"),
        ({"v2v.send_rule": "cam"}, "packets are sent as the sender moves in the mean"),
        ({"v2v.loss": 0.1, **FALLING}, "packets that others overtake are of no use"),
        ({"v2v.loss": 0.1, **FALLING, "v2v.in_order": True}, ""),
        (FALLING, ""),
        ({"v2v.reception": "fallback", "v2v.blackouts": (2.0, 4.0)}, ""),
        ({"v2v.reception": "fallback", "v2v.monitor": "fallback"}, "no monitor distrusts packets"),
        ({"v2v.monitor": "report"}, ""),
        ({"vehicle.limits": "iso15622"}, "limits act on the mean motion"),
        ({"v2v.loss": 0.3, "v2v.reception": "zero", "v2v.latency": 0.1}, ""),
    ],
)
def test_what_is_nominal_in_the_mean_is_said(values, words):
    said = nominal(Scenario.from_values(values))
    assert [line[: len(words)] for line in said] == ([words] if words else [])
