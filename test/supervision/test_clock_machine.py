"""The rules of a run by clocks: it goes on whoever ends or stops, to its planned end."""

from __future__ import annotations

import dataclasses

import pytest

from cacc_platoon.runs.info import EndStatus
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.run_event import EventKind
from cacc_platoon.stepping.wall import CLOCK_MARGIN
from cacc_platoon.supervision.belief import Belief, OwnHost
from cacc_platoon.supervision.clock_machine import ClockMachine
from cacc_platoon.supervision.newcomers import NEWCOMER_LOOKS
from cacc_platoon.supervision.pacing import (
    LEAD,
    LEAD_OF_A_VEHICLE,
    end_by_clocks,
    sample_by_clocks,
    start_limit,
)
from cacc_platoon.supervision.protocol import HostPhase, HostState, RunPhase
from cacc_platoon.supervision.run_events import (
    Action,
    EndRun,
    Event,
    GraphObserved,
    HostReported,
    HostsStarted,
    ObserveGraph,
    PauseAsked,
    ProcessEnded,
    PublishHorizon,
    PublishStatus,
    Recorded,
    RecordersConnected,
    RestartHost,
    SignalReceived,
    Tell,
    Tick,
    Warn,
)
from cacc_platoon.supervision.run_state import MOST_WARNINGS, Stage
from msg_adapters.topics import Graph

AHEAD = 1.7e9
"""The system's clock minus the steady one [s]."""
TOPICS = ("/platoon/vehicle_0/pose", "/platoon/vehicle_1/pose")
HOSTS = {
    "front": HostState("f00d", "front", 100, ("vehicle_0/leader",), records=TOPICS[:1]),
    "rear": HostState(
        "f00d", "rear", 101, ("vehicle_1/vehicle", "vehicle_1/noise_relay"), records=TOPICS[1:]
    ),
}


class Play:
    """A run that has been brought to where it runs: 101 samples, 10 ms apart."""

    def __init__(self, **settings: object) -> None:
        values: dict[str, object] = {"platoon.followers": 1, "run.duration": 1.0}
        values |= {"run.sync": "wall"} | {k.replace("__", "."): v for k, v in settings.items()}
        self.scenario = Scenario.from_values(values)
        hosts = [
            OwnHost(one.host, frozenset(one.nodes), frozenset(one.records), pid=one.pid)
            for one in HOSTS.values()
        ]
        belief = Belief(Graph.of(self.scenario), hosts)
        self.machine = ClockMachine(self.scenario, TOPICS, belief, ahead=lambda: AHEAD)
        self.now = 1000.0
        self.run = self.machine.begin("f00d", self.now)
        self.actions: list[Action] = []
        for _ in range(NEWCOMER_LOOKS + 1):
            self.after(1.0)
        self.after(0.02, *(HostReported(host) for host in HOSTS.values()))
        matched = [dataclasses.replace(one, phase=HostPhase.MATCHED) for one in HOSTS.values()]
        connected = RecordersConnected(frozenset(HOSTS))
        self.after(0.02, connected, *(HostReported(host) for host in matched))
        assert self.run.stage is Stage.RUNNING
        self.start = self.run.start / 1e9 - AHEAD

    def after(self, seconds: float, *events: Event) -> list[Action]:
        """Let time pass, feed events, and judge."""
        self.now += seconds
        before = len(self.actions)
        for event in (*events, Tick()):
            self._feed(event)
        return self.actions[before:]

    def _feed(self, event: Event) -> None:
        self.run, actions = self.machine.step(self.run, event, self.now)
        for action in actions:
            self.actions.append(action)
            if isinstance(action, ObserveGraph):
                self._feed(GraphObserved())

    def at(self, sample: int, *events: Event) -> list[Action]:
        """Let the clocks show a sample, and feed events."""
        return self.after(self.start + 0.01 * sample - self.now, *events)

    def over(self) -> EndRun:
        """Let the hosts that live take leave, and return how the run ended."""
        assert self.run.stage is Stage.LEAVING
        self.after(4.0)
        (end,) = [action for action in self.actions if isinstance(action, EndRun)]
        return end


def test_everybody_is_told_a_start_that_lies_ahead() -> None:
    play = Play()
    assert play.start == pytest.approx(play.now + LEAD + 0.02, abs=1e-6)
    assert play.machine.status(play.run).start == play.run.start
    assert PublishStatus() in play.actions
    assert not [action for action in play.actions if isinstance(action, PublishHorizon)]


def test_a_run_from_start_to_finish() -> None:
    play = Play()
    play.at(50, Recorded("front", 48), Recorded("rear", 48))
    assert play.run.progress == 48
    play.at(101, Recorded("front", 100), Recorded("rear", 100))
    assert play.run.phase is RunPhase.FINISHED
    end = play.over()
    assert end.status is EndStatus.FINISHED
    assert not end.message


