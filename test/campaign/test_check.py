"""Every row of the table refuses what it does not have, and what must never be is always seen."""

import dataclasses

import pytest

from cacc_platoon.campaign.check import Outcome, findings
from cacc_platoon.campaign.plan import KINDS, Fault, plan
from cacc_platoon.campaign.table import ROWS, row_of


def fault_of(kind: str, **changes) -> Fault:
    """Return a fault of a kind with some of its fields given."""
    return dataclasses.replace(plan(1, 0, only=kind), **changes)


FINISHED = Outcome(5.0, 0, state="finished", report_code=0, samples=2001, intact=True)
FAILED = Outcome(5.0, 1, state="failed", report_code=0, samples=100)
KILL = fault_of("kill", target="vehicle_2/vehicle", moment="run", sync="lockstep")
KILLED = dataclasses.replace(
    FAILED,
    message="host 1 (process 77: vehicle_2/vehicle) was killed by SIGKILL",
    suspects=("process 77",),
)


@pytest.mark.slow
def test_every_fault_has_a_row_and_every_row_a_fault():
    faults = [plan(1, index, only=kind) for kind in KINDS for index in range(300)]
    assert {id(row_of(fault)) for fault in faults} == {id(row) for row in ROWS}


def test_what_is_in_the_table_is_well():
    assert findings(KILL, KILLED) == []
    assert findings(fault_of("freeze"), FINISHED) == []
    supervisor = fault_of("signal", target="supervisor", moment="run", variant="SIGTERM")
    stopped = Outcome(2.0, 143, state="interrupted", message="stopped by SIGTERM", report_code=0)
    assert findings(supervisor, stopped) == []
    gone = fault_of("kill", target="supervisor", moment="start")
    assert findings(gone, Outcome(1.0, -9)) == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"exit_code": 0}, "failed with exit code 0, not failed with 1"),
        ({"state": "finished", "intact": True}, "finished with exit code 1, not failed"),
        ({"state": "running"}, "running with exit code 1"),
        ({"message": "it is over"}, "nothing says 'was killed by SIG'"),
        ({"suspects": ("process 78",)}, "names none of process 78"),
        ({"exit_code": None, "seconds": 60.0}, "did not end within 60 s"),
        ({"tracebacks": ("logs/host_1.log: 'Traceback'",)}, "a traceback in logs/host_1.log"),
        ({"broken": ("the bag: no message",)}, "the bag: no message"),
        ({"report_code": -11, "report_said": "Segmentation"}, "report ends with -11"),
        ({"living": (77, 78)}, "processes 77, 78 live on"),
        ({"left": ("fastrtps_0123",)}, "fastrtps_0123 was left behind"),
        ({"wrong_from": 40}, "sample 40 in the bag is wrong, and nobody was there"),
        ({"collided": True}, "vehicles collided"),
    ],
)
def test_what_must_not_be_is_said(changes, words):
    found = findings(KILL, dataclasses.replace(KILLED, **changes))
    assert any(words in line for line in found), found


def test_a_finished_run_has_its_digest():
    spoiled = dataclasses.replace(FINISHED, intact=False)
    assert findings(fault_of("freeze"), spoiled) == ["finished, and is not what it has to be"]


def test_who_comes_too_late_changes_nothing():
    flood = fault_of("flood")
    assert findings(flood, dataclasses.replace(FINISHED, late=True)) == []
    assert findings(flood, FINISHED) != []


@pytest.mark.parametrize(
    ("changes", "well"),
    [
        ({"message": "another publisher", "suspects": ("publisher",)}, True),
        ({"message": "a publisher", "doubted_from": 40, "suspects": ("publisher",)}, True),
        ({"message": "a publisher", "doubted_from": 41, "suspects": ("publisher",)}, False),
    ],
)
def test_wrong_samples_are_in_a_bag_only_where_the_run_says_so(changes, well):
    outcome = dataclasses.replace(FAILED, wrong_from=40, **changes)
    assert (findings(fault_of("foreign_data"), outcome) == []) == well
