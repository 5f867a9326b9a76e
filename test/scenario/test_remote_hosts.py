"""Hosts on other machines: what names them and their vehicles, and what is refused in one line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario, parse_scenario
from cacc_platoon.scenario.parameter import ScenarioError
from cacc_platoon.scenario.remote_hosts import host_commands, read_vehicles, vehicles_text


def scenario(remote_hosts=(), **more):
    return Scenario.from_values(
        {"platoon.followers": 6, "run.remote_hosts": remote_hosts, **more}, source="my.yaml"
    )


def test_hosts_have_the_vehicles_that_are_named():
    made = scenario(("east=1-3", "west = 0, 5"))
    assert made.remote_hosts == (("east", (1, 2, 3)), ("west", (0, 5)))
    assert str(made.remote_hosts[0]) == "host east (vehicles 1-3)"


def test_a_written_scenario_has_the_same_hosts():
    made = scenario(("east=1-3",), **{"run.host_commands": ('east=ssh me@east "nice -n 5"',)})
    read = parse_scenario(format_scenario(made), "again")
    assert read.remote_hosts == made.remote_hosts
    assert host_commands(read.run) == {"east": ["ssh", "me@east", "nice -n 5"]}


@given(st.sets(st.integers(0, 900), min_size=1))
def test_vehicles_are_written_as_they_are_read(vehicles):
    assert read_vehicles(vehicles_text(sorted(vehicles))) == tuple(sorted(vehicles))


@pytest.mark.parametrize(
    ("hosts", "words"),
    [
        (("east",), "must be NAME=VEHICLES such as east=1-6"),
        (("east=",), "'' is neither a vehicle nor a range"),
        (("east=3-1",), "'3-1' is no range of vehicles"),
        (("east=1,1",), "a vehicle is named twice"),
        (("east=1-99999",), "is neither a vehicle nor a range"),
        (("east=7",), "has vehicle_7, which is not there"),
        (("east=1-2", "west=2-3"), "has vehicle_2, which host east has already"),
        (("east=1", "east=2"), "is the second of the name east"),
        (("2=1",), "must begin with a name of letters"),
        (("ea__st=1",), "must begin with a name of letters"),
        (("ea/st=1",), "must begin with a name of letters"),
        (("supervisor=1",), "must begin with a name of letters"),
        (("e" * 51 + "=1",), "must begin with a name of letters"),
    ],
)
def test_hosts_that_cannot_be_are_refused_in_one_line(hosts, words):
    with pytest.raises(ScenarioError) as error:
        scenario(hosts)
    line = str(error.value)
    assert line.startswith("my.yaml: run.remote_hosts = ")
    assert words in line
    assert "\n" not in line


def test_a_node_is_started_by_its_host_or_by_itself():
    with pytest.raises(ScenarioError, match=r"run.manual_nodes = .* is a node of host east"):
        scenario(("east=1-3",), **{"run.manual_nodes": ("vehicle_2/vehicle",)})


@pytest.mark.parametrize(
    ("commands", "words"),
    [
        (("east=",), "must be NAME=COMMAND"),
        (("ssh user@east",), "must be NAME=COMMAND"),
        (("east=ssh 'user",), "cannot be split into words"),
        (("north=ssh north",), "is of a host north that run.remote_hosts has not"),
        (("east=ssh a", "east=ssh b"), "is the second of host east"),
    ],
)
def test_commands_that_start_no_host_are_refused_in_one_line(commands, words):
    with pytest.raises(ScenarioError, match=r"run.host_commands = .*") as error:
        scenario(("east=1-3",), **{"run.host_commands": commands})
    assert words in str(error.value)
