"""Start a platoon: ros2 launch cacc_platoon platoon.launch.py scenario:=FILE [run_folder:=DIR].

The supervisor starts the hosts of all vehicles, records and ends by itself. With spawn:=false it
waits for nodes that are started manually with `ros2 run cacc_platoon {leader,vehicle,noise_relay}`.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    default = PathJoinSubstitution([FindPackageShare("cacc_platoon"), "config", "paper_a.yaml"])
    arguments = [
        DeclareLaunchArgument("scenario", default_value=default, description="Scenario file"),
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
    ]
    supervisor = Node(
        package="cacc_platoon",
        executable="supervisor",
        output="screen",
        ros_arguments=[
            *("--params-file", LaunchConfiguration("scenario")),
            *("-p", ["record.directory:='", LaunchConfiguration("run_folder"), "'"]),
            *("-p", ["run.spawn:=", LaunchConfiguration("spawn")]),
        ],
        sigterm_timeout="15",  # closing the parts and merging them takes its time
        sigkill_timeout="15",
        on_exit=Shutdown(reason="the run has ended"),
    )
    return LaunchDescription([*arguments, supervisor])
