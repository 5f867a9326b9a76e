"""Views of hosts: what goes out comes back, and which sample is asked for."""

import math

import pytest

from cacc_platoon.runs.sample_reader import Reading
from cacc_platoon.scenario import Scenario
from cacc_platoon.supervision.protocol import ProtocolError
from cacc_platoon.supervision.run_state import Run, Stage, shown_sample
from cacc_platoon.supervision.view_message import MAX_READINGS, HostView

POSE = "/platoon/vehicle_0/pose"


def test_a_view_comes_back_as_it_was():
    view = HostView("f00d", "0", 12, {POSE: Reading(12, 1.25, -0.5), "b": Reading(0, 1.0)})
    assert HostView.from_json(view.to_json()) == view


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_left_out(value):
    view = HostView("f00d", "0", 12, {POSE: Reading(12, value), "b": Reading(12, 0.0, value)})
    assert HostView.from_json(view.to_json()).readings == {}


def test_a_view_without_end_is_refused():
    readings = {str(number): Reading(0, 0.0) for number in range(MAX_READINGS + 1)}
    with pytest.raises(ProtocolError, match="over"):
        HostView.from_json(HostView("f00d", "0", 0, readings).to_json())


@pytest.mark.parametrize(("sync", "sample"), [("lockstep", 16), ("wall", 48)])
def test_in_lockstep_everybody_has_the_sample_and_by_clocks_the_newest_counts(sync, sample):
    scenario = Scenario.from_values({"run.sync": sync})
    run = Run("f00d", Stage.RUNNING, 0.0, recorded={"0": 48, "1": 16}, progress=16)
    assert shown_sample(run, scenario) == sample
    assert shown_sample(run._replace(stage=Stage.MATCHING), scenario) == -1
    assert shown_sample(Run("f00d", Stage.RUNNING, 0.0), scenario) == -1
