"""What a report makes of samples that came late or with old poses."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cacc_platoon.analysis.clocks import clock_premises, clock_use, distance_from
from cacc_platoon.analysis.consistency import check_links
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import Trajectory, simulate
from cacc_platoon.simulation.timing import Timing

CLOCKED = {"run.sync": "wall", "run.duration": 4.0, "platoon.followers": 3, "leader.start": 0.5}


def run_with(age: int = 0, lateness: float = 0.0) -> Trajectory:
    """Return a run of which one sample of the second follower came so."""
    run = simulate(Scenario.from_values({**CLOCKED, "v2v.loss": 0.1}))
    timing = Timing.perfect(*run.position[:, 1:].shape)
    timing.age[200, 1], timing.lateness[200, 1] = age, lateness
    return dataclasses.replace(run, timing=timing)


def test_a_run_in_time_breaks_no_premise_of_its_certificate() -> None:
    assert list(clock_premises(clock_use(run_with()))) == []


def test_one_old_pose_is_said_with_its_age_and_its_vehicle() -> None:
    (line,) = clock_premises(clock_use(run_with(age=3)))
    assert line.startswith("1 of 3 vehicles used poses that were old, up to 0.03 s (vehicle 2)")


def test_one_late_sample_is_said_with_its_time() -> None:
    (line,) = clock_premises(clock_use(run_with(lateness=1.0)))
    assert line.startswith("1 sample of 1 of 3 vehicles came a control period late")
    assert "the first of vehicle 2 at 2 s" in line


@pytest.mark.parametrize("shift", [0.25, -0.25])
def test_the_distance_of_a_run_is_the_largest_on_either_side(shift: float) -> None:
    run = run_with()
    position = run.position.copy()
    position[150, 2] += shift
    position[160, 1] += 0.1
    found = distance_from(dataclasses.replace(run, position=position), run)
    assert found == pytest.approx((0.25, 2, 1.5))


def test_what_no_channel_sent_is_found_by_clocks_too() -> None:
    run = run_with()
    assert run.arrivals is not None
    assert check_links(run).largest == 0.0
    arrivals = list(run.arrivals)
    value = arrivals[1].value.copy()
    value[120] += 0.01
    arrivals[1] = arrivals[1]._replace(value=value)
    assert check_links(dataclasses.replace(run, arrivals=tuple(arrivals))).largest > 1e-3
    lost = np.setdiff1d(np.arange(400), run.arrivals[1].source)[:1]
    invented = run.arrivals[1]._replace(
        source=np.append(run.arrivals[1].source, lost),
        sample=np.append(run.arrivals[1].sample, 400),
        value=np.append(run.arrivals[1].value, 0.0),
    )
    arrivals[1] = invented
    assert np.isinf(check_links(dataclasses.replace(run, arrivals=tuple(arrivals))).largest)
