"""How a host that was started on its own meets a run: by name, with the scenario of that run."""

from pathlib import Path

import pytest

from cacc_platoon.errors import UserError
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario
from cacc_platoon.supervision.meeting import Matchmaker, Wishes, objection, own_host
from cacc_platoon.supervision.protocol import RunPhase, RunStatus, text_digest


def scenario(**more):
    given = {"platoon.followers": 3, "run.remote_hosts": ("east=1-2", "west=3"), **more}
    return Scenario.from_values(given)


def status(run, text, phase=RunPhase.WAITING):
    return RunStatus(run, phase, scenario=text_digest(text)).to_json()


OLD, NEW = (format_scenario(scenario(**{"run.seed": seed})) for seed in (1, 2))


@pytest.mark.parametrize("first", [OLD, NEW])
def test_of_two_supervisors_the_scenario_of_the_one_that_waits_counts(first):
    """The last one may still write its report; nothing says in which order words arrive."""
    matchmaker = Matchmaker("/platoon/scenario")
    assert matchmaker.met() is None
    matchmaker.take_scenario(first)
    matchmaker.take_status(status("old", OLD, RunPhase.FINISHED))
    assert matchmaker.met() is None
    matchmaker.take_status(status("new", NEW))
    matchmaker.take_scenario(OLD)
    if first == OLD:
        assert matchmaker.met() is None
    matchmaker.take_scenario(NEW)
    met = matchmaker.met()
    assert met is not None
    assert (met.run, met.scenario.run.seed) == ("new", 2)


def test_a_run_that_has_begun_without_the_host_is_none_to_join():
    matchmaker = Matchmaker("/platoon/scenario")
    matchmaker.take_scenario(NEW)
    matchmaker.take_status(status("new", NEW))
    matchmaker.take_status(status("new", NEW, RunPhase.MATCHING))
    assert matchmaker.met() is None


def test_nonsense_is_passed_over():
    matchmaker = Matchmaker("/platoon/scenario")
    for text in ("", "{}", "[" * 10**5):
        matchmaker.take_status(text)
        matchmaker.take_scenario(text)
    for k in range(10):
        matchmaker.take_scenario(f"{k}")
    assert matchmaker.met() is None


def test_a_scenario_that_is_none_is_said_in_one_line():
    matchmaker = Matchmaker("/platoon/scenario")
    matchmaker.take_scenario("nonsense")
    matchmaker.take_status(status("new", "nonsense"))
    with pytest.raises(UserError, match=r"^/platoon/scenario: holds no parameters"):
        matchmaker.met()


def test_a_host_runs_what_the_supervisor_gives_to_its_name():
    assert own_host(Wishes("east", "/platoon"), scenario()).vehicles == (1, 2)
    with pytest.raises(UserError, match=r"no host north, it waits for: host east \(vehicles 1-2\)"):
        own_host(Wishes("north", "/platoon"), scenario())


def test_a_host_that_was_started_for_other_vehicles_says_so():
    east = scenario().remote_hosts[0]
    assert objection(Wishes("east", "/platoon", (1, 2)), east, scenario()) == ""
    line = objection(Wishes("east", "/platoon", (3,)), east, scenario())
    assert "started for the vehicles 3, but run.remote_hosts gives it 1-2" in line


def test_code_that_a_scenario_names_is_run_only_where_that_was_allowed():
    made = scenario(**{"controller.law": "os:getcwd"})
    for host in made.remote_hosts:
        line = objection(Wishes(host.name, "/platoon"), host, made)
        assert "controller.law = os:getcwd, which comes over the network" in line
        allowed = Wishes(host.name, "/platoon", parts=Path("parts"), own_code=True)
        assert objection(allowed, host, made) == ""
