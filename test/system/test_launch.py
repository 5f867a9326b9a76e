"""The launch file starts the supervisor with what its arguments say, and ends as it does."""

import argparse
import asyncio
import json
import os
import runpy
import signal
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from cacc_platoon.cli.host import add_arguments
from cacc_platoon.cli.supervisor import settings_of
from cacc_platoon.dds.domain import own_domain
from cacc_platoon.scenario.file import load_scenario

LAUNCH_FILE = Path(__file__).parents[2] / "launch" / "platoon.launch.py"
HOSTS_FILE = LAUNCH_FILE.with_name("platoon_hosts.launch.py")
PAPER_A = Path(__file__).parents[2] / "config" / "paper_a.yaml"


class Recorded:
    """Stands in for any launch class: keeps what it was made with."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self.arguments, self.options = arguments, options

    def perform(self, context: dict[str, str]) -> str:
        """Return the value of a LaunchConfiguration."""
        return context[self.arguments[0]]


def stand_in(name: str, *classes: str) -> ModuleType:
    module = ModuleType(name)
    for cls in classes:
        setattr(module, cls, type(cls, (Recorded,), {}))
    return module


@pytest.fixture
def launch(monkeypatch):
    """Put stand-ins in place of launch, which need not be installed."""
    for module in (
        stand_in("launch", "LaunchDescription"),
        stand_in("launch.actions", "DeclareLaunchArgument", "OpaqueFunction", "Shutdown"),
        stand_in("launch.substitutions", "LaunchConfiguration", "PathJoinSubstitution"),
        stand_in("launch_ros"),
        stand_in("launch_ros.actions", "Node"),
        stand_in("launch_ros.substitutions", "FindPackageShare"),
    ):
        monkeypatch.setitem(sys.modules, module.__name__, module)


@pytest.fixture
def launch_file(launch):
    """Return the launch file's names."""
    return runpy.run_path(str(LAUNCH_FILE))


@pytest.fixture
def description(launch_file):
    return launch_file["generate_launch_description"]().arguments[0]


def node_of(description, **given: str) -> Any:
    """Return the process that is started when some arguments are given."""
    *arguments, start = description
    values = {one.arguments[0]: one.options["default_value"] for one in arguments}
    assert given.keys() <= values.keys()
    [node] = start.options["function"]({**values, "scenario": "my.yaml", **given})
    return node


def test_the_supervisor_gets_the_arguments(description):
    node = node_of(
        description,
        run_folder="runs/my run",
        spawn="false",
        seed="7",
        duration="20",
        record="[command, spacing_error]",
        set="[v2v.rho=6, vehicle.tau=[0.5, 0.4]]",
    )
    assert (node.options["package"], node.options["executable"]) == ("cacc_platoon", "supervisor")
    assert node.options["ros_arguments"] == ["--params-file", "my.yaml"]
    given = node.options["arguments"]
    assert set(given[::2]) == {"--set"}
    assert [setting for text in given[1::2] for setting in settings_of(text)] == [
        "run.spawn=false",
        'record.directory="runs/my run"',
        "run.seed=7",
        "run.duration=20",
        "record.command=true",
        "record.spacing_error=true",
        "v2v.rho=6",
        "vehicle.tau=[0.5, 0.4]",
    ]
    settings = [s for text in given[1::2] for s in settings_of(text) if "tau" not in s]
    scenario = load_scenario(PAPER_A, settings)
    assert (scenario.run.seed, scenario.run.duration, scenario.run.spawn) == (7, 20.0, False)
    assert scenario.record.directory == "runs/my run"
    assert scenario.record.command


def test_what_is_not_given_is_left_to_the_scenario(description):
    assert node_of(description).options["arguments"] == ["--set", "run.spawn=true"]


def test_every_argument_has_a_default_and_says_what_it_is(description):
    arguments = {argument.arguments[0]: argument.options for argument in description[:-1]}
    assert list(arguments) == [
        *("scenario", "run_folder", "spawn", "seed", "duration", "record", "set")
    ]
    for options in arguments.values():
        assert "default_value" in options
        assert options["description"]
    assert arguments["spawn"]["choices"] == ["true", "false"]
    path = arguments["scenario"]["default_value"].arguments[0]
    assert path[1:] == ["config", "paper_a.yaml"]


