"""The reports of the three cases, without bags and nodes."""

from pathlib import Path

import pytest

from cacc_platoon.analysis import Report, check_consistency, compute_metrics, judge
from cacc_platoon.reproduction.cases import CASES, case_scenario
from cacc_platoon.runs.recorded_run import RecordedRun
from cacc_platoon.runs.sample_grid import Grid
from cacc_platoon.simulation import monte_carlo, simulate


def report_of(case, **settings):
    """The report of a case without the detour by a bag."""
    scenario = case_scenario(case, settings)
    trajectory, expectation = simulate(scenario), simulate(scenario, "expected")
    measured, consistency = compute_metrics(trajectory), check_consistency(trajectory)
    grid = Grid(0, scenario.step_ns, scenario.samples, exact=True)
    run = RecordedRun(Path("bag"), trajectory, scenario, grid, (), "0" * 64, "", 0, None)
    return Report(
        Path("nowhere"),
        run,
        measured,
        expectation,
        compute_metrics(expectation),
        consistency,
        judge(scenario, measured.noise, consistency),
        monte_carlo(scenario, 2),
    )


@pytest.fixture(scope="session")
def reports():
    return {case.name: report_of(case) for case in CASES}
