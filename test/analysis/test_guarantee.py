"""What a verdict guarantees is said of the right signal, and holds in the platoon it is said of."""

import numpy as np
import pytest

from cacc_platoon.analysis import judge
from cacc_platoon.analysis.document import verdict_document
from cacc_platoon.model import Gains, State, ThirdOrderPlant
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import simulate, simulate_mean
from cacc_platoon.theory import (
    NoiseStatistics,
    certify,
    guarantees,
    sampled_sure_gain,
    slow_error_ratio,
)
from cacc_platoon.theory.guarantees import largest_peaks

SETTINGS = {"run.duration": 200.0, "platoon.followers": 4}
RARELY = {"v2v.bit_probabilities": [0.001] * 16}
OFTEN = {"v2v.bit_probabilities": [0.999] * 16}


def errors(run):
    return np.sqrt(np.sum(run.spacing_error**2, axis=0) * 0.01)


def test_links_with_unequal_means_multiply_spacing_errors_and_the_verdict_says_so():
    """Case A with E[w_1] next to m and the others next to M: max|delta| grows 19 times and more."""
    scenario = Scenario.from_values({**SETTINGS, **OFTEN}, {1: RARELY})
    verdict = judge(scenario)
    assert verdict.string_stable
    assert not verdict.equal_links
    said = verdict.guarantee
    assert "|a_i|_2 does not grow from follower to follower" in said
    assert "spacing errors may" in said
    mean = simulate_mean(scenario)
    peaks = np.max(np.abs(mean.spacing_error), axis=0)
    assert peaks[1] > 19 * peaks[0]
    energy = np.sqrt(np.sum(mean.acceleration**2, axis=0) * 0.01)
    assert (np.diff(energy) <= 1e-9).all()
    bound = float(said.rpartition("<= ")[2].split()[0])
    assert (errors(mean) <= bound * 1.001 * energy[0]).all()
    rows = {row.signal: row for row in verdict.guarantees}
    assert rows["energy of delta_i"].mean.startswith("may grow; at most ")
    assert abs(slow_error_ratio(scenario.followers[0].gains, 5.0)) > 100


def test_sampled_accelerations_may_grow_where_lags_differ_and_the_verdict_says_so():
    """Energies at lags of 0.01 and 0.4 s in turn, 0.4 s apart, at the frequency that grows most."""
    period, omega, lasting = 0.4, 0.8277, 400.0
    times = np.arange(0.0, lasting + 0.2, 0.1)
    gains = {"time_headway": 1.0, "k_a": 0.3, "k_v": 0.7, "k_p": 0.2}
    scenario = Scenario.from_values(
        {
            "platoon.followers": 6,
            "run.step": period,
            "run.duration": lasting,
            "vehicle.tau": (0.01, 0.4) * 3,
            "vehicle.tau_max": 0.4,
            "v2v.noise": "none",
            "v2v.rho": 10.0,
            "leader.profile": "csv",
            "leader.times": tuple(times.tolist()),
            "leader.speeds": tuple((26.0 - np.cos(omega * times)).tolist()),
            **{f"controller.{name}": value for name, value in gains.items()},
        }
    )
    verdict = judge(scenario)
    assert verdict.certified
    assert not verdict.equal_links
    assert "in continuous time; sampled, where lags differ, no frequency of" in verdict.guarantee
    late = simulate(scenario).acceleration[-round(200.0 / period) :]
    energy = np.sqrt(np.mean(late**2, axis=0))
    growth = energy[2:] / energy[1:-1]
    assert growth.max() > 1.005, growth
    same = Scenario.from_values({**scenario.values(), "vehicle.tau": 0.4})
    assert judge(same).equal_links
    assert "some hops" not in judge(same).guarantee


def test_peaks_of_unequal_vehicles_are_those_of_the_worst():
    calm = certify(Gains(1.25, 0.3, 0.57, 0.05), 5.0, 0.5)
    wild = certify(Gains(0.75, 0.5, 0.8, 0.5), 5.0, 0.5)
    said = {largest_peaks(pair) for pair in ((calm, wild), (wild, calm), (wild,))}
    assert len(said) == 1
    assert largest_peaks([calm]) not in said


@pytest.mark.parametrize(("variance", "grows"), [(0.9, False), (1.1, True)])
def test_energy_grows_from_an_index_of_one_on(variance, grows):
    """The index is linear in the variance: 1 is where it turns."""
    gains = Gains(0.95, 0.5, 0.63, 0.009)
    index = certify(gains, 5.0, 0.5, noise=NoiseStatistics(1.0, 1.0)).mean_square_index
    noise = NoiseStatistics(1.0, variance / index)
    said = guarantees(certify(gains, 5.0, 0.5, noise=noise))[0].mean_square
    assert ("grows along a platoon" in said) is grows