def test_progress_that_no_clock_can_have_made_is_not_believed() -> None:
    play = Play(run__duration=100.0)
    beyond = 50 + round(CLOCK_MARGIN / 0.01) + 1
    play.at(50, Recorded("front", beyond - 2))
    assert play.run.recorded["front"] == beyond - 2
    play.at(50, Recorded("rear", beyond + 1))
    assert play.run.recorded["rear"] == -1
    assert "beyond the horizon" in play.run.refused[0]


def test_what_is_waited_for_and_believed_goes_by_the_pace() -> None:
    fast, slow = (Play(run__real_time_factor=pace).scenario for pace in (5.0, 0.5))
    assert end_by_clocks(fast) < end_by_clocks(slow) - 1.7
    assert sample_by_clocks(fast, 0.1) == round((0.1 + CLOCK_MARGIN) * 500)
    assert sample_by_clocks(slow, 0.1) == round((0.1 + CLOCK_MARGIN) * 50)


def test_a_host_that_stops_keeps_nobody_from_going_on_and_may_come_back() -> None:
    play = Play(run__duration=100.0)
    play.at(50, Recorded("front", 48), Recorded("rear", 48))
    play.at(9000, Recorded("front", 8998))
    assert play.run.stage is Stage.RUNNING
    play.at(9010, Recorded("rear", 9008), Recorded("front", 9008))
    assert play.run.progress == 9008
    play.at(10_010, Recorded("rear", 10_000), Recorded("front", 10_000))
    assert play.over().status is EndStatus.FINISHED


def test_a_host_that_stopped_for_good_ends_the_run_when_it_should_be_over() -> None:
    play = Play()
    play.at(50, Recorded("front", 48), Recorded("rear", 48))
    limit = end_by_clocks(play.scenario)
    play.at(round(limit / 0.01) - 1, Recorded("front", 100))
    assert play.run.stage is Stage.RUNNING
    play.at(round(limit / 0.01) + 2)
    end = play.over()
    assert end.status is EndStatus.FAILED
    assert end.stalled


def test_a_process_that_ends_is_told_once_and_the_others_go_on() -> None:
    play = Play()
    gone = ProcessEnded("rear", 101, "was killed by SIGKILL")
    told = play.at(50, Recorded("front", 48), gone)
    (line,) = [action.line for action in told if isinstance(action, Warn)]
    assert "host rear (process 101: vehicle_1/vehicle, vehicle_1/noise_relay) was killed" in line
    (event,) = [action.event for action in told if isinstance(action, Tell)]
    assert (event.kind, event.text) == (EventKind.FAULT, line)
    later = play.at(60, Recorded("front", 58))
    assert not [action for action in later if isinstance(action, (Warn, Tell))]
    assert (play.run.stage, play.run.progress) == (Stage.RUNNING, 58)
    play.at(101, Recorded("front", 100))
    end = play.over()
    assert end.status is EndStatus.FAILED
    assert end.message == line


def test_without_any_process_left_the_run_is_over() -> None:
    play = Play()
    play.at(50, ProcessEnded("rear", 101, "was killed"), ProcessEnded("front", 100, "was killed"))
    assert play.over().status is EndStatus.FAILED


def test_a_process_that_ends_before_the_start_ends_the_run() -> None:
    play = Play()
    play.run = play.run._replace(stage=Stage.MATCHING, phase=RunPhase.MATCHING)
    play.after(0.02, ProcessEnded("rear", 101, "was killed"))
    assert play.over().status is EndStatus.FAILED


def test_a_signal_ends_the_run() -> None:
    play = Play()
    play.at(50, SignalReceived("SIGINT"))
    assert play.over().status is EndStatus.INTERRUPTED


def test_clocks_are_not_stopped() -> None:
    play = Play()
    assert "cannot be stopped" in play.machine.refuses(play.run, PauseAsked())


def test_the_simulated_time_is_that_of_the_clocks() -> None:
    play = Play()
    began = play.run.started or 0.0
    start = LEAD + LEAD_OF_A_VEHICLE * 2
    times = (0.0, start + 0.2151, start + 99.0)
    shown = [play.machine.simulated(play.run, began + t) for t in times]
    assert shown == [0, 210_000_000, 1_000_000_000]


def asked(host: HostState, ahead: float, trip: float) -> HostReported:
    """Return the answer of a host whose clock is ahead by some seconds, after a round trip."""
    sent = 1_700_000_000_000_000_000
    answered = sent + round((ahead + 0.5 * trip) * 1e9)
    state = dataclasses.replace(host, answers=sent, answered=answered, phase=HostPhase.MATCHED)
    return HostReported(state, sent + round(trip * 1e9))


def test_the_shortest_round_trip_tells_how_far_clocks_are_apart() -> None:
    play = Play()
    play.at(0, asked(HOSTS["front"], 0.002, 0.006))
    play.at(0, asked(HOSTS["front"], 0.0015, 0.0004))
    play.at(0, asked(HOSTS["front"], 0.003, 0.010))
    assert play.run.offsets["front"] == pytest.approx((0.0015, 0.0002))
    assert not [one for one in play.actions if isinstance(one, Warn)]


