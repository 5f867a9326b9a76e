"""A host's part in a run: which run, which connections, when it is abandoned, what it reports."""

import pytest

from cacc_platoon.supervision.host_machine import Endpoint, HostMachine, missing_connections
from cacc_platoon.supervision.json_fields import MAX_TEXT
from cacc_platoon.supervision.protocol import HostPhase, HostState, RunPhase, RunStatus

POSE, ACCEL = "/platoon/vehicle_1/pose", "/platoon/vehicle_1/accel"
SUBSCRIBERS = {POSE: 2, ACCEL: 1}


def host(run: str = "f00d") -> HostMachine:
    return HostMachine(HostState(run, "rear", 101, ("vehicle_1/vehicle",)), silence_limit=9.0)


def status(phase: RunPhase = RunPhase.WAITING, run: str = "f00d") -> RunStatus:
    return RunStatus(run, phase, subscribers=SUBSCRIBERS)


def published(topic: str, found: int) -> Endpoint:
    return Endpoint("vehicle_1/vehicle", topic, True, found)


def subscribed(topic: str, found: int) -> Endpoint:
    return Endpoint("vehicle_1/vehicle", topic, False, found)


@pytest.mark.parametrize(
    ("endpoint", "missing"),
    [
        (published(POSE, 2), []),
        (published(POSE, 3), []),
        (published(POSE, 1), [f"vehicle_1/vehicle: 1 of 2 subscribers of {POSE}"]),
        (published(ACCEL, 0), [f"vehicle_1/vehicle: 0 of 1 subscribers of {ACCEL}"]),
        (published("/rosout", 0), []),
        (subscribed(POSE, 1), []),
        (subscribed(POSE, 0), [f"vehicle_1/vehicle: no publisher of {POSE}"]),
        (subscribed("/parameter_events", 0), []),
    ],
)
def test_a_connection_that_is_missing_is_named(endpoint: Endpoint, missing: list[str]) -> None:
    assert list(missing_connections([endpoint], SUBSCRIBERS)) == missing
    assert list(missing_connections([endpoint, endpoint], SUBSCRIBERS)) == 2 * missing
    assert missing_connections([endpoint], {}) == ()


def test_a_host_without_a_run_belongs_to_the_first_it_meets() -> None:
    met = host(run="").take_status(status(run="first"), 1.0)
    assert met.state.run == "first"
    assert met.take_status(status(RunPhase.FAILED, run="second"), 2.0) == met


@pytest.mark.parametrize("phase", [RunPhase.FINISHED, RunPhase.FAILED])
def test_a_host_without_a_run_waits_for_one_that_is_not_over(phase: RunPhase) -> None:
    waiting = host(run="").take_status(status(phase, run="last"), 1.0)
    assert waiting == host(run="")
    assert not waiting.ended
    assert not waiting.abandoned(1e9)
    assert waiting.take_status(status(run="next"), 2.0).state.run == "next"


def test_a_host_of_a_run_passes_over_every_other() -> None:
    alone = host()
    assert alone.take_status(status(RunPhase.FINISHED, run="beef"), 1.0) == alone
    assert not alone.ended


def test_connections_are_reported_while_they_are_waited_for_and_only_then() -> None:
    waiting = host().take_status(status(), 1.0)
    assert not waiting.awaits_connections
    assert waiting.take_connections([published(POSE, 2)]) == waiting
    matching = waiting.take_status(status(RunPhase.MATCHING), 2.0)
    assert matching.awaits_connections
    lacking = matching.take_connections([published(POSE, 1)])
    assert lacking.state.phase is HostPhase.UP
    assert lacking.state.missing == (f"vehicle_1/vehicle: 1 of 2 subscribers of {POSE}",)
    assert lacking.take_connections([published(POSE, 1)]) == lacking
    matched = lacking.take_connections([published(POSE, 2)])
    assert (matched.state.phase, matched.state.missing) == (HostPhase.MATCHED, ())
    assert matched.take_connections([published(POSE, 0)]) == matched


def test_nobody_waits_for_connections_of_a_host_that_has_met_no_run() -> None:
    assert host().take_connections([published(POSE, 0)]) == host()


def test_the_first_failure_is_reported_and_stays() -> None:
    failed = host().fail("the disk is full").fail("and more")
    assert (failed.state.phase, failed.state.failure) == (HostPhase.FAILED, "the disk is full")
    matching = failed.take_status(status(RunPhase.MATCHING), 1.0)
    assert matching.take_connections([published(POSE, 2)]).state.phase is HostPhase.FAILED
    closed = matching.close()
    assert (closed.state.phase, closed.state.failure) == (HostPhase.CLOSED, "the disk is full")


def test_any_failure_can_be_sent() -> None:
    failed = host().fail("\ud800\0" + "x" * 2 * MAX_TEXT)
    assert HostState.from_json(failed.state.to_json()) == failed.state


@pytest.mark.parametrize("phase", list(RunPhase))
def test_the_end_of_the_run_is_the_end_of_the_host(phase: RunPhase) -> None:
    updated = host().take_status(status(phase), 1.0)
    assert updated.ended == (phase in ("finished", "failed"))
    assert updated.finished == (phase == "finished")


def test_a_supervisor_that_falls_silent_has_abandoned_its_hosts() -> None:
    updated = host().take_status(status(RunPhase.RUNNING), 100.0)
    assert not updated.abandoned(109.0)
    assert updated.abandoned(109.1)
    assert not updated.take_status(status(RunPhase.RUNNING), 105.0).abandoned(109.1)
    assert updated.take_status(status(RunPhase.RUNNING, run="beef"), 105.0).abandoned(109.1)


def test_a_host_that_has_met_no_supervisor_waits_for_ever() -> None:
    assert not host().abandoned(1e9)


def test_a_status_that_asks_for_the_time_is_answered() -> None:
    asked = RunStatus("f00d", RunPhase.RUNNING, sent=123)
    met = host().take_status(asked, 1.0, received=456)
    assert (met.state.answers, met.state.answered) == (123, 456)
    again = met.take_status(status(RunPhase.RUNNING), 2.0, received=789)
    assert again.state == met.state
    assert host().take_status(RunStatus("other", sent=123), 1.0, received=456) == host()
