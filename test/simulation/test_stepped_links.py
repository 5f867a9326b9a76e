"""Runs whose packets follow motion, and runs that fall back: nodes, arrays, collisions."""

from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cacc_platoon.analysis import compute_metrics
from cacc_platoon.analysis.consistency import check_consistency, check_links
from cacc_platoon.runs.events import events_of
from cacc_platoon.scenario import Scenario, ScenarioError
from cacc_platoon.scenario.run_event import MOST_TURNS, EventKind, RunEvent
from cacc_platoon.scenario.timeline import Change
from cacc_platoon.simulation import monte_carlo, simulate, simulate_mean
from cacc_platoon.simulation.monitoring import alarms
from cacc_platoon.simulation.platoon import commands_of, links_of_runs, propagate
from cacc_platoon.stepping.lockstep import LockstepFollower, LockstepLeader, LockstepRelay

SHORT = {"run.duration": 45.0, "platoon.followers": 3}
CAM = {"v2v.send_rule": "cam", "v2v.phase": "random"}
SILENT = {"v2v.reception": "fallback", "v2v.blackouts": (12.0, 22.0)}
BRAKE = {
    "leader.profile": "brake",
    "leader.deceleration": 6.0,
    "v2v.blackouts": (10.0, 20.0),
    "vehicle.length": 4.5,
    "platoon.standstill_distance": 7.0,
}
GILBERT = {
    "v2v.burst_begin": 0.3,
    "v2v.burst_end": 0.3,
    "v2v.burst_loss": 0.95,
    "v2v.latency": 0.1,
    "v2v.jitter": 0.05,
}
WATCHED = {
    **BRAKE,
    **{"v2v.reception": "fallback", "v2v.monitor": "fallback", "v2v.blackouts": ()},
    "v2v.false_data": ("11 14 factor=-1", "25 27 factor=3"),
}
RUNS: dict[str, dict[str, Any]] = {
    "cam": CAM,
    "lossy cam": {**CAM, "v2v.loss": 0.2, "v2v.latency": 0.02, "v2v.jitter": 0.05},
    "silence": {**SILENT, "v2v.loss": 0.2},
    "brake": {**SILENT, **BRAKE},
    "all": {**SILENT, **CAM, **GILBERT, "v2v.quantum": 0.1, "v2v.bias": 0.02},
    "sensors": {"sensing.delay": 0.05, "sensing.range_std": 0.1, "sensing.range_rate_std": 0.05},
    "limits": {**BRAKE, "v2v.blackouts": (), "vehicle.limits": "constant", "vehicle.stops": True},
    "iso": {
        **SILENT,
        **BRAKE,
        "leader.deceleration": 5.0,
        "vehicle.limits": "iso15622",
        "sensing.delay": 0.1,
    },
    "false": {**CAM, **SILENT, "v2v.false_data": ("14 20 replay=3", "25 30 frozen")},
    "watched": WATCHED,
    "watched, lossy": {
        **{**WATCHED, **CAM, **GILBERT, "v2v.noise_std": 0.02, "v2v.saturation": 2.0},
        **{"sensing.delay": 0.03, "sensing.range_rate_std": 0.1, "v2v.monitor_margin": 1.0},
        "v2v.false_data": ("11 16 factor=-1",),
    },
}


def scenario(*parts: dict[str, Any], own: Any = None) -> Scenario:
    return Scenario.from_values({k: v for part in (SHORT, *parts) for k, v in part.items()}, own)


