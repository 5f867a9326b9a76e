"""Start hosts: ros2 launch cacc_platoon platoon_hosts.launch.py host:=east [vehicles:=1-6].

The supervisor, on this machine or another, waits for them by their names (run.remote_hosts) and
says which vehicles each runs; with vehicles:=1-6 a host refuses to run others. Several names have
commas between them. Launch ends when all hosts have ended.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = [
    DeclareLaunchArgument("host", description="Name of the host, or several: east,west"),
    DeclareLaunchArgument(
        "vehicles",
        default_value="",
        description="Its vehicles, such as 1-6; empty for what the supervisor says",
    ),
    DeclareLaunchArgument(
        "namespace", default_value="/platoon", description="Namespace of the platoon"
    ),
    DeclareLaunchArgument(
        "part",
        default_value="",
        description="Folder in which the hosts record, and keep it; empty for one in runs/ that "
        "goes when the supervisor has everything",
    ),
    DeclareLaunchArgument(
        "timeout", default_value="300", description="How long to wait for a supervisor [s]"
    ),
    DeclareLaunchArgument(
        "own_code",
        default_value="false",
        choices=["true", "false"],
        description="Whether the supervisor's scenario may name code of this machine",
    ),
]


def generate_launch_description():
    return LaunchDescription([*ARGUMENTS, OpaqueFunction(function=hosts)])


def hosts(context):
    """Return a process for each host, given what the arguments say."""

    def given(name):
        return LaunchConfiguration(name).perform(context).strip()

    options = [("--vehicles", given("vehicles")), ("--namespace", given("namespace"))]
    options += [("--part", given("part")), ("--timeout", given("timeout"))]
    arguments = [word for option, value in options if value for word in (option, value)]
    arguments += ["--own-code"] if given("own_code") == "true" else []
    return [
        Node(
            package="cacc_platoon",
            executable="host",
            output="screen",
            arguments=[name.strip(), *arguments],
            sigterm_timeout="15",  # closing the part and giving it away takes its time
            sigkill_timeout="15",
        )
        for name in given("host").split(",")
    ]