@pytest.mark.parametrize(
    ("given", "hosts"),
    [
        ({"host": "east"}, [["east"]]),
        ({"host": "east, west", "vehicles": "1-6"}, [["east"], ["west"]]),
        ({"host": "east", "part": "my parts", "own_code": "true"}, [["east"]]),
    ],
)
def test_hosts_get_the_arguments(launch, given, hosts):
    """As the command takes them."""
    *arguments, start = runpy.run_path(str(HOSTS_FILE))["generate_launch_description"]().arguments[
        0
    ]
    values = {one.arguments[0]: one.options.get("default_value", "") for one in arguments}
    assert given.keys() <= values.keys()
    assert all(one.options["description"] for one in arguments)
    nodes = start.options["function"]({**values, **given})
    assert [node.options["executable"] for node in nodes] == ["host"] * len(hosts)
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    for node, (name,) in zip(nodes, hosts, strict=True):
        options = parser.parse_args(node.options["arguments"])
        assert (options.name, options.namespace) == (name, "/platoon")
        assert (options.vehicles or "") == given.get("vehicles", "")
        assert options.part == (Path(given["part"]) if "part" in given else None)
        assert (options.timeout, options.own_code) == (300.0, "own_code" in given)


class LaunchService:
    """What matters of launch's own: a coroutine of that name, and its events in other tasks."""

    async def run_async(self, end: Any, code: int) -> int:
        """Handle the exit of the supervisor, and end only later."""
        self.ended = False

        async def handle_event() -> Any:
            return end(SimpleNamespace(returncode=code), None)

        [action] = await asyncio.get_running_loop().create_task(handle_event())
        assert type(action).__name__ == "Shutdown"
        await asyncio.sleep(0)  # whatever else was launched is shut down
        self.ended = True
        return 0


@pytest.mark.parametrize(("code", "passed_on"), [(1, 1), (2, 2), (3, 3), (130, 130), (-9, 137)])
def test_launch_ends_with_the_exit_code_of_the_supervisor(launch_file, code, passed_on):
    """At the very end, when all that was launched has been shut down."""
    service = LaunchService()
    with asyncio.Runner() as runner, pytest.raises(SystemExit) as end:
        runner.run(service.run_async(launch_file["end"], code))
    assert end.value.code == passed_on
    assert service.ended


def test_launch_ends_well_when_the_run_does(launch_file):
    with asyncio.Runner() as runner:
        assert runner.run(LaunchService().run_async(launch_file["end"], 0)) == 0


def test_another_launch_still_fails_when_the_run_does(launch_file):
    """Where its service has another name an error is all that it is told."""

    async def service():
        return launch_file["end"](SimpleNamespace(returncode=2), None)

    with asyncio.Runner() as runner, pytest.raises(RuntimeError, match="ended with exit code 2"):
        runner.run(service())


def supervisor(*arguments: object, domain: int = 0) -> subprocess.Popen[str]:
    """Start what the launch file starts."""
    command = [sys.executable, "-c", "from cacc_platoon.cli.supervisor import main; exit(main())"]
    return subprocess.Popen(
        [*command, *map(str, arguments)],
        env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--params-file", "nowhere.yaml"], "nowhere.yaml: cannot be read: No such file"),
        (
            ["--params-file", PAPER_A, "-p", "run.duration:=-3.0"],
            "run.duration = -3.0 s must be > 0",
        ),
    ],
)
def test_what_is_wrong_is_said_in_one_line_of_ours(arguments, line):
    process = supervisor("--ros-args", *arguments)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 2
    [own] = errors.splitlines()
    assert line in own


def test_settings_reach_a_run_and_its_progress_is_logged(tmp_path, nothing_left):
    """Also those of one vehicle, which are no parameters of the supervisor; until Ctrl-C."""
    settings = [
        f"record.directory={json.dumps(str(tmp_path / 'run'))}",
        "[run.duration=200, run.real_time_factor=1, platoon.followers=2]",
        "vehicle_2.controller.k_v=0.7",
    ]
    given = [part for text in settings for part in ("--set", text)]
    lines = []
    with own_domain() as domain:
        process = supervisor(*given, "--ros-args", "--params-file", PAPER_A, domain=domain)
        assert process.stderr
        for line in process.stderr:
            lines.append(line)
            if "real-time factor" in line:
                process.send_signal(signal.SIGINT)
                break
        _, rest = process.communicate(timeout=120)
    assert process.returncode == 130, rest
    assert any("[INFO]" in line and "[supervisor]: starting nodes" in line for line in lines)
    assert ", sample " in lines[-1]
    scenario = load_scenario(tmp_path / "run" / "scenario.yaml")
    assert scenario.run.duration == 200.0
    assert scenario.overrides == {2: {"controller.k_v": 0.7}}
    assert json.loads((tmp_path / "run" / "run.json").read_text())["status"] == "interrupted"
