"""Both nodes with one parameter file, for users of a full ROS installation."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Start tccm_node and slam_node."""
    default = PathJoinSubstitution([FindPackageShare("tccm_ros"), "config", "tccm.yaml"])
    settings = {
        "parameters": [
            LaunchConfiguration("params_file"),
            {"use_sim_time": LaunchConfiguration("use_sim_time")},
        ],
        "namespace": LaunchConfiguration("namespace"),
        "remappings": [
            ("tilt_scan", LaunchConfiguration("tilt_scan")),
            ("scan", LaunchConfiguration("scan")),
        ],
        "output": "screen",
    }
    return LaunchDescription(
        [
            DeclareLaunchArgument("params_file", default_value=default),
            DeclareLaunchArgument("use_sim_time", default_value="false"),
            DeclareLaunchArgument("namespace", default_value=""),
            DeclareLaunchArgument("tilt_scan", default_value="tilt_scan"),
            DeclareLaunchArgument("scan", default_value="scan"),
            Node(package="tccm_ros", executable="tccm_node", name="tccm", **settings),
            Node(package="tccm_ros", executable="slam_node", name="surface_slam", **settings),
        ]
    )