def test_clocks_that_are_half_a_period_apart_for_certain_are_a_warning() -> None:
    play = Play()
    play.at(0, asked(HOSTS["front"], 0.0055, 0.0012))
    assert not [one for one in play.actions if isinstance(one, Warn)]
    play.at(1, asked(HOSTS["front"], 0.0055, 0.0008))
    play.at(2, asked(HOSTS["front"], 0.0056, 0.0002))
    play.at(3, asked(HOSTS["rear"], -0.25, 0.001))
    warnings = [one.line for one in play.actions if isinstance(one, Warn)]
    assert [line.partition(", more than")[0] for line in warnings] == [
        "host front: its clock is 5.5 ms ahead of the supervisor's (to within 0.4 ms)",
        "host rear: its clock is 250 ms behind the supervisor's (to within 0.5 ms)",
    ]


def test_an_answer_to_what_nobody_asked_is_none() -> None:
    play = Play()
    play.at(0, HostReported(HOSTS["front"], 5))
    later = dataclasses.replace(HOSTS["front"], answers=2_000, answered=7)
    play.at(0, HostReported(later, 1_000))
    assert play.run.offsets == {}


def test_a_host_that_ended_is_started_again_as_often_as_asked() -> None:
    play = Play(run__restarts=1)
    play.at(10, HostsStarted({"front": 100, "rear": 101}), Recorded("rear", 8))
    play.at(20, ProcessEnded("rear", 101, "was killed"))
    kinds = [one.event.kind for one in play.actions if isinstance(one, Tell)]
    assert kinds == [EventKind.START, EventKind.FAULT, EventKind.RESTART]
    assert RestartHost("rear") in play.actions
    assert (play.run.gone, dict(play.run.ended_processes)) == ((101,), {})
    play.at(21, HostReported(HOSTS["rear"]))  # what the old one said last
    again = dataclasses.replace(HOSTS["rear"], pid=222)
    play.at(40, HostsStarted({"front": 100, "rear": 222}), HostReported(again))
    assert play.run.hosts["rear"].pid == 222
    assert not play.run.refused
    assert play.run.recorded["rear"] == -1
    play.at(101, Recorded("front", 100), Recorded("rear", 100))
    assert play.over().status is EndStatus.FINISHED


def test_a_host_that_ends_too_often_is_lost() -> None:
    play = Play(run__restarts=1)
    for pid in (101, 222):
        play.at(20, HostsStarted({"front": 100, "rear": pid}))
        play.at(30, ProcessEnded("rear", pid, "was killed"))
    assert len([one for one in play.actions if isinstance(one, RestartHost)]) == 1
    assert set(play.run.ended_processes) == {"rear"}


def test_a_run_does_not_end_without_a_host_that_is_being_started_again() -> None:
    play = Play(run__restarts=1)
    started = HostsStarted({"front": 100, "rear": 101})
    ended = [ProcessEnded("front", 100, "was killed"), ProcessEnded("rear", 101, "was killed")]
    play.at(95, started, Recorded("front", 90), Recorded("rear", 90))
    play.at(96, *ended)
    assert play.run.stage is Stage.RUNNING
    again = [dataclasses.replace(HOSTS[name], pid=pid) for name, pid in (("front", 7), ("rear", 8))]
    play.at(99, HostsStarted({"front": 7, "rear": 8}), HostReported(again[0]))
    play.at(120, Recorded("front", 100))
    assert play.run.stage is Stage.RUNNING
    play.at(130, HostReported(again[1]), Recorded("rear", 99))
    assert play.run.stage is Stage.RUNNING
    play.at(131, Recorded("rear", 100))
    assert play.over().status is EndStatus.FINISHED


def test_a_host_that_is_not_there_again_in_time_is_named() -> None:
    play = Play(run__restarts=1)
    play.at(50, HostsStarted({"front": 100, "rear": 101}), Recorded("front", 48))
    play.at(90, ProcessEnded("rear", 101, "was killed"))
    play.at(102, Recorded("front", 100))
    late = end_by_clocks(play.scenario) * 100.0
    play.at(round(late) + 10)
    assert play.run.stage is Stage.RUNNING
    play.at(round(late + 100.0 * start_limit(play.scenario)) + 10)
    end = play.over()
    assert end.status is EndStatus.FAILED
    assert "host rear, which was started again, is not there" in end.message


def test_a_host_that_is_lost_is_an_event_when_nothing_more_is_warned_of() -> None:
    play = Play()
    play.run = play.run._replace(warned=frozenset(map(str, range(MOST_WARNINGS))))
    told = play.at(50, Recorded("front", 48), ProcessEnded("rear", 101, "was killed"))
    told += play.at(60, Recorded("front", 58))
    assert not [action for action in told if isinstance(action, Warn)]
    assert [one.event.kind for one in told if isinstance(one, Tell)] == [EventKind.FAULT]