def test_frozen_noise_may_grow_from_a_negative_margin_on():
    gains = Gains(0.95, 0.5, 0.63, 0.009)
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        noise = NoiseStatistics(1.0, middle)
        kept = certify(gains, 5.0, 0.5, noise=noise).frozen_noise_margin >= 0.0
        low, high = (middle, high) if kept else (low, middle)
    for variance, grows in ((0.999 * low, False), (1.001 * high, True)):
        noise = NoiseStatistics(1.0, variance)
        said = guarantees(certify(gains, 5.0, 0.5, noise=noise))[-1].mean
        rows = guarantees(certify(gains, 5.0, 0.5, noise=noise))[-1]
        assert ("may grow" in f"{rows}") is grows, said


def test_equal_links_keep_spacing_errors_too():
    scenario = Scenario.from_values(SETTINGS)
    verdict = judge(scenario)
    said = (
        "|a_i|_2 and |delta_i|_2 do not grow from follower to follower, nor, in continuous time, "
    )
    assert verdict.guarantee.endswith(f"{said}|a_i|_2 from the leader to the first")
    assert (np.diff(errors(simulate_mean(scenario))) <= 1e-9).all()
    document = verdict_document(verdict)
    assert document["guarantee"] == verdict.guarantee
    assert document["guarantees"][0]["signal"] == "energy of a_i"


def test_held_noise_exceeds_the_mean_gain_and_never_the_sure_one():
    """Hops of accelerations of case A, w redrawn each second; those of delta reach 1.22."""
    scenario = Scenario.from_values({**SETTINGS, "v2v.hold": 1.0, "platoon.followers": 12})
    verdict = judge(scenario)
    assert verdict.sure_gain > sampled_sure_gain(scenario.followers[0].gains, 5.0, 0.5, 0.01) - 1e-9
    for seed in (1, 2, 3):
        run = simulate(scenario.with_values({"run.seed": seed}))
        peaks = np.max(np.abs(run.acceleration), axis=0)
        assert (peaks[1:] / peaks[:-1]).max() <= verdict.sure_gain


def test_noise_that_is_held_for_longer_adds_more_energy():
    said = []
    for hold in (0.0, 0.1, 1.0):
        verdict = judge(Scenario.from_values({**SETTINGS, "v2v.hold": hold}))
        said.append(verdict.guarantees[0].mean_square)
        assert said[-1].startswith("stays bounded: " if hold else "at most 1.0")
    values = [float(text.partition("c_T = ")[2].split()[0]) for text in said]
    assert values[0] <= values[1] < values[2]


def test_noise_beyond_the_channel_may_grow_in_the_mean_square_where_the_mean_is_stable():
    wild = NoiseStatistics(1.0, 400.0, 0.01)
    rows = guarantees(certify(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5, noise=wild))
    assert rows[0].mean == "does not grow: sup|H| = 1"
    assert rows[0].mean_square.startswith(
        "grows along a platoon of such followers at some lag: c_T = "
    )
    assert rows[-1].mean_square.startswith("E|a_i(jw)|^2 may grow: margin -")


@pytest.mark.parametrize("setting", [{"v2v.loss": 0.1, "v2v.reception": "zero"}, {"v2v.loss": 0.1}])
def test_what_is_not_known_under_loss_is_not_said(setting):
    verdict = judge(Scenario.from_values({**SETTINGS, **setting}))
    assert verdict.guarantees[0].mean_square.startswith("not known")
    calm = judge(Scenario.from_values({**SETTINGS, "v2v.noise": "none"}))
    assert calm.guarantees[0].mean_square == "no noise is given"


def test_nothing_is_guaranteed_of_a_platoon_that_is_not_string_stable():
    verdict = judge(Scenario.from_values({**SETTINGS, "controller.time_headway": 0.65}))
    assert verdict.guarantee == "nothing is guaranteed"
    assert verdict.guarantees[0].mean.startswith("may grow: sup|H| = 1.0")


