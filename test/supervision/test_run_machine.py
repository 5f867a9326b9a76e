"""The run machine: events and times in, actions out; no clock, no process, no message."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cacc_platoon.runs.info import EndStatus, HostInfo
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.stepping.deliveries import lost_or_foreign
from cacc_platoon.supervision.belief import ADVICE, Belief, OwnHost, refusal
from cacc_platoon.supervision.ending import ANSWER_LIMIT, GOODBYE_TIMEOUT
from cacc_platoon.supervision.newcomers import (
    NEWCOMER_LOOKS,
    NEWCOMER_WAIT,
    RIVAL_PATIENCE,
)
from cacc_platoon.supervision.pacing import known_ahead, stall_limit, start_limit
from cacc_platoon.supervision.protocol import (
    VERSION,
    HostPhase,
    HostState,
    ProtocolError,
    RunPhase,
)
from cacc_platoon.supervision.run_events import (
    Action,
    Announce,
    CloseOwnHost,
    EndRun,
    Event,
    FollowRecorder,
    GraphObserved,
    HostReported,
    HostsStarted,
    MessageRefused,
    ObserveGraph,
    ProcessEnded,
    PublishHorizon,
    PublishStatus,
    Recorded,
    RecordersConnected,
    RecordTheRest,
    ResumeAsked,
    RivalHeard,
    SignalReceived,
    StartHosts,
    StepAsked,
    Tell,
    Tick,
    Warn,
)
from cacc_platoon.supervision.run_machine import (
    GRAPH_PERIOD,
    RunMachine,
)
from cacc_platoon.supervision.run_state import HEARTBEAT_PERIOD, OWN_HOST, Stage, some
from msg_adapters.topics import Graph

RUN = "f00d"
TOPICS = ("/platoon/vehicle_0/pose", "/platoon/vehicle_1/pose")
FRONT = HostState(
    RUN,
    "front",
    100,
    ("vehicle_0/leader",),
    publishes=TOPICS[:1],
    records=TOPICS[:1],
)
REAR = HostState(
    RUN,
    "rear",
    101,
    ("vehicle_1/vehicle", "vehicle_1/noise_relay"),
    publishes=TOPICS[1:],
    subscribes=TOPICS[:1],
    records=TOPICS[1:],
)
OWN = HostState(RUN, "supervisor", 99, ("host_supervisor/recorder",), records=TOPICS)
TICK = 0.02


def scenario(**settings: object) -> Scenario:
    """Return a platoon of one follower that runs for 100 samples after the first."""
    values: dict[str, object] = {"platoon.followers": 1, "run.duration": 1.0, "run.window": 8}
    values |= {name.replace("__", "."): value for name, value in settings.items()}
    return Scenario.from_values(values, None, "test")


def belief(**settings: object) -> Belief:
    """Return what the supervisor knows of FRONT, REAR and OWN."""
    hosts = [
        OwnHost(host.host, frozenset(host.nodes), frozenset(host.records), pid=host.pid)
        for host in (FRONT, REAR, OWN)
    ]
    return Belief(Graph.of(scenario(**settings)), hosts)


class Play:
    """A run of the machine: feeds events, lets time pass, keeps what it asks for.

    Whoever looks at the graph finds what `foreign` says, and answers at once as the conductor does.
    """

    def __init__(self, machine: RunMachine | None = None, **settings: object) -> None:
        self.machine = machine or RunMachine(scenario(**settings), TOPICS, belief(**settings))
        self.now = 1000.0
        self.run = self.machine.begin(RUN, self.now)
        self.foreign: tuple[str, ...] = ()
        self.actions: list[Action] = []

    def feed(self, *events: Event) -> list[Action]:
        """Feed events at the present time; return what they led to."""
        before = len(self.actions)
        for event in events:
            self.run, actions = self.machine.step(self.run, event, self.now)
            for action in actions:
                self.actions.append(action)
                if isinstance(action, ObserveGraph):
                    self.feed(GraphObserved(self.foreign))
        return self.actions[before:]

    def after(self, seconds: float, *events: Event) -> list[Action]:
        """Let time pass, feed events, and judge."""
        self.now += seconds
        return self.feed(*events, Tick())

    def done(self, *kinds: type[Action]) -> list[Action]:
        """Return the actions of some kinds so far."""
        return [action for action in self.actions if isinstance(action, kinds)]

    @property
    def end(self) -> EndRun:
        """How the run ended."""
        (end,) = self.done(EndRun)
        assert isinstance(end, EndRun)
        return end

    # Further and further into a run.

    def started(self) -> Play:
        """Bring it to where hosts are started."""
        for _ in range(NEWCOMER_LOOKS):
            self.after(NEWCOMER_WAIT / (NEWCOMER_LOOKS - 1))
        self.after(TICK)
        assert self.run.stage is Stage.STARTING
        return self

    def matching(self) -> Play:
        """Bring it to where connections are waited for."""
        self.started().after(TICK, HostReported(FRONT), HostReported(REAR))
        assert self.run.stage is Stage.MATCHING
        return self

    def running(self) -> Play:
        """Bring it to where the leader goes."""
        self.matching().after(
            TICK,
            RecordersConnected(frozenset({"front", "rear"})),
            *(HostReported(phase(host, HostPhase.MATCHED)) for host in (FRONT, REAR)),
        )
        assert self.run.stage is Stage.RUNNING
        return self

    def record(self, sample: int) -> list[Action]:
        """Let both recorders reach a sample."""
        return self.feed(Recorded("front", sample), Recorded("rear", sample))

    def complete(self) -> None:
        """Let both recorders reach the last sample, as fast as they may."""
        while self.run.progress < 100:
            self.record(min(100, self.run.reach))

    def closed(self) -> list[Action]:
        """Let both hosts close their parts and take leave."""
        hosts = (FRONT, REAR)
        return self.after(TICK, *(HostReported(phase(host, HostPhase.CLOSED)) for host in hosts))


def phase(host: HostState, phase: HostPhase) -> HostState:
    """Return a host that has gone on."""
    return dataclasses.replace(host, phase=phase)


def matched(host: HostState) -> HostState:
    """Return a host whose connections are there."""
    return phase(host, HostPhase.MATCHED)


def failed(host: HostState, reason: str) -> HostReported:
    """Return a host that has failed."""
    return HostReported(dataclasses.replace(host, phase=HostPhase.FAILED, failure=reason))


def horizons(actions: Sequence[Action]) -> list[int]:
    return [action.sample for action in actions if isinstance(action, PublishHorizon)]


def test_a_run_from_start_to_finish() -> None:
    play = Play()
    assert play.after(TICK) == [ObserveGraph()]
    assert play.run.phase is RunPhase.WAITING
    for _ in range(NEWCOMER_LOOKS - 2):
        assert play.after(TICK) == [ObserveGraph()]
    assert play.after(NEWCOMER_WAIT) == [
        ObserveGraph(),
        Announce(),
        PublishStatus(),
        StartHosts(),
    ]
    assert play.feed(HostReported(FRONT)) == [FollowRecorder("front")]
    assert play.feed(HostReported(REAR)) == [FollowRecorder("rear")]
    assert play.after(TICK) == [PublishStatus()]
    assert play.run.phase is RunPhase.MATCHING
    assert play.feed(HostsStarted({"front": 100, "rear": 101})) == []
    assert play.feed(RecordersConnected(frozenset({"front", "rear"}))) == []
    assert play.after(TICK, HostReported(phase(FRONT, HostPhase.MATCHED))) == []
    last = HostReported(phase(REAR, HostPhase.MATCHED))
    start = Tell(RunEvent(EventKind.START, 0, OWN_HOST))
    assert play.after(TICK, last) == [ObserveGraph(), start, PublishStatus(), PublishHorizon(7)]
    assert play.run.phase is RunPhase.RUNNING
    assert play.record(3) == [PublishHorizon(11)]
    play.complete()
    assert play.after(TICK) == [PublishStatus(), CloseOwnHost()]
    assert play.run.phase is RunPhase.FINISHED
    assert play.after(TICK) == []
    over = Tell(RunEvent(EventKind.END, 100, OWN_HOST, "finished"))
    assert play.closed() == [over, EndRun(EndStatus.FINISHED)]
    assert play.after(100.0) == []
    assert play.run.stage is Stage.OVER


def test_the_first_collision_is_the_end_of_the_run() -> None:
    play = Play().running()
    hit = RunEvent(EventKind.COLLISION, 6, "vehicle_1/vehicle")
    actions = play.feed(HostReported(dataclasses.replace(matched(REAR), events=(hit,))))
    assert actions == [Tell(hit), PublishStatus()]
    assert play.machine.status(play.run).samples == 7
    sooner = RunEvent(EventKind.COLLISION, 5, "vehicle_0/leader")
    assert Tell(hit) not in play.feed(
        HostReported(dataclasses.replace(matched(FRONT), events=(sooner,)))
    )
    later = RunEvent(EventKind.COLLISION, 7, "vehicle_1/vehicle")
    told = play.feed(HostReported(dataclasses.replace(matched(REAR), events=(hit, later))))
    assert told == [Tell(later), PublishStatus()]
    assert play.machine.status(play.run).samples == 6
    play.record(4)
    assert play.run.phase is RunPhase.RUNNING
    play.record(5)
    play.after(TICK)
    assert play.run.phase is RunPhase.FINISHED


def test_a_collision_that_is_to_end_nothing_ends_nothing() -> None:
    play = Play(run__stop_on_collision=False).running()
    hit = RunEvent(EventKind.COLLISION, 6, "vehicle_1/vehicle")
    play.feed(HostReported(dataclasses.replace(matched(REAR), events=(hit,))))
    assert play.machine.status(play.run).samples == 101


def test_planned_changes_are_told_when_everybody_is_there() -> None:
    play = Play(run__timeline=["0.05 link_1 v2v.loss=0.5"]).running()
    told = Tell(RunEvent(EventKind.CHANGE, 5, "vehicle_1/noise_relay", "v2v.loss=0.5"))
    play.record(4)
    assert told not in play.after(TICK)
    play.record(5)
    assert told in play.after(TICK)
    assert told not in play.after(TICK)


@pytest.mark.parametrize("node", ["vehicle_9/vehicle", "vehicle_0/leader"])
def test_nobody_tells_what_happened_in_a_node_of_others(node: str) -> None:
    play = Play().running()
    event = RunEvent(EventKind.COLLISION, 6, node)
    play.feed(HostReported(dataclasses.replace(matched(REAR), events=(event,))))
    play.after(TICK)
    assert any(f"says what happened in {node}" in line for line in play.run.failures)


def test_what_is_no_change_is_none_of_ours() -> None:
    play = Play().running()
    event = RunEvent(EventKind.CHANGE, 6, "vehicle_1/vehicle", "v2v.latency=0.1")
    play.feed(HostReported(dataclasses.replace(matched(REAR), events=(event,))))
    assert any("is no change" in line for line in play.run.failures)


def test_the_same_events_and_times_lead_to_the_same_run() -> None:
    first, second = Play().running(), Play().running()
    assert first.run == second.run
    assert first.actions == second.actions


# Before anything is started.


def test_the_graph_is_looked_at_until_newcomers_have_been_waited_for() -> None:
    play = Play()
    ticks = round(NEWCOMER_WAIT / TICK)
    for _ in range(ticks):
        assert play.after(TICK) == [ObserveGraph()]
    play.after(TICK)
    assert play.done(StartHosts) == [StartHosts()]


def test_a_busy_machine_looks_as_often_and_so_for_longer() -> None:
    play = Play()
    for _ in range(NEWCOMER_LOOKS - 1):
        assert play.after(10.0 * NEWCOMER_WAIT) == [ObserveGraph()]
    assert StartHosts() in play.after(10.0 * NEWCOMER_WAIT)


def test_a_publisher_without_a_name_is_looked_at_again_before_anything_starts() -> None:
    play = Play()
    play.now += 10.0 * NEWCOMER_WAIT
    for _ in range(3 * NEWCOMER_LOOKS):
        assert play.feed(GraphObserved(settled=False)) == []
    for _ in range(NEWCOMER_LOOKS - 1):
        assert play.feed(GraphObserved()) == []
    assert StartHosts() in play.feed(GraphObserved())


def test_a_second_platoon_gives_way_before_it_has_published_anything() -> None:
    play = Play()
    play.foreign = ("/platoon/status has 2 publishers: /platoon/supervisor, /platoon/supervisor",)
    end = EndRun(EndStatus.FAILED, f"{play.foreign[0]}. {ADVICE}")
    assert play.feed(Tick()) == [ObserveGraph(), end]
    assert play.after(100.0) == []


def test_a_signal_before_the_start_starts_nothing_and_publishes_nothing() -> None:
    play = Play()
    play.after(TICK, SignalReceived("SIGINT"))
    assert play.actions == [play.end]
    assert play.end == EndRun(EndStatus.INTERRUPTED, "stopped by SIGINT")


# Nodes appear.


def test_a_node_that_never_appears_is_named() -> None:
    play = Play(run__start_timeout=4.0).started()
    play.after(3.9, HostReported(FRONT))
    play.after(3.9)
    assert play.done(CloseOwnHost) == []
    play.after(0.2)
    play.after(TICK, HostReported(phase(FRONT, HostPhase.CLOSED)))
    assert play.end == EndRun(
        EndStatus.FAILED,
        "for 4 s nothing has come, and these nodes have not appeared: vehicle_1/vehicle, "
        "vehicle_1/noise_relay. Start what is missing, or raise run.start_timeout",
    )


def test_who_appears_in_the_last_moment_is_in_time() -> None:
    play = Play(run__start_timeout=4.0).started()
    play.after(4.1, HostReported(FRONT), HostReported(REAR))
    assert play.run.stage is Stage.MATCHING


def test_a_host_of_another_run_or_of_none_is_passed_over() -> None:
    play = Play().started()
    for run in ("", "beef"):
        other = dataclasses.replace(FRONT, run=run, failure="it burns")
        assert play.after(TICK, HostReported(other)) == []
    assert play.run.hosts == {}


def test_a_recorder_is_followed_once() -> None:
    play = Play().started()
    play.feed(HostReported(FRONT), HostReported(phase(FRONT, HostPhase.MATCHED)))
    assert play.done(FollowRecorder) == [FollowRecorder("front")]
    play.feed(HostReported(dataclasses.replace(REAR, records=())))
    assert play.done(FollowRecorder) == [FollowRecorder("front")]


def test_parameters_that_differ_from_those_of_the_run_are_named() -> None:
    play = Play().started()
    given = {"vehicle_1/vehicle": {"run.step": 0.02, "controller.k_p": 0.009}}
    play.after(TICK, HostReported(FRONT))
    play.after(TICK, HostReported(dataclasses.replace(REAR, parameters=given)))
    assert play.run.end == EndRun(
        EndStatus.FAILED,
        "vehicle_1/vehicle: run.step = 0.02 but the run has 0.01. "
        "Start it with the run's parameters",
    )


def test_parameters_that_agree_or_are_a_nodes_own_affair_are_no_failure() -> None:
    play = Play().started()
    given: dict[str, dict[str, Any]] = {
        "vehicle_1/vehicle": {"run.step": 0.01, "run.hosts": 77},
        "vehicle_0/leader": {"leader.file": "elsewhere.csv"},
    }
    play.after(TICK, HostReported(FRONT))
    play.after(TICK, HostReported(dataclasses.replace(REAR, parameters=given)))
    assert play.run.stage is Stage.MATCHING


def test_parameters_of_what_is_no_node_are_a_failure_and_no_error() -> None:
    play = Play().started()
    given: dict[str, dict[str, Any]] = {"nonsense": {"run.step": 0.02}}
    play.after(TICK, HostReported(FRONT))
    play.after(TICK, HostReported(dataclasses.replace(REAR, parameters=given)))
    assert play.run.end
    assert "nonsense: is no node of a vehicle" in play.run.end.message


@pytest.mark.parametrize("index", [0, 7, 10**8])
def test_parameters_of_any_vehicle_can_be_compared(index: int) -> None:
    play = Play().started()
    given = {f"vehicle_{index}/vehicle": {"run.seed": 9}}
    play.after(TICK, HostReported(FRONT))
    play.after(TICK, HostReported(dataclasses.replace(REAR, parameters=given)))
    assert play.run.end
    assert f"vehicle_{index}/vehicle: run.seed = 9 but the run has 1" in play.run.end.message


def test_what_no_host_records_is_recorded_by_the_supervisor() -> None:
    play = Play().started()
    play.after(TICK, HostReported(FRONT))
    rear = dataclasses.replace(REAR, records=())
    assert play.after(TICK, HostReported(rear)) == [RecordTheRest(TOPICS[1:])]
    assert play.run.stage is Stage.RECORDING
    assert play.after(TICK) == []
    assert PublishStatus() in play.after(TICK, HostReported(OWN))
    assert play.run.stage is Stage.MATCHING
    assert play.done(RecordTheRest) == [RecordTheRest(TOPICS[1:])]


def test_a_recorder_of_ones_own_that_never_appears_ends_the_run() -> None:
    play = Play(run__start_timeout=4.0).started()
    hosts = (dataclasses.replace(host, records=()) for host in (FRONT, REAR))
    play.after(TICK, *map(HostReported, hosts))
    play.after(3.9)
    play.after(5.0)
    assert play.run.end
    assert "these nodes have not appeared: recorder." in play.run.end.message


# Nodes are connected.


def test_every_missing_connection_is_named() -> None:
    play = Play(run__start_timeout=4.0).matching()
    missing = ("vehicle_1/vehicle: no publisher of /platoon/vehicle_0/pose",)
    play.after(TICK, HostReported(dataclasses.replace(REAR, missing=missing)))
    play.after(1.0, RecordersConnected(frozenset({"rear"})))
    play.after(4.1)
    assert play.run.end == EndRun(
        EndStatus.FAILED,
        "for 4 s nothing has come, and these connections are missing: recorder of host front: its "
        "progress does not arrive, host front has not reported its connections, "
        f"{missing[0]}. Start what is missing, or raise run.start_timeout",
    )


@pytest.mark.parametrize("lacking", ["front", "rear", "progress of front", "progress of rear"])
def test_the_leader_waits_for_every_connection(lacking: str) -> None:
    play = Play().matching()
    connected = {"front", "rear"} - {lacking.removeprefix("progress of ")}
    whole = lacking in ("front", "rear")
    play.feed(RecordersConnected(frozenset({"front", "rear"} if whole else connected)))
    for host in (FRONT, REAR):
        if host.host != lacking:
            play.feed(HostReported(phase(host, HostPhase.MATCHED)))
    play.after(1.0)
    assert play.run.stage is Stage.MATCHING
    assert play.done(PublishHorizon) == []


def test_the_time_limit_counts_from_the_last_node_or_connection() -> None:
    play = Play(run__start_timeout=4.0).started()
    play.after(3.9, HostReported(FRONT))
    play.after(3.9, HostReported(REAR))
    assert play.run.stage is Stage.MATCHING
    play.after(3.9, HostReported(phase(FRONT, HostPhase.MATCHED)))
    play.after(3.9, HostReported(dataclasses.replace(REAR, missing=("a", "b"))))
    play.after(3.9, HostReported(dataclasses.replace(REAR, missing=("b",))))
    play.after(3.9)
    assert play.run.stage is Stage.MATCHING
    play.after(0.2)
    assert play.run.stage is Stage.LEAVING


def test_connections_that_come_and_go_are_no_progress() -> None:
    play = Play(run__start_timeout=4.0).matching()
    play.after(1.0, HostReported(dataclasses.replace(REAR, missing=("a",))))
    for missing in (("a", "b"), ("b",), ("a", "b"), ("a",)):
        play.after(1.1, HostReported(dataclasses.replace(REAR, missing=missing)))
    assert play.run.stage is Stage.LEAVING


@pytest.mark.parametrize(("followers", "limit"), [(1, 30.0), (49, 30.0), (200, 120.3)])
def test_large_platoons_have_more_time(followers: int, limit: float) -> None:
    """N followers are 2 N + 1 nodes; 100 of them are given the start time-out."""
    large = scenario(platoon__followers=followers)
    assert start_limit(large) == pytest.approx(limit)
    assert stall_limit(large) == pytest.approx(limit / 3.0)


def test_a_foreign_publisher_is_seen_before_the_leader_goes() -> None:
    play = Play().matching()
    play.foreign = ("/platoon/vehicle_0/pose has 2 publishers: /a, /b",)
    hosts = (HostReported(phase(host, HostPhase.MATCHED)) for host in (FRONT, REAR))
    play.after(TICK, RecordersConnected(frozenset({"front", "rear"})), *hosts)
    assert play.done(PublishHorizon) == []
    assert play.run.phase is RunPhase.FAILED


def test_the_status_has_how_many_subscribers_to_wait_for() -> None:
    play = Play().matching()
    status = play.machine.status(play.run, {TOPICS[0]: 2, TOPICS[1]: 0})
    assert status.subscribers == {TOPICS[0]: 3, TOPICS[1]: 0}
    assert (status.run, status.phase, status.sample, status.samples) == (RUN, "matching", -1, 101)
    assert status.hosts == (
        HostInfo("front", 100, FRONT.nodes),
        HostInfo("rear", 101, REAR.nodes),
    )
    assert play.machine.status(play.run).subscribers == {}


# The run runs.


def test_the_horizon_is_a_window_ahead_of_the_slowest_recorder() -> None:
    play = Play().running()
    assert horizons(play.actions) == [7]
    assert play.feed(Recorded("front", 4)) == []
    assert play.feed(Recorded("rear", 2)) == [PublishHorizon(10)]
    assert play.feed(Recorded("rear", 4)) == [PublishHorizon(12)]
    assert play.feed(Recorded("rear", 4)) == []
    assert play.run.progress == 4


def test_progress_never_goes_back() -> None:
    play = Play().running()
    play.record(5)
    assert play.record(3) == []
    assert play.record(-(2**40)) == []
    assert play.run.recorded == {"front": 5, "rear": 5}
    assert play.run.progress == 5
    assert play.feed(Recorded("front", 6), Recorded("rear", 6)) == [PublishHorizon(14)]


def test_a_recorder_can_be_ahead_of_the_leader_by_a_sample_a_follower() -> None:
    play = Play().running()
    play.record(8)
    assert play.run.progress == 8
    assert play.run.refused == ()


@pytest.mark.parametrize("sample", [9, 10, 10**9])
def test_a_recorder_that_claims_more_is_another_publisher(sample: int) -> None:
    play = Play().running()
    play.feed(Recorded("front", sample))
    assert play.run.recorded["front"] == -1
    play.after(TICK)
    play.after(GRAPH_PERIOD + TICK)
    assert play.run.end == EndRun(
        EndStatus.FAILED,
        f"host front: reports sample {sample} as recorded, beyond the horizon 8: the message "
        f"comes from another publisher; {ADVICE}",
    )


def test_a_recorder_of_relays_may_know_a_window_more() -> None:
    """That nothing is delivered at samples to come, which its relays say of at most so many."""
    prompt = Scenario.from_values({"platoon.followers": 2})
    lossy = prompt.with_values({"v2v.loss": 0.5})
    assert known_ahead(prompt) == 0
    assert known_ahead(lossy) == lossy.run.window


def test_before_the_run_nothing_can_have_been_recorded() -> None:
    play = Play().matching()
    play.feed(Recorded("front", 0))
    assert len(play.run.refused) == 1


def test_a_recorder_that_nobody_knows_is_passed_over() -> None:
    play = Play().running()
    assert play.feed(Recorded("other", 10**9)) == []
    assert play.run.refused == ()


def test_a_paced_run_lets_the_leader_go_with_time() -> None:
    play = Play(run__real_time_factor=2.0).running()
    assert horizons(play.actions) == [0]
    assert horizons(play.after(0.021)) == [4]
    assert horizons(play.after(0.2)) == [7]
    assert horizons(play.record(5)) == [13]
    assert horizons(play.after(1.0)) == [13]


def test_a_clock_that_begins_at_zero_paces_as_well() -> None:
    play = Play(run__real_time_factor=2.0)
    play.now = -NEWCOMER_WAIT - 3 * TICK
    play.run = play.machine.begin(RUN, play.now)
    play.running()
    play.run = play.run._replace(started=0.0)
    play.now = 0.0
    assert horizons(play.after(0.021)) == [4]


def test_a_stall_ends_the_run_after_the_limit_and_not_before() -> None:
    play = Play(run__stall_timeout=2.0).running()
    play.now += 1.9
    play.record(3)
    play.after(1.9)
    assert play.run.stage is Stage.RUNNING
    play.after(0.2)
    assert play.run.end == EndRun(EndStatus.FAILED, "no progress for 2 s", stalled=True)


def test_a_slow_pace_is_no_stall() -> None:
    """A window of 8 samples of 0.01 s takes 8 s at a hundredth of real time."""
    play = Play(run__stall_timeout=2.0, run__real_time_factor=0.01).running()
    play.after(9.9)
    assert play.run.stage is Stage.RUNNING
    play.after(0.2)
    assert play.run.end == EndRun(EndStatus.FAILED, "no progress for 10 s", stalled=True)


def test_one_recorder_alone_makes_no_progress() -> None:
    play = Play(run__stall_timeout=2.0).running()
    play.after(1.5, Recorded("front", 5))
    play.after(1.0)
    assert play.run.stage is Stage.LEAVING


def test_a_supervisor_that_was_frozen_takes_what_came_meanwhile_before_it_judges() -> None:
    play = Play(run__stall_timeout=2.0).running()
    play.now += 50.0
    play.record(3)
    play.feed(Tick())
    assert play.run.stage is Stage.RUNNING


def test_the_graph_is_looked_at_now_and_then() -> None:
    play = Play(run__stall_timeout=100.0).running()
    looks = sum(ObserveGraph() in play.after(TICK) for _ in range(100))
    assert looks == pytest.approx(100 * TICK / GRAPH_PERIOD, abs=1)


@pytest.mark.parametrize("stage", ["started", "matching", "running"])
def test_a_foreign_publisher_in_the_graph_ends_the_run(stage: str) -> None:
    play = Play()
    getattr(play, stage)()
    play.foreign = ("/platoon/horizon has 2 publishers: /a, /b", "another line")
    play.after(GRAPH_PERIOD + TICK)
    assert play.run.end == EndRun(EndStatus.FAILED, f"{play.foreign[0]}. {ADVICE}")


def test_the_status_is_repeated_periodically_while_the_supervisor_lives() -> None:
    play = Play(run__stall_timeout=100.0).running()
    beats = sum(PublishStatus() in play.after(TICK) for _ in range(100))
    assert beats == pytest.approx(100 * TICK / HEARTBEAT_PERIOD, abs=1)


# Something fails.


@pytest.mark.parametrize("stage", ["started", "matching", "running"])
def test_a_failure_that_a_host_reports_ends_the_run(stage: str) -> None:
    play = Play()
    getattr(play, stage)()
    play.feed(failed(REAR, "the disk is full"))
    assert play.run.phase is not RunPhase.FAILED
    fault = Tell(RunEvent(EventKind.FAULT, 0, OWN_HOST, "the disk is full"))
    assert play.after(TICK) == [fault, PublishStatus(), CloseOwnHost()]
    assert play.run.phase is RunPhase.FAILED
    assert play.machine.status(play.run).message == "the disk is full"


def test_three_failures_are_named() -> None:
    hosts = [dataclasses.replace(FRONT, host=f"h{i}") for i in range(5)]
    own = [OwnHost(host.host, frozenset(FRONT.nodes), frozenset(FRONT.records)) for host in hosts]
    machine = RunMachine(scenario(), TOPICS, Belief(Graph.of(scenario()), own))
    play = Play(machine).started()
    play.after(TICK, *(failed(host, f"reason {i}") for i, host in enumerate(hosts)))
    assert play.run.end == EndRun(EndStatus.FAILED, "reason 0; reason 1; reason 2")


def test_a_flood_of_messages_of_others_takes_no_memory() -> None:
    play = Play().running()
    play.feed(*(MessageRefused(f"message {i} from another publisher") for i in range(1000)))
    assert len(play.run.refused) == 3


@pytest.mark.parametrize(
    ("count", "told"), [(3, ""), (4, "4 messages of another publisher were refused; ")]
)
def test_a_flood_of_messages_of_others_is_counted(count: int, told: str) -> None:
    play = Play().running()
    play.feed(*(MessageRefused(f"message {i} from another publisher") for i in range(count)))
    play.after(GRAPH_PERIOD + TICK)
    play.after(GRAPH_PERIOD + TICK)
    named = "; ".join(f"message {i} from another publisher" for i in range(3))
    assert play.run.end == EndRun(EndStatus.FAILED, f"{named}; {told}{ADVICE}")


def test_a_message_of_none_of_ours_is_one_of_another_publisher() -> None:
    play = Play().running()
    with pytest.raises(ProtocolError) as nonsense:
        HostState.from_json("nonsense")
    play.after(TICK, refusal("/platoon/host_state", nonsense.value))
    play.after(GRAPH_PERIOD + TICK)
    assert play.run.end
    assert play.run.end.message == (
        "/platoon/host_state: a message from another publisher, no host of ours: the message is "
        f"not JSON that can be read; {ADVICE}"
    )


def test_a_host_of_another_version_is_told_so_and_nothing_else() -> None:
    play = Play().started()
    newer = FRONT.to_json().replace(f'"format": {VERSION}', '"format": 99')
    with pytest.raises(ProtocolError) as unknown:
        HostState.from_json(newer)
    play.after(TICK, refusal("/platoon/host_state", unknown.value))
    assert play.run.end == EndRun(
        EndStatus.FAILED,
        "/platoon/host_state: the message is of format 99, but this version of cacc_platoon "
        f"understands format {VERSION}. Use the same version of cacc_platoon for all nodes",
    )


@pytest.mark.parametrize("after", [0.0, GRAPH_PERIOD / 2])
def test_who_sent_a_message_of_none_of_ours_is_looked_for(after: float) -> None:
    play = Play().running()
    refusal = "/platoon/host_state: a message from another publisher, no host of ours"
    if not after:
        play.foreign = ("/platoon/status has 2 publishers: /x, /y",)
    play.after(TICK, MessageRefused(refusal))
    if after:
        assert play.run.stage is Stage.NAMING
        assert play.run.phase is RunPhase.RUNNING
        play.foreign = ("/platoon/status has 2 publishers: /x, /y",)
        play.after(after)
    end = EndRun(EndStatus.FAILED, f"{refusal}; {play.foreign[0]}; {ADVICE}")
    assert play.run.end == end


def test_a_sender_who_does_not_show_is_not_waited_for_long() -> None:
    play = Play().running()
    play.after(TICK, MessageRefused("x: a message from another publisher"))
    play.after(GRAPH_PERIOD - TICK)
    assert play.run.stage is Stage.NAMING
    play.after(2 * TICK)
    assert play.run.end
    assert play.run.end.message == f"x: a message from another publisher; {ADVICE}"


def test_a_failure_that_names_another_publisher_is_looked_into_as_well() -> None:
    play = Play().running()
    play.after(TICK, failed(REAR, "pose: a message was lost or comes from another publisher"))
    assert play.run.stage is Stage.NAMING


def test_a_process_that_ends_is_named_with_its_nodes() -> None:
    play = Play().running()
    play.after(TICK, ProcessEnded("rear", 101, "was killed by SIGKILL"))
    message = (
        "host rear (process 101: vehicle_1/vehicle, vehicle_1/noise_relay) was killed by SIGKILL"
    )
    assert play.run.end == EndRun(EndStatus.FAILED, message)


def test_a_process_that_ends_before_its_host_appears_is_named() -> None:
    play = Play().started()
    play.after(TICK, ProcessEnded("rear", 101, "ended with exit code 1"))
    assert play.run.end
    assert play.run.end.message == (
        "host rear (process 101: before it appeared) ended with exit code 1"
    )


def test_what_a_host_reported_counts_more_than_that_its_process_is_gone() -> None:
    play = Play().running()
    gone = ProcessEnded("rear", 101, "ended with exit code 1")
    play.after(TICK, gone, failed(REAR, "the disk is full"))
    assert play.run.end == EndRun(EndStatus.FAILED, "the disk is full")


@pytest.mark.parametrize("stage", ["started", "matching", "running"])
def test_a_signal_ends_the_run_in_good_order(stage: str) -> None:
    play = Play()
    getattr(play, stage)()
    play.feed(SignalReceived("SIGTERM"), SignalReceived("SIGINT"))
    assert play.after(TICK) == [PublishStatus(), CloseOwnHost()]
    assert play.run.end == EndRun(EndStatus.INTERRUPTED, "stopped by SIGTERM")


def test_a_failure_while_a_signal_asks_for_the_end_is_an_interruption() -> None:
    play = Play().running()
    play.after(TICK, MessageRefused("x: another publisher"))
    play.after(TICK, SignalReceived("SIGINT"))
    play.after(GRAPH_PERIOD)
    assert play.run.end
    assert play.run.end.status is EndStatus.INTERRUPTED


def test_a_complete_run_is_finished_whatever_comes_then() -> None:
    play = Play().running()
    play.complete()
    play.after(TICK)
    play.foreign = ("/platoon/status has 2 publishers: /x, /y",)
    play.after(
        TICK,
        SignalReceived("SIGINT"),
        MessageRefused("x: another publisher"),
        GraphObserved(play.foreign),
        ProcessEnded("rear", 101, "ended with exit code 0"),
    )
    play.closed()
    assert play.end == EndRun(EndStatus.FINISHED)
    assert play.feed(GraphObserved(play.foreign), SignalReceived("SIGTERM"), Tick()) == []


@pytest.mark.parametrize("last", [HostPhase.FAILED, HostPhase.CLOSED])
def test_a_failure_while_the_hosts_of_a_complete_run_end_makes_it_fail(last: HostPhase) -> None:
    play = Play().running()
    play.complete()
    play.after(TICK)
    assert play.run.phase is RunPhase.FINISHED
    full = dataclasses.replace(REAR, phase=last, failure="the disk is full")
    assert PublishStatus() in play.after(TICK, HostReported(full))
    assert play.run.phase is RunPhase.FAILED
    assert play.machine.status(play.run).message == "the disk is full"
    assert PublishStatus() not in play.after(TICK)
    play.after(TICK, HostReported(dataclasses.replace(full, phase=HostPhase.CLOSED)))
    play.after(TICK, HostReported(phase(FRONT, HostPhase.CLOSED)))
    assert play.end == EndRun(EndStatus.FAILED, "the disk is full")


def test_what_others_send_after_the_last_sample_spoils_nothing() -> None:
    play = Play().running()
    play.complete()
    play.after(TICK)
    play.after(TICK, failed(REAR, "pose: a message was lost or comes from another publisher"))
    play.closed()
    assert play.end == EndRun(EndStatus.FINISHED)


def test_a_sample_that_came_twice_spoils_a_complete_run() -> None:
    """What came first, and was recorded, may be the one that is not ours."""
    play = Play().running()
    play.complete()
    play.after(TICK)
    why = f"pose: stamped 1 s where 1.01 s is due: {lost_or_foreign(100, 101, 1)}"
    play.after(TICK, failed(REAR, why))
    play.closed()
    assert play.end.status is EndStatus.FAILED
    assert play.end.message.endswith("; everything from sample 100 on may be wrong")


def test_the_wall_time_is_from_the_first_horizon_to_the_last_sample() -> None:
    play = Play().running()
    began = play.now
    while play.run.progress < 100:
        play.now += 0.1
        play.record(min(100, play.run.reach))
    play.after(TICK)
    assert (play.run.started, play.run.ended) == (began, play.now)


# Who is believed.

EVIL = "/tmp/evil"


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"pid": 7}, "process 7 speaks for it, but it is process 100"),
        ({"part": EVIL}, "says that it records in /tmp/evil, but it was given no folder"),
        ({"records": TOPICS}, f"says that it records {TOPICS[1]}, which is not for it to record"),
        ({"records": ("/else",)}, "says that it records /else, which is not for it to record"),
        ({"nodes": ("vehicle_9/leader",)}, "says that it runs vehicle_9/leader, which it was not"),
        ({"host": "evil"}, "runs vehicle_0/leader, which is none of the nodes that are started"),
        ({"host": "evil", "nodes": ()}, "this run has not started it, and no node is started"),
    ],
)
@pytest.mark.parametrize("state", list(HostPhase))
def test_a_host_that_is_not_what_was_started_is_not_believed(
    change: dict[str, Any], why: str, state: HostPhase
) -> None:
    play = Play().running()
    before = play.run.hosts, play.run.recorded
    forged = dataclasses.replace(FRONT, phase=state, failure="it burns", **change)
    assert play.feed(HostReported(forged)) == []
    assert (play.run.hosts, play.run.recorded) == before
    play.after(TICK)
    play.after(GRAPH_PERIOD + TICK)
    assert play.run.end
    message = play.run.end.message
    assert message.startswith(f"host {forged.host}: {why}"), message
    assert message.endswith(f"the message comes from another publisher; {ADVICE}")


def test_who_spoke_for_a_host_before_its_process_was_known_is_judged_then() -> None:
    own = [
        OwnHost(host.host, frozenset(host.nodes), frozenset(host.records)) for host in (FRONT, REAR)
    ]
    play = Play(RunMachine(scenario(), TOPICS, Belief(Graph.of(scenario()), own))).started()
    play.feed(HostReported(FRONT), HostReported(REAR))
    play.feed(HostsStarted({"front": 100}))
    assert not play.run.refused
    play.feed(HostsStarted({"front": 100, "rear": 77}))
    assert "host rear: process 101 speaks for it, but it is process 77" in play.run.refused[0]


@pytest.mark.parametrize("missing", [False, True])
def test_a_host_that_leaves_while_the_run_goes_on_was_told_so_by_somebody(missing: bool) -> None:
    play = Play().running()
    host = phase(REAR, HostPhase.CLOSED)
    play.after(TICK, HostReported(host), *[ProcessEnded("rear", 101, "ended")] * missing)
    assert play.run.stage is Stage.NAMING
    play.after(GRAPH_PERIOD + TICK)
    assert play.run.end
    assert play.run.end.message.startswith("host rear has left although the run goes on: another")


def test_a_message_in_the_name_of_this_run_is_named() -> None:
    play = Play().running()
    play.after(TICK, RivalHeard(RUN, RunPhase.FINISHED))
    play.after(GRAPH_PERIOD + TICK)
    assert play.run.end
    assert play.run.end.message.startswith(
        "/platoon/status: a message in the name of this run, from another publisher"
    )


def test_a_publisher_that_nobody_can_hear_is_a_warning_and_given_once() -> None:
    play = Play().running()
    look = GraphObserved((), ("/platoon/status: /x publishes std_msgs/msg/Bool there",))
    assert play.feed(look) == [Warn(look.harmless[0])]
    assert play.feed(look) == []
    flood = GraphObserved((), tuple(f"line {i}" for i in range(1000)))
    assert len(play.feed(flood)) < 30
    play.after(TICK)
    assert play.run.stage is Stage.RUNNING


# Two platoons of one name.

BEFORE, AFTER = "0000", "ffff"
"""Names of runs that come before and after f00d."""


@pytest.mark.parametrize(
    ("stage", "rival", "stays"),
    [
        ("started", RivalHeard(AFTER, RunPhase.WAITING), True),
        ("started", RivalHeard(BEFORE, RunPhase.WAITING), False),
        ("started", RivalHeard(AFTER, RunPhase.MATCHING), False),
        ("started", RivalHeard(AFTER, RunPhase.RUNNING), False),
        ("started", RivalHeard(BEFORE, RunPhase.FAILED), True),
        ("matching", RivalHeard(BEFORE, RunPhase.WAITING), True),
        ("matching", RivalHeard(AFTER, RunPhase.MATCHING), True),
        ("matching", RivalHeard(BEFORE, RunPhase.MATCHING), False),
        ("running", RivalHeard(BEFORE, RunPhase.WAITING), True),
        ("running", RivalHeard(BEFORE, RunPhase.MATCHING), True),
        ("running", RivalHeard(BEFORE, RunPhase.RUNNING), True),
    ],
)
def test_one_of_two_gives_way(stage: str, rival: RivalHeard, stays: bool) -> None:
    play = Play()
    getattr(play, stage)()
    play.after(TICK, rival)
    assert (play.run.stage is not Stage.LEAVING) == stays
    if not stays:
        assert play.run.end
        topic = "/platoon/status: run "
        assert play.run.end.message == f"{topic}{rival.run!r} was there before. {ADVICE}"


def test_who_stays_has_patience_with_a_rival_and_not_without_end() -> None:
    play = Play(run__stall_timeout=100.0).running()
    play.feed(RivalHeard(BEFORE, RunPhase.WAITING))
    play.foreign = ("/platoon/status has 2 publishers: /platoon/supervisor, /platoon/supervisor",)
    play.after(RIVAL_PATIENCE - TICK)
    assert play.run.stage is Stage.RUNNING
    play.feed(RivalHeard(BEFORE, RunPhase.WAITING))
    play.after(GRAPH_PERIOD + TICK)
    assert play.run.end == EndRun(EndStatus.FAILED, f"{play.foreign[0]}. {ADVICE}")


def test_a_rival_is_no_cover_for_publishers_of_data() -> None:
    play = Play().running()
    play.feed(RivalHeard(BEFORE, RunPhase.WAITING))
    play.foreign = ("/platoon/vehicle_0/pose has 2 publishers: /x, /y",)
    play.after(GRAPH_PERIOD + TICK)
    assert play.run.end == EndRun(EndStatus.FAILED, f"{play.foreign[0]}. {ADVICE}")


# The end.


def test_hosts_are_waited_for_until_they_have_closed() -> None:
    play = Play().running()
    play.after(TICK, SignalReceived("SIGINT"))
    play.after(1.0, HostReported(phase(FRONT, HostPhase.CLOSED)))
    assert play.done(EndRun) == []
    play.after(1.0, HostReported(phase(REAR, HostPhase.CLOSED)))
    assert play.end.silent == ()


def test_a_host_whose_process_is_gone_is_not_waited_for() -> None:
    play = Play().running()
    play.after(TICK, ProcessEnded("rear", 101, "was killed by SIGKILL"))
    play.after(TICK, HostReported(phase(FRONT, HostPhase.CLOSED)))
    assert play.end.silent == ()


def test_silent_hosts_are_named_and_not_waited_for_longer() -> None:
    play = Play(run__stall_timeout=2.0).running()
    play.after(2.1)
    play.after(TICK, HostReported(phase(FRONT, HostPhase.CLOSED)))
    play.after(GOODBYE_TIMEOUT - 2 * TICK)
    assert play.done(EndRun) == []
    play.after(2 * TICK)
    assert play.end == EndRun(
        EndStatus.FAILED,
        "no progress for 2 s",
        ("host rear (process 101: vehicle_1/vehicle, vehicle_1/noise_relay) does not answer",),
        stalled=True,
    )


def test_a_host_that_answers_late_after_a_stall_is_named() -> None:
    """It was frozen, and is there again before the others have left."""
    play = Play(run__stall_timeout=2.0).running()
    play.after(2.1)
    play.after(TICK, HostReported(phase(FRONT, HostPhase.CLOSED)))
    play.after(ANSWER_LIMIT)
    play.after(TICK, HostReported(phase(REAR, HostPhase.CLOSED)))
    rear = "host rear (process 101: vehicle_1/vehicle, vehicle_1/noise_relay)"
    assert play.end.silent == (f"{rear} answered only after {ANSWER_LIMIT:g} s",)


def test_who_takes_its_time_after_another_end_is_not_accused() -> None:
    play = Play().running()
    play.after(TICK, SignalReceived("SIGINT"))
    play.after(ANSWER_LIMIT + TICK)
    play.closed()
    assert play.end.silent == ()


def test_the_heartbeat_goes_on_until_the_run_is_over() -> None:
    play = Play().running()
    play.after(TICK, SignalReceived("SIGINT"))
    assert play.after(HEARTBEAT_PERIOD + TICK) == [PublishStatus()]
    play.closed()
    assert play.after(HEARTBEAT_PERIOD + TICK) == []


def test_long_lists_are_cut() -> None:
    assert some([*"abcdef"]) == "a, b, c, d, e, f"
    assert some([*"abcdefgh"]) == "a, b, c, d, e, f and 2 more"


# Whatever happens.

EVENTS = st.one_of(
    st.just(Tick()),
    st.sampled_from([FRONT, REAR, OWN]).flatmap(
        lambda host: st.sampled_from(HostPhase).map(lambda p: HostReported(phase(host, p)))
    ),
    st.builds(Recorded, st.sampled_from(["front", "rear", "supervisor"]), st.integers(-2, 120)),
    st.sampled_from([{"front"}, {"front", "rear", "supervisor"}]).map(
        lambda hosts: RecordersConnected(frozenset(hosts))
    ),
    st.sampled_from(
        [
            SignalReceived("SIGINT"),
            MessageRefused("x: another publisher"),
            MessageRefused("y"),
            GraphObserved(("z",)),
            ProcessEnded("front", 100, "ended"),
            RivalHeard("0", RunPhase.WAITING),
            RivalHeard("z", RunPhase.RUNNING),
            HostsStarted({"front": 100}),
            HostReported(dataclasses.replace(FRONT, pid=1)),
        ]
    ),
)


@settings(max_examples=40)
@given(st.lists(st.tuples(st.floats(0.0, 1.0), EVENTS), max_size=60))
def test_any_run_of_events_keeps_the_rules(events: list[tuple[float, Event]]) -> None:
    """Progress and the horizon never go back; hosts start once; the end comes once, and stays."""
    play = Play(run__stall_timeout=5.0)
    progress = -1
    for seconds, event in events:
        play.after(seconds, event)
        assert play.run.progress >= progress
        progress = play.run.progress
        assert progress <= play.run.reach
    for _ in range(NEWCOMER_LOOKS + 3):
        play.after(40.0)
    assert play.run.stage is Stage.OVER
    assert isinstance(play.end, EndRun)
    assert len(play.done(StartHosts)) <= 1
    assert horizons(play.actions) == sorted(horizons(play.actions))
    assert all(len(play.done(kind)) <= 1 for kind in (RecordTheRest, CloseOwnHost))


def test_a_run_that_is_paused_stalls_not_and_shows_where_it_is() -> None:
    play = Play(run__pause_at=0.05).running()
    assert horizons(play.record(4))[-1] == 5
    assert play.machine.doing(play.run) == "paused at sample 5"
    assert play.machine.simulated(play.run, play.now) == 50_000_000
    play.after(2.0 * stall_limit(play.machine.scenario))
    assert horizons(play.feed(StepAsked(3)))[-1] == 8
    assert play.machine.doing(play.run) == Stage.RUNNING
    assert play.machine.simulated(play.run, play.now) == 40_000_000
    assert horizons(play.feed(ResumeAsked()))[-1] == 4 + play.machine.scenario.run.window
    play.complete()
    play.after(TICK)
    play.closed()
    assert play.end.status is EndStatus.FINISHED
    kinds = [tell.event.kind for tell in play.done(Tell) if isinstance(tell, Tell)]
    assert kinds == [EventKind.START, EventKind.PAUSE, EventKind.RESUME, EventKind.END]


def test_a_run_stalls_on_its_way_to_a_pause() -> None:
    play = Play(run__pause_at=0.5).running()
    play.record(4)
    play.after(2.0 * stall_limit(play.machine.scenario))
    assert play.run.phase is RunPhase.FAILED
