"""Start a platoon: ros2 launch cacc_platoon platoon.launch.py scenario:=FILE [run_folder:=DIR].

The supervisor starts the hosts of all vehicles, records, judges and ends by itself, and `ros2
launch` ends with its exit code. With spawn:=false it waits for nodes that are started manually
with `ros2 run cacc_platoon {leader,vehicle,noise_relay}`.
"""

import asyncio
import json
import sys

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

SERVICE = "LaunchService.run_async"
DEFAULT = PathJoinSubstitution([FindPackageShare("cacc_platoon"), "config", "paper_a.yaml"])
ARGUMENTS = [
    DeclareLaunchArgument("scenario", default_value=DEFAULT, description="Scenario file"),
    DeclareLaunchArgument(
        "run_folder",
        default_value="",
        description="Run folder, must not exist; empty for runs/<scenario>-<UTC time>",
    ),
    DeclareLaunchArgument(
        "spawn",
        default_value="true",
        choices=["true", "false"],
        description="Whether the supervisor starts the nodes of all vehicles itself",
    ),
    DeclareLaunchArgument(
        "seed", default_value="", description="Seed of all noise; empty for the scenario's"
    ),
    DeclareLaunchArgument(
        "duration", default_value="", description="Simulated time [s]; empty for the scenario's"
    ),
    DeclareLaunchArgument(
        "record",
        default_value="",
        description="What is published and recorded too: command, spacing_error or both, "
        "[command, spacing_error]",
    ),
    DeclareLaunchArgument(
        "set",
        default_value="",
        description="Parameters to replace, KEY=VALUE or a list [KEY=VALUE, ...], such as "
        "[controller.time_headway=0.8, vehicle_5.controller.k_v=0.7]",
    ),
]


def generate_launch_description():
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=supervisor)])


def supervisor(context):
    """Return the supervisor's process, given what the arguments say."""

    def given(name):
        return LaunchConfiguration(name).perform(context).strip()

    settings = [f"run.spawn={given('spawn')}"]
    if folder := given("run_folder"):
        settings.append(f"record.directory={json.dumps(folder)}")
    settings += [f"run.{name}={given(name)}" for name in ("seed", "duration") if given(name)]
    extras = given("record").strip("[]").split(",")
    settings += [f"record.{name.strip()}=true" for name in extras if name.strip()]
    if given("set"):
        settings.append(given("set"))
    return [
        Node(
            package="cacc_platoon",
            executable="supervisor",
            output="screen",
            arguments=[part for setting in settings for part in ("--set", setting)],
            ros_arguments=["--params-file", given("scenario")],
            sigterm_timeout="15",  # closing the parts and merging them takes its time
            sigkill_timeout="15",
            on_exit=end,
        )
    ]


def end(event, context):
    """End launch, once all that it has started has ended, with the supervisor's exit code.

    Launch knows of no exit codes but 0 and 1: another one takes the place of its own at the very
    end, when its service is done.
    """
    code = event.returncode if event.returncode >= 0 else 128 - event.returncode
    if code:
        tasks = {getattr(t.get_coro(), "__qualname__", ""): t for t in asyncio.all_tasks()}
        if SERVICE not in tasks:
            raise RuntimeError(f"the supervisor has ended with exit code {code}")
        tasks[SERVICE].add_done_callback(lambda _: sys.exit(code))
    return [Shutdown(reason="the run has ended")]