def test_what_a_scan_found_is_not_said_of_lags_that_it_did_not_try():
    calm = certify(Gains(1.3, 0.1, 1.0, 0.05), 5.0, 0.1)
    assert calm.linf_gain == pytest.approx(1.0, abs=1e-9)
    assert guarantees(calm)[1].mean.startswith("do not grow (no lag above 1.0")
    ringing = guarantees(certify(Gains(0.95, 0.5, 0.63, 300.0), 5.0, 0.5))
    for text in (ringing[1].mean, ringing[1].sure, ringing[3].sure):
        assert "inf" not in text
        assert text.endswith("the loop rings too long for a bound")


def test_the_bound_of_unequal_errors_is_that_of_the_worst_vehicle_everywhere():
    """Vehicle 3 has the larger gain from a to delta, vehicle 1 the least margin."""
    unequal = {"vehicle_3.controller.k_v": 0.632}
    verdict = judge(Scenario.from_values({"platoon.followers": 3}).with_values(unequal))
    gains = [one.certificate.leader_error_gain for one in verdict.followers if one.certificate]
    assert verdict.weakest.follower == 1
    assert gains[2] > 1.005 * gains[0]
    largest = f"{max(gains):.4g} s^2 |a_0|_2"
    assert verdict.guarantee.endswith(f"|delta_i|_2 <= {largest}")
    assert verdict.guarantees[2].mean == f"may grow; at most {largest}"


def test_the_bound_of_unequal_errors_is_of_the_loop_without_losses():
    held = {"platoon.followers": 3, "v2v.loss": 0.1, "vehicle_3.v2v.loss": 0.2}
    verdict = judge(Scenario.from_values({"platoon.followers": 3}).with_values(held))
    assert verdict.string_stable
    assert verdict.guarantee.endswith("|a_0|_2, of the loop without losses")
    assert verdict.guarantees[2].mean.endswith("|a_0|_2, of the loop without losses")


def test_of_one_follower_only_the_hop_from_its_leader_is_spoken():
    """Energies of its acceleration and its error in the mean system, against what is said."""
    scenario = Scenario.from_values({**SETTINGS, "platoon.followers": 1})
    verdict = judge(scenario)
    said = [verdict.guarantee, *map(str, verdict.guarantees), verdict.basis]
    assert not [text for text in said if "to vehicle" in text or "second vehicle" in text], said
    assert "delta_{i-1}" not in verdict.basis
    mean = simulate_mean(scenario)
    own, leader = np.sqrt(np.sum(mean.acceleration**2, axis=0) * 0.01)[::-1]
    assert own <= leader
    bound = float(verdict.guarantee.partition("|delta|_2 at most ")[2].split()[0])
    assert errors(mean)[0] <= bound * leader
    assert f"at most {bound:.4g} s^2 |a_0|_2" in verdict.guarantees[2].mean


def test_of_one_follower_with_rare_packets_one_hop_is_not_spoken_of():
    rare = {**SETTINGS, "platoon.followers": 1, "v2v.period": 0.1}
    assert judge(Scenario.from_values(rare)).guarantee.endswith("says nothing of one hop")
    growing = judge(Scenario.from_values({**rare, "v2v.period": 0.2}))
    assert "per hop of a platoon of such followers at" in growing.void[0]


def test_packets_so_late_that_errors_grow_leave_no_row_that_denies_it():
    """At 0.3 s case A grows by 1.042 per hop; the energies of its mean system do."""
    scenario = Scenario.from_values(
        {
            "platoon.followers": 12,
            "run.duration": 200.0,
            "v2v.latency": 0.3,
            "v2v.noise": "none",
            "v2v.rho": 1e6,
            "controller.k_a": 0.6,
            "leader.angular_frequency": 0.61,
        }
    )
    verdict = judge(scenario)
    rows = {row.signal: row.mean for row in verdict.guarantees}
    energies = errors(simulate_mean(scenario))
    assert (np.diff(energies) > 0).any()
    assert rows["energy of a_i"].startswith("grows by 1.0")
    assert "a packet every 0.01 s, 0.3 s late" in rows["energy of a_i"]
    assert rows["energy of delta_i"] == "may grow"


def test_the_bound_of_unequal_errors_says_that_it_is_of_prompt_packets():
    late = {"platoon.followers": 3, "v2v.latency": 0.03}
    unequal = {"vehicle_3.controller.k_v": 0.632}
    verdict = judge(Scenario.from_values(late).with_values(unequal))
    assert verdict.string_stable
    assert not verdict.equal_links
    assert verdict.guarantee.endswith("|a_0|_2, of the loop without latency")
    lags = {"vehicle.tau": (0.1, 0.5, 0.2), "vehicle.tau_max": 0.5}
    said = judge(Scenario.from_values({**late, **lags})).guarantee
    assert "in continuous time, of the loop without latency; sampled, where lags differ" in said


