"""What is made of what is heard of a platoon, whoever has said it."""

import json
import math
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cacc_platoon.live.watch import EVENTS_KEPT, Watch
from cacc_platoon.runs.events import event_line
from cacc_platoon.runs.sample_reader import Reading
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.scenario.timeline import Change
from cacc_platoon.simulation import simulate
from cacc_platoon.supervision.protocol import RunPhase, RunStatus
from cacc_platoon.supervision.view_message import Heard, HostView
from msg_adapters.text import encode_string
from msg_adapters.topics import Graph

VALUES = {
    "platoon.followers": 3,
    "run.duration": 4.0,
    "leader.start": 0.5,
    "leader.amplitude": 2.0,
    "vehicle.length": 4.5,
    "run.timeline": ("1 vehicle_2 controller.time_headway=1.0",),
}
SCENARIO = Scenario.from_values(VALUES)
RUN = simulate(SCENARIO)
LAST = SCENARIO.samples - 1


def readings(sample: int, vehicles=range(4), run=RUN) -> dict[str, Reading]:
    """Return what hosts say of some vehicles at a sample of a run."""
    found = {}
    for index in vehicles:
        topics = Graph.of(SCENARIO).vehicles[index]
        for topic, values in zip(topics.motion, run.motion, strict=True):
            found[topic.name] = Reading(sample, float(values[sample, index]))
        if index:
            received = float(run.received[sample, index - 1])
            found[topics.received.name] = Reading(sample, received)
    return found


def view(sample: int, vehicles=range(4), host="0", run="f00d") -> bytes:
    text = HostView(run, host, sample, readings(sample, vehicles)).to_json()
    return encode_string(text)


def status(sample: int, phase=RunPhase.RUNNING, run="f00d", **more) -> bytes:
    text = RunStatus(run, phase, sample, SCENARIO.samples, **more).to_json()
    return encode_string(text)


def hearing(*heard: Heard, scenario: Scenario | None = SCENARIO, every: float = 0.2) -> Watch:
    watch = Watch("/platoon", scenario)
    for number, one in enumerate(heard):
        watch.hear(one, number * every)
    return watch


@pytest.mark.parametrize("sample", [0, 90, 130, LAST])
def test_gaps_and_spacing_errors_are_those_of_the_run(sample):
    """While the headway of vehicle 2 moves, too."""
    found = hearing(Heard(views=(view(sample),))).picture(0.0)
    leader, *followers = found.vehicles
    assert (leader.gap, leader.spacing_error, leader.received) == (None, None, None)
    assert [one.gap for one in followers] == pytest.approx(RUN.gap[sample].tolist())
    errors = RUN.spacing_error[sample].tolist()
    assert [one.spacing_error for one in followers] == pytest.approx(errors, abs=1e-12)
    assert [one.velocity for one in found.vehicles] == RUN.velocity[sample].tolist()
    assert [one.received for one in followers] == RUN.received[sample].tolist()
    assert {one.packet_age for one in followers} == {0.0}


def test_the_scenario_is_heard_where_it_is_not_known():
    scenario = encode_string(format_scenario(SCENARIO))
    watch = hearing(Heard(scenario=scenario, views=(view(90),)), scenario=None)
    assert watch.picture(0.0).vehicles[2].gap == pytest.approx(RUN.gap[90, 1])
    assert watch.scenario is not None
    assert watch.scenario.samples == SCENARIO.samples


def test_a_scenario_that_is_known_is_not_taken_from_others():
    other = encode_string(format_scenario(SCENARIO.with_values({"platoon.followers": 5})))
    assert len(hearing(Heard(scenario=other)).picture(0.0).vehicles) == 4


def test_vehicles_of_different_hosts_are_compared_at_one_sample_alone():
    """Host 1 is late with its answer: until it comes, the sample before is shown whole."""
    both = Heard(views=(view(100, (0, 1)), view(100, (2, 3), "1")))
    watch = hearing(both, Heard(views=(view(200, (0, 1)),)))
    assert {one.sample for one in watch.picture(0.3).vehicles} == {100}
    watch.hear(Heard(views=(view(200, (2, 3), "1"),)), 0.4)
    found = watch.picture(0.4)
    assert {one.sample for one in found.vehicles} == {200}
    assert [one.gap for one in found.vehicles[1:]] == pytest.approx(RUN.gap[200].tolist())


def test_a_host_that_is_silent_does_not_hold_up_the_others():
    both = Heard(views=(view(100, (0, 1)), view(100, (2, 3), "1")))
    later = [Heard(views=(view(sample, (0, 1)),)) for sample in (150, 200, 250, 300)]
    found = hearing(both, *later).picture(1.0)
    assert [one.sample for one in found.vehicles] == [300, 300, 100, 100]
    assert found.vehicles[1].gap == pytest.approx(RUN.gap[300, 0])
    assert found.vehicles[2].gap is None
    assert found.vehicles[3].gap == pytest.approx(RUN.gap[100, 2])
    assert found.sample == 300


def test_pace_and_time_left_are_those_of_the_last_seconds():
    heard = [Heard(status=status(10 * k)) for k in range(11)]
    found = hearing(*heard).picture(2.0)
    assert found.factor == pytest.approx(50 * 0.01)
    assert found.left == pytest.approx((LAST - 100) / 50)
    assert (found.phase, found.sample, found.samples) == ("running", 100, LAST + 1)
    assert hearing(*heard).picture(9.0).silence == pytest.approx(7.0)