def of_nodes(one, adjust=lambda *_: None, published=None, reception=None, told=None):
    """Return the motion of scalar steppers that pass messages on as nodes do, (3, samples, N+1).

    What monitors publish is put into `published`, by index of the follower; what followers tell of
    themselves, into `told`.
    """
    told = [] if told is None else told
    posted: deque = deque()
    motion: list[list[tuple[float, ...]]] = [[] for _ in one.vehicles]

    def post(kind, index):
        return lambda stamp, *values: posted.append((kind, index, stamp, *values))

    def tell(index):
        said = ({} if published is None else published).setdefault(index, [])
        return lambda stamp, alarm, _excess: said.append((stamp, alarm))

    followers = {
        f.index: LockstepFollower(
            f.receiving(reception),
            one,
            post("state", f.index),
            publish_monitor=tell(f.index),
            tell=told.append,
        )
        for f in one.followers
    }
    relays = {
        f.index: LockstepRelay(
            f, one, post("accel", f.index), post("count", f.index) if f.counted else None
        )
        for f in one.followers
    }
    leader = LockstepLeader(one, post("state", 0))
    for k in range(one.samples):
        adjust(k, followers, relays)
        leader.take_horizon(k)
        while posted:
            kind, index, stamp, *values = posted.popleft()
            value = values[0]
            if kind == "accel":
                followers[index].take_acceleration(stamp, value)
            elif kind == "count":
                followers[index].take_count(stamp, float(values[0]), float(values[1]))
            else:
                motion[index].append(tuple(value))
                if (behind := index + 1) in followers:
                    followers[behind].take_position(stamp, value.position)
                    followers[behind].take_velocity(stamp, value.velocity)
                    relays[behind].take(stamp, value.acceleration)
                    if one.follower(behind).triggered:
                        relays[behind].take_velocity(stamp, value.velocity)
                        relays[behind].take_position(stamp, value.position)
    samples = min(map(len, motion))  # fewer where some have run into each other
    return np.array([one[:samples] for one in motion]).transpose(2, 1, 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_nodes_and_arrays_agree_to_the_last_bit(name):
    """In their motion, in what they tell, and in what monitors publish where there are any."""
    published: dict[int, list[tuple[int, bool]]] = {}
    told: list[RunEvent] = []
    one = scenario(RUNS[name])
    run = simulate(one)
    found = of_nodes(one, told=told, published=published)
    np.testing.assert_array_equal(found, np.stack(run.motion))
    assert turns_of(told, run) == shown_turns(run)
    assert (run.share is None) == (RUNS[name].get("v2v.reception") != "fallback")
    found = alarms(run)
    assert [*found] == [index for index, said in published.items() if said]
    assert set(found) == ({1, 2, 3} if "watched" in name else set())
    for index, alarm in found.items():
        stamps, said = zip(*published[index], strict=True)
        assert stamps == tuple(k * one.step_ns for k in range(one.samples))
        assert list(said) == alarm.tolist()
        assert 0.0 < alarm.mean() < 0.5


FLICKER = {"v2v.reception": "fallback", "v2v.loss": 0.5, "v2v.fallback_after": 0.02}
TURNING = {
    "flicker": {**FLICKER, "v2v.fallback_blend": 0.02, "v2v.fallback_return": 0.01},
    "trembling limits": {"vehicle.limits": "constant", "vehicle.max_jerk": 0.5, **FLICKER},
    "from the first sample on": {**SILENT, "v2v.blackouts": (0.0, 9.0), "v2v.fallback_after": 0.01},
}


TURNS = (EventKind.RECEPTION, EventKind.LIMIT)


def shown_turns(run):
    return [event for event in events_of(run) if event.kind in TURNS]


def turns_of(told, run):
    """Return the turns that nodes have told of, up to the last one that a run shows."""
    last = max((event.sample for event in shown_turns(run)), default=0)
    turns = [event for event in told if event.kind in TURNS and event.sample <= last]
    return sorted(turns, key=lambda event: event.order)


@pytest.mark.slow
@pytest.mark.parametrize("name", TURNING)
def test_what_followers_tell_is_what_a_run_shows(name):
    one = scenario(TURNING[name])
    told: list[RunEvent] = []
    of_nodes(one, told=told)
    run = simulate(one)
    assert turns_of(told, run) == shown_turns(run) != []


def test_of_what_chatters_the_first_turns_are_told():
    told: list[RunEvent] = []
    of_nodes(scenario(TURNING["flicker"]), told=told)
    texts = [event.text for event in told if event.node == "vehicle_2/vehicle"]
    assert len(texts) == MOST_TURNS
    assert set(texts) == {"normal", "degrading", "fallback", "recovering"}


@pytest.mark.slow
def test_a_monitor_that_reports_changes_nothing_and_one_that_acts_prevents_a_collision():
    modes = "none", "report", "fallback"
    quiet, reports, acts = (simulate(scenario(WATCHED, {"v2v.monitor": mode})) for mode in modes)
    np.testing.assert_array_equal(np.stack(quiet.motion), np.stack(reports.motion))
    assert alarms(quiet) == {}
    assert set(alarms(reports)) == {1, 2, 3}
    assert quiet.gap.min() < 0.0 < acts.gap.min()


def test_only_the_link_from_the_vehicle_ahead_is_watched(monkeypatch):
    """Nothing on board measures those further ahead; a false one of them causes no alarm."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "system"))
    one = scenario(WATCHED, {"platoon.predecessors": 2, "controller.law": "own_parts:Cautious"})
    assert [receiver.monitored for receiver in one.receivers] == [True, True, False, True, False]
    assert all(receiver.counted for receiver in one.receivers)


@pytest.mark.slow
@pytest.mark.parametrize("channel", [{}, CAM, {"v2v.loss": 0.3}])
def test_a_reception_of_ones_own_is_asked_whether_packets_are_prompt_or_not(channel, monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "system"))
    one = scenario(channel, {"v2v.receiver": "own_parts:Halving", "run.duration": 20.0})
    run = simulate(one)
    np.testing.assert_array_equal(of_nodes(one), np.stack(run.motion))
    usual = simulate(scenario(channel, {"run.duration": 20.0}))
    assert np.abs(run.acceleration[:, 1]).max() < np.abs(usual.acceleration[:, 1]).max()


@pytest.mark.slow
def test_a_platoon_may_mix_links():
    own = {2: {"v2v.send_rule": "periodic", "v2v.reception": "hold"}}
    one = scenario(RUNS["all"], own=own)
    run = simulate(one)
    np.testing.assert_array_equal(of_nodes(one), np.stack(run.motion))
    assert run.share is not None
    assert (run.share[:, 1] == 1.0).all()
    assert run.share[:, 0].min() == 0.0


def test_followed_links_are_planned_ones_where_both_can_be():
    """A reception that falls back after longer than any silence is one that holds."""
    late = {"v2v.loss": 0.4, "v2v.latency": 0.03, "v2v.period": 0.05}
    planned = simulate(scenario(late))
    followed = simulate(scenario(late, {"v2v.reception": "fallback", "v2v.fallback_after": 1e3}))
    for first, second in zip(planned.motion, followed.motion, strict=True):
        np.testing.assert_array_equal(first, second)
    assert planned.arrivals is not None
    assert followed.arrivals is not None
    for one, other in zip(planned.arrivals, followed.arrivals, strict=True):
        for before, after in zip(one, other, strict=True):
            np.testing.assert_array_equal(before, after)


def test_runs_together_are_runs_alone():
    one = scenario(RUNS["lossy cam"], {"run.duration": 15.0})
    peaks = monte_carlo(one, runs=3).max_abs_spacing_error
    for seed, found in enumerate(peaks, start=1):
        alone = simulate(one.with_values({"run.seed": seed}))
        np.testing.assert_array_equal(compute_metrics(alone).max_abs_spacing_error, found)


@pytest.mark.slow
@pytest.mark.parametrize("begin", [9.0, 10.5])
@pytest.mark.parametrize("reception", ["hold", "zero", "fallback"])
def test_ten_seconds_without_v2v_in_a_full_brake(reception, begin):
    """The leader brakes from 10 s on with 6 m/s^2, on all links and in the mean."""
    dark = {"v2v.reception": reception, "v2v.blackouts": (begin, begin + 10.0)}
    one = scenario(BRAKE, dark, {"run.duration": 30.0})
    gaps = [float(np.min(run(one).gap)) for run in (simulate, simulate_mean)]
    assert all(gap > 0.0 for gap in gaps) == (reception == "fallback")


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["sine", "brake"])
def test_bursts_latency_and_ten_dark_seconds_on_one_link(motion):
    """More seeds, and hold and zero beside it: examples/standard_messages/one_link.py."""
    dark = {"v2v.blackouts": (10.0, 20.0)}
    values: dict[str, Any] = {**GILBERT, "vehicle.length": 4.5, "platoon.followers": 6}
    if motion == "brake":
        values |= {key: value for key, value in BRAKE.items() if key.startswith("leader")}
    values |= {"platoon.standstill_distance": 7.0, "v2v.reception": "fallback"}
    run = simulate(scenario(values, own={3: dark}))
    assert run.gap.min() > 0.5
    assert run.share is not None
    assert run.share[:, 2].min() == 0.0
    assert abs(run.velocity[-1] - run.velocity[-1, 0]).max() < 0.5


def silent_runs(count):
    """Return runs of one follower behind a braking leader, of random silences and fallbacks."""
    rng = np.random.default_rng(3)
    for _ in range(count):
        ends = rng.choice(np.arange(100, 1200), 2 * int(rng.integers(1, 4)), replace=False)
        after, blend, back = (rng.integers(1, 100, 3) / 100.0).tolist()
        values: dict[str, Any] = {
            "v2v.reception": "fallback",
            "v2v.blackouts": (np.sort(ends) / 100.0).tolist(),
            "v2v.fallback_after": after,
            "v2v.fallback_blend": blend,
            "v2v.fallback_return": back,
        }
        yield scenario(BRAKE, {"platoon.followers": 1, "run.duration": 14.0}, values)


@pytest.mark.slow
def test_no_blend_changes_the_command_by_more_than_its_bound():
    """The jump of u beyond what it would be with the share of the sample before, of 200 runs."""
    runs = list(silent_runs(200))
    links = links_of_runs(runs)
    seen: list[Any] = []

    class Watched:
        def received(self, sample, motion):
            used = links.received(sample, motion)
            seen.append((used, links.share))
            return used

        share = property(lambda _: links.share)
        arrivals = links.arrivals

    motion = propagate(runs[0], Watched(), runs=len(runs))[:, :-1]
    received, share = (np.array(part)[..., 0] for part in zip(*seen, strict=True))
    follower = runs[0].follower(1)
    law, alone = follower.law(), follower.fallback_law()
    assert alone is not None
    measured = (*(part[..., 1] for part in motion[:2]), *(part[..., 0] for part in motion[:2]))
    u, without = law.command(*measured, received), alone.command(*measured, np.zeros(()))
    blended = share * u + (1.0 - share) * without
    frozen = share[:-1] * u[1:] + (1.0 - share[:-1]) * without[1:]
    jump = np.abs(blended[1:] - frozen)
    steps = np.array([round(run.follower(1).v2v.fallback_blend * 100.0) for run in runs])
    assert (jump <= np.abs(u - without)[1:] / steps + 1e-12).all()
    assert (jump.max(axis=0) > 0.0).mean() > 0.9
    assert (share.min(axis=0) == 0.0).mean() > 0.7
    assert (np.diff(share, axis=0) > 0.0).any(axis=0).mean() > 0.7


TIMELINE = (
    "8 link_2 v2v.loss=1",
    "12 link_2 v2v.loss=0.3",
    "14 vehicle_2 controller.time_headway=1.3",
    "20 link_1 v2v.latency=0.07",
    "24 link_1 v2v.latency=0",
    "25 link_3 v2v.noise_std=0.2",
    "26 vehicle_1 controller.time_headway=1.1",
    "30 vehicle_2 controller.time_headway=0.95",
    "31 link_3 v2v.bias=0.1",
)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ideal", "lossy cam", "silence", "sensors"])
def test_a_timeline_is_the_same_on_nodes_and_in_arrays(name):
    one = scenario(RUNS.get(name, {}), {"run.timeline": TIMELINE})
    run = simulate(one)
    np.testing.assert_array_equal(of_nodes(one), np.stack(run.motion))
    assert check_consistency(run).largest == 0.0
    assert check_links(run).largest == 0.0
    quiet = simulate(scenario(RUNS.get(name, {})))
    first = 2501 if name == "none" else 801
    np.testing.assert_array_equal(run.acceleration[:first], quiet.acceleration[:first])
    assert (run.acceleration[3000] != quiet.acceleration[3000])[1:].all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ideal", "lossy cam"])
def test_a_change_that_was_not_planned_is_the_planned_one_of_its_sample(name):
    """A run that is adjusted, and its record replayed: the same bits."""
    one = scenario(RUNS.get(name, {}), {"run.adjustable": True})
    asked = {
        703: (2, "v2v.loss", 1.0),
        1250: (2, "v2v.loss", 0.1),
        1302: (1, "controller.time_headway", 1.25),
        2900: (1, "controller.time_headway", 0.95),
    }
    done = []

    def adjust(sample, followers, relays):
        if sample in asked:
            vehicle, name, value = asked[sample]
            stepper = (relays if name == "v2v.loss" else followers)[vehicle]
            done.append(Change(stepper.next_sample, vehicle, name, value))
            stepper.change(done[-1])

    found = of_nodes(one, adjust)
    assert [change.sample - sample for change, sample in zip(done, asked, strict=True)] == [
        1,
        1,
        0,
        0,
    ]
    planned = one.with_changes(done)
    np.testing.assert_array_equal(found, of_nodes(planned))
    np.testing.assert_array_equal(found, np.stack(simulate(planned).motion))
    assert not np.array_equal(found, np.stack(simulate(one).motion))


@pytest.mark.slow
def test_a_headway_changes_without_a_jump_of_the_command():
    one = scenario({"leader.profile": "constant", "v2v.noise": "none", "run.duration": 300.0})
    run = simulate(one.with_values({"run.timeline": ["10 vehicle_1 controller.time_headway=1.4"]}))
    steps = np.abs(np.diff(commands_of(run).wanted[:, 0]))
    rate = one.controller.headway_rate * one.run.step
    assert steps[:999].max() < 1e-12
    assert steps.max() < 1.05 * one.follower(1).gains.k_p * 25.0 * rate
    assert run.gap[-1, 0] == pytest.approx(5.0 + 1.4 * 25.0, abs=0.3)


@pytest.mark.slow
def test_the_mean_of_runs_with_a_timeline_is_the_expectation_run():
    one = scenario({"run.timeline": TIMELINE, "run.duration": 40.0, "run.step": 0.02})
    mean, ensemble = simulate_mean(one), monte_carlo(one, 150)
    known = ensemble.standard_error > 1e-9
    away = np.abs(ensemble.mean - mean.spacing_error)[known] / ensemble.standard_error[known]
    assert away.max() < 4.5
    unchanged = simulate_mean(one.with_values({"run.timeline": TIMELINE[2:]})).spacing_error
    wrong = np.abs(ensemble.mean - unchanged)[known] / ensemble.standard_error[known]
    assert wrong.max() > 12.0


def test_a_run_ends_at_the_first_collision():
    crash = {**BRAKE, "leader.deceleration": 9.0, "v2v.noise": "none"}
    whole = simulate(scenario(crash, {"run.stop_on_collision": False}))
    run = simulate(scenario(crash))
    last = len(run.position) - 1
    assert len(whole.position) == 4501
    assert run.ends_in_collision
    assert not whole.ends_in_collision
    assert (run.gap[-1] <= 0.0).any()
    assert (run.gap[:-1] > 0.0).all()
    for first, second in zip(run.motion, whole.motion, strict=True):
        np.testing.assert_array_equal(first, second[: last + 1])
    np.testing.assert_array_equal(run.received, whole.received[: last + 1])
    np.testing.assert_array_equal(of_nodes(scenario(crash)), np.stack(run.motion))
    (hit,) = (event for event in events_of(run) if event.kind is EventKind.COLLISION)
    assert hit.sample == last
    assert compute_metrics(run).first_collision == (int(hit.node[8]), last * 0.01)


class Half:
    """Uses half of the newest packet."""

    def __init__(self, follower):
        self.follower, self._value = follower, 0.0

    def use(self, delivered):
        for _, value in delivered:
            self._value = 0.5 * value
        return self._value


@pytest.mark.slow
@pytest.mark.parametrize("channel", [{"v2v.loss": 0.3}, CAM, {"run.adjustable": True}])
def test_a_reception_is_given_as_an_object(channel, monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    one = scenario(channel, {"run.duration": 20.0})
    given = simulate(one, reception=Half)
    named = simulate(one.with_values({"v2v.receiver": "test_stepped_links:Half"}))
    np.testing.assert_array_equal(np.stack(given.motion), np.stack(named.motion))
    np.testing.assert_array_equal(of_nodes(one, reception=Half), np.stack(given.motion))


def test_nobody_would_ask_a_reception_where_packets_are_not_counted():
    with pytest.raises(ScenarioError, match=r"vehicle 1: a reception .* run\.adjustable"):
        simulate(scenario({"run.duration": 1.0}), reception=Half)