def test_energies_of_errors_say_that_they_are_of_prompt_packets_where_growth_is_not_known():
    """Of a design with a latency alone; in a verdict the growth with it is known."""
    gains = Gains(0.95, 0.5, 0.63, 0.009)
    rows = guarantees(certify(gains, 5.0, 0.5, latency=0.3))
    assert rows[2].mean.endswith(", of the loop without latency")
    known = guarantees(certify(gains, 5.0, 0.5, latency=0.03, v2v_period=0.01))
    assert known[2].mean == "does not grow from the second vehicle on"


def test_nothing_is_guaranteed_of_a_loop_that_is_sampled_too_slowly():
    """Case A every 0.2 s has sup|H_T| = 1.014: only its loop in continuous time keeps energies."""
    slow = {"platoon.followers": 3, "run.step": 0.2}
    verdict = judge(Scenario.from_values(slow))
    assert verdict.string_stable
    assert verdict.guarantee == ("nothing is guaranteed: sampled as slowly as this errors may grow")
    rows = {row.signal: row.mean for row in verdict.guarantees}
    assert rows["energy of a_i"].startswith("may grow: not string stable sampled every 0.2 s; in ")
    assert rows["energy of delta_i"].startswith("may grow; only in continuous time")
    assert rows["peaks of delta_i"].startswith("in continuous time at most")
    alone = judge(Scenario.from_values({**slow, "platoon.followers": 1}))
    assert alone.guarantee == verdict.guarantee
    row = {one.signal: one.mean for one in alone.guarantees}["energy of delta_i"]
    assert row.startswith("may grow; only")
    unequal = judge(Scenario.from_values(slow).with_values({"vehicle_3.controller.k_v": 0.632}))
    assert unequal.string_stable
    row = {one.signal: one.mean for one in unequal.guarantees}["energy of delta_i"]
    assert row.startswith("may grow; in continuous time at most 2")


def test_peaks_where_lags_differ_are_said_of_hops_of_equal_lags():
    lags = {"platoon.followers": 2, "vehicle.tau": (0.1, 0.5), "vehicle.tau_max": 0.5}
    assert judge(Scenario.from_values(lags)).hop == "between followers of equal lags"
    assert judge(Scenario.from_values(SETTINGS)).hop == "between followers"


def test_a_leader_that_turns_between_samples_raises_the_first_peak_and_no_other_hop():
    """Its samples, a hundredth of each interval, ask for the most by k a_0, the rest by v and x."""
    T, count, tau = 0.1, 400, 0.5
    h, k, k_v, k_p = gains = Gains(1.3, 0.5, 0.8, 0.5)
    plant = ThirdOrderPlant(tau, T)

    def answer(added):
        """Return the acceleration of a vehicle to whose command this is added."""
        state, found = State(0.0, 0.0, 0.0), []
        for u in added:
            found.append(state.acceleration)
            x, v, _ = state
            state = plant.advance(state, u - (k_v + h * k_p) * v - k_p * x)
        return np.sign(found[::-1])

    later = np.arange(1, count)
    fresh = answer([k, *np.zeros(count - 1)])
    rest = answer([0.0, *(k_v * T + k_p * T * T * (later - 0.5))])
    starts = T * np.arange(count + 1)
    pairs = np.column_stack((starts[:-1] + 0.01 * T, starts[1:]))
    times = np.concatenate(([0.0], pairs.ravel()))
    steps = np.column_stack((0.01 * T * fresh, 0.99 * T * rest)).ravel()
    scenario = Scenario.from_values(
        {
            **{f"controller.{name}": value for name, value in gains._asdict().items()},
            "platoon.followers": 3,
            "v2v.noise": "none",
            "vehicle.tau": tau,
            "run.step": T,
            "run.duration": count * T,
            "leader.profile": "csv",
            "leader.times": tuple(times.tolist()),
            "leader.speeds": tuple((25.0 + np.concatenate(([0.0], np.cumsum(steps)))).tolist()),
        }
    )
    verdict = judge(scenario)
    run = simulate(scenario)
    peaks = np.max(np.abs(run.acceleration), axis=0)
    assert verdict.certified
    assert peaks[1] > 1.6 * verdict.sure_gain * peaks[0]
    assert (peaks[2:] <= verdict.sure_gain * peaks[1:-1]).all()
    assert "from follower to follower" in verdict.guarantee
    assert "not from the leader" in verdict.bases.sure