def test_the_end_is_seen_and_whether_it_is_a_good_one():
    watch = hearing(Heard(status=status(50)))
    assert not watch.ended
    watch.hear(Heard(status=status(LAST, RunPhase.FINISHED)), 1.0)
    assert (watch.ended, watch.failed) == (True, False)
    watch.hear(Heard(status=status(7, RunPhase.FAILED, message="no progress")), 1.0)
    assert (watch.ended, watch.failed) == (True, True)
    assert watch.picture(1.0).message == "no progress"
    assert watch.picture(1.0).left is None


def test_another_run_begins_anew():
    event = encode_string(event_line(RunEvent(EventKind.FAULT, 3, "supervisor", "x"), 0.01))
    first = Heard(status=status(100), views=(view(100),), events=(event,))
    watch = hearing(first, Heard(status=status(-1, RunPhase.WAITING, run="beef")))
    found = watch.picture(1.0)
    assert (found.sample, found.events, found.factor) == (-1, (), None)
    assert all(one.sample is None for one in found.vehicles)
    watch.hear(Heard(views=(view(120, run="f00d"),)), 1.0)
    assert watch.picture(1.0).sample == -1


def test_a_headway_that_somebody_changes_counts_in_spacing_errors():
    change = Change(50, 3, "controller.time_headway", 1.2)
    event = encode_string(event_line(change.event, 0.01))
    after = SCENARIO.with_changes([change])
    watch = hearing(Heard(events=(event,)), Heard(views=(view(200),)))
    expected = replace(RUN, scenario=after).spacing_error[200, 2]
    assert watch.picture(0.4).vehicles[3].spacing_error == pytest.approx(expected)
    assert abs(expected - RUN.spacing_error[200, 2]) > 1.0


def test_a_run_that_waits_in_the_middle_is_paused():
    def told(kind):
        return Heard(events=(encode_string(event_line(RunEvent(kind, 40, "supervisor"), 0.01)),))

    watch = hearing(Heard(status=status(20)), Heard(status=status(40)), told(EventKind.PAUSE))
    assert (watch.picture(1.0).phase, watch.picture(1.0).factor) == ("paused", None)
    watch.hear(told(EventKind.RESUME), 1.0)
    assert watch.picture(1.0).phase == "running"
    assert watch.picture(1.0).factor == pytest.approx(1.0)
    watch.hear(told(EventKind.PAUSE), 1.0)
    watch.hear(Heard(status=status(LAST, RunPhase.FINISHED)), 1.0)
    assert watch.picture(1.0).phase == "finished"


def test_the_last_events_are_kept():
    events = [RunEvent(EventKind.LATE, k, "vehicle_1/vehicle") for k in range(20)]
    lines = tuple(encode_string(event_line(event, 0.01)) for event in events)
    assert hearing(Heard(events=lines)).picture(0.0).events == tuple(events[-EVENTS_KEPT:])


def test_states_alarms_and_lateness_are_read():
    topics = Graph.of(SCENARIO).vehicles[2]
    more = {
        topics.reception.name: Reading(100, 2.0, 0.0),
        topics.monitor.name: Reading(100, 1.0, 0.3),
        topics.timing.name: Reading(100, 0.0, 1.25),
        topics.received.name: Reading(60, 0.5),
    }
    text = HostView("f00d", "0", 100, {**readings(100), **more}).to_json()
    found = hearing(Heard(views=(encode_string(text),))).picture(0.0).vehicles[2]
    assert (found.reception, found.alarm, found.lateness) == ("fallback", True, 1.25)
    assert (found.received, found.packet_age) == (0.5, pytest.approx(0.4))


def nonsense() -> st.SearchStrategy[bytes]:
    genuine = json.loads(HostView("f00d", "0", 100, readings(100)).to_json())
    values = st.one_of(
        st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.just({})
    )
    names = st.sampled_from([*genuine["readings"], "/platoon/vehicle_99/pose", ""])
    forged = st.dictionaries(names, st.lists(values, max_size=4), max_size=6)
    texts = st.builds(
        lambda key, value: {**genuine, key: value}, st.sampled_from([*genuine]), values
    )
    views = st.builds(lambda value: {**genuine, "readings": value}, forged)
    return st.one_of(st.binary(max_size=40), st.one_of(texts, views).map(json.dumps).map(_encoded))


def _encoded(text: str) -> bytes:
    return encode_string(text.encode("utf-8", "replace").decode())


@given(st.lists(nonsense(), max_size=5), st.lists(nonsense(), max_size=2))
def test_nonsense_is_no_more_than_missing(views, others):
    """It spoils a picture at most: nothing raises, and all that is shown is a number or nothing."""
    watch = hearing(Heard(status=status(50)))
    for other in others:
        watch.hear(Heard(scenario=other, status=other, events=(other,)), 0.5)
    watch.hear(Heard(views=tuple(views)), 0.6)
    found = watch.picture(0.7)
    json.dumps(found.to_json(), allow_nan=False)
    assert found.sample <= LAST
    assert all(a.index + 1 == b.index for a, b in pairwise(found.vehicles))
    assert all(v.gap is None or math.isfinite(v.gap) for v in found.vehicles)
