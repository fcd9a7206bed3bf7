"""Zenoh's router, `alight ros2` and RViz: ros2 launch alight.launch.py instance:=sim

Needs rmw_zenoh_cpp and rviz2. `sim` is the landing of `alight land`; without it the installed drone is shown.
"""

import os

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

SHOWN = os.path.join(os.path.dirname(os.path.abspath(__file__)), "alight.rviz")


def generate_launch_description():
    node = ["alight", "ros2", ["--instance=", LaunchConfiguration("instance")]]
    return LaunchDescription(
        [
            DeclareLaunchArgument("instance", default_value="drone", description="set of processes"),
            SetEnvironmentVariable("RMW_IMPLEMENTATION", "rmw_zenoh_cpp"),
            Node(package="rmw_zenoh_cpp", executable="rmw_zenohd"),
            ExecuteProcess(cmd=node, output="screen"),
            Node(package="rviz2", executable="rviz2", arguments=["-d", SHOWN]),
        ]
    )
