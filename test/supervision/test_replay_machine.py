"""A replay is a run of two hosts: it goes on as far as there are answers, or says what stopped."""

import dataclasses
import os

from cacc_platoon.runs.info import EndStatus
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.names import NodeKind, NodeName
from cacc_platoon.supervision.protocol import HostPhase, HostState
from cacc_platoon.supervision.replay_machine import REPLAYED, REPLAYER, ReplayMachine
from cacc_platoon.supervision.run_events import (
    Action,
    Event,
    FollowRecorder,
    GraphObserved,
    HostReported,
    ObserveGraph,
    ProcessEnded,
    PublishHorizon,
    Recorded,
    RecordersConnected,
    StartHosts,
    Tick,
)
from cacc_platoon.supervision.run_state import Run, Stage

SCENARIO = Scenario.from_values(
    {"run.window": 8, "run.start_timeout": 2.0, "run.stall_timeout": 3.0}, None, "test"
)
NODE = NodeName(NodeKind.VEHICLE, 2)
ANSWERS = ("/platoon/vehicle_2/pose",)
NODES_HOST = HostState("f00d", REPLAYED, 7, (str(NODE),), publishes=ANSWERS)
OWN_HOST = HostState(
    "f00d", REPLAYER, os.getpid(), (REPLAYER,), subscribes=ANSWERS, records=ANSWERS
)
MACHINE = ReplayMachine(SCENARIO, NODE, ANSWERS, samples=30)


def go(run: Run, now: float, *events: Event) -> tuple[Run, list[Action]]:
    """Feed events and a tick; answer at once when the graph is looked at."""
    done: list[Action] = []
    for event in (*events, Tick()):
        run, actions = MACHINE.step(run, event, now)
        done += actions
        if ObserveGraph() in actions:
            run, actions = MACHINE.step(run, GraphObserved(), now)
            done += actions
    return run, done


def running() -> Run:
    """Return a replay that has begun to give samples, at 1.2 s."""
    run, actions = go(MACHINE.begin("f00d", 1.0), 1.02)
    assert StartHosts() in actions, "a replay starts without looking for other platoons"
    run, actions = go(run, 1.1, HostReported(NODES_HOST), HostReported(OWN_HOST))
    assert FollowRecorder(REPLAYER) in actions
    matched = [
        HostReported(dataclasses.replace(host, phase=HostPhase.MATCHED))
        for host in (NODES_HOST, OWN_HOST)
    ]
    run, actions = go(run, 1.2, RecordersConnected(frozenset({REPLAYER})), *matched)
    assert PublishHorizon(7) in actions
    return run


def message(run: Run) -> str:
    assert run.end is not None
    assert run.end.status is EndStatus.FAILED
    return run.end.message


def test_a_replay_ends_with_the_last_answer_not_with_the_last_sample_of_the_run() -> None:
    run, actions = go(running(), 1.3, Recorded(REPLAYER, 7), Recorded(REPLAYER, 15))
    assert [action for action in actions if isinstance(action, PublishHorizon)] == [
        PublishHorizon(15),
        PublishHorizon(23),
    ]
    run, _ = go(run, 1.4, Recorded(REPLAYER, 29))
    assert run.stage is Stage.LEAVING
    assert run.end is not None
    assert run.end.status is EndStatus.FINISHED


def test_a_node_that_does_not_appear_is_named() -> None:
    run, _ = go(MACHINE.begin("f00d", 1.0), 1.02)
    run, _ = go(run, 2.0, HostReported(OWN_HOST))
    run, _ = go(run, 4.1)
    assert message(run) == "vehicle_2/vehicle has not appeared for 2 s"


def test_a_node_that_is_not_connected_is_named_with_what_is_missing() -> None:
    run, _ = go(MACHINE.begin("f00d", 1.0), 1.02)
    run, _ = go(run, 1.1, HostReported(NODES_HOST), HostReported(OWN_HOST))
    run, _ = go(run, 2.0, RecordersConnected(frozenset({REPLAYER})))
    run, _ = go(run, 4.1)
    assert message(run) == (
        "vehicle_2/vehicle is not connected for 2 s: host replayed has not reported its "
        "connections; host replayer has not reported its connections"
    )


def test_a_node_that_gives_no_more_answers_is_named_with_the_sample() -> None:
    run, _ = go(running(), 2.0, Recorded(REPLAYER, 7))
    run, _ = go(run, 4.9)
    assert run.stage is Stage.RUNNING
    run, _ = go(run, 5.1)
    assert message(run) == (
        "vehicle_2/vehicle gave no answer to sample 8 and has stopped, or what it was given has "
        "for 3 s"
    )


def test_who_gives_the_samples_is_there_before_the_node_is_started() -> None:
    replayer = {f"/platoon/{REPLAYER}"}
    allowed = MACHINE.publishers(MACHINE.begin("f00d", 1.0))
    assert allowed["/platoon/vehicle_1/pose"] == replayer
    assert allowed["/platoon/host_state"] >= replayer
    assert allowed["/platoon/host_replayer/recorded"] >= replayer
    assert not allowed[ANSWERS[0]]
    assert not allowed["/platoon/status"]


def test_a_process_that_ends_is_named() -> None:
    run, _ = go(running(), 2.0, ProcessEnded(REPLAYED, 7, "was killed by SIGKILL"))
    assert message(run) == "vehicle_2/vehicle (process 7) was killed by SIGKILL"
