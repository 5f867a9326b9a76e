"""The launch file starts the supervisor with what its arguments say."""

import runpy
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

LAUNCH_FILE = Path(__file__).parents[2] / "launch" / "platoon.launch.py"


class Recorded:
    """Stands in for any launch class: keeps what it was made with."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self.arguments, self.options = arguments, options


def stand_in(name: str, *classes: str) -> ModuleType:
    module = ModuleType(name)
    for cls in classes:
        setattr(module, cls, type(cls, (Recorded,), {}))
    return module


@pytest.fixture
def description(monkeypatch):
    """Return the launch description, made of stand-ins: launch need not be installed."""
    for module in (
        stand_in("launch", "LaunchDescription"),
        stand_in("launch.actions", "DeclareLaunchArgument", "Shutdown"),
        stand_in("launch.substitutions", "LaunchConfiguration", "PathJoinSubstitution"),
        stand_in("launch_ros"),
        stand_in("launch_ros.actions", "Node"),
        stand_in("launch_ros.substitutions", "FindPackageShare"),
    ):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    return runpy.run_path(str(LAUNCH_FILE))["generate_launch_description"]().arguments[0]


def resolve(value: Any, configuration: dict[str, str]) -> str:
    """Return a text as launch would put it together."""
    match value:
        case str():
            return value
        case list():
            return "".join(resolve(part, configuration) for part in value)
    return configuration[value.arguments[0]]


def test_the_supervisor_gets_the_arguments(description):
    *arguments, node = description
    names = [argument.arguments[0] for argument in arguments]
    assert names == ["scenario", "run_folder", "spawn"]
    assert (node.options["package"], node.options["executable"]) == ("cacc_platoon", "supervisor")
    given = {"scenario": "my.yaml", "run_folder": "runs/my run", "spawn": "false"}
    assert [resolve(part, given) for part in node.options["ros_arguments"]] == [
        *("--params-file", "my.yaml"),
        *("-p", "record.directory:='runs/my run'"),
        *("-p", "run.spawn:=false"),
    ]
    assert type(node.options["on_exit"]).__name__ == "Shutdown"


def test_every_argument_has_a_default_and_says_what_it_is(description):
    for argument in description[:-1]:
        assert "default_value" in argument.options
        assert argument.options["description"]
    assert description[2].options["choices"] == ["true", "false"]
    path = description[0].options["default_value"].arguments[0]
    assert path[1:] == ["config", "paper_a.yaml"]
