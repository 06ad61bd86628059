"""Both nodes with one parameter file, for users of a full ROS installation."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Start tccm_node and slam_node."""
    default = PathJoinSubstitution([FindPackageShare("tccm_ros"), "config", "tccm.yaml"])
    arguments = {
        "params_file": (default, "YAML file with parameters of both nodes"),
        "use_sim_time": ("false", "whether time is that of /clock"),
        "namespace": ("", "of both nodes and their topics"),
        "tilt_scan": ("tilt_scan", "topic of the tilting laser, sensor_msgs/LaserScan"),
        "scan": ("scan", "topic of the level laser, sensor_msgs/LaserScan"),
        "odometry": ("odom", "topic of the odometry, nav_msgs/Odometry"),
        "joints": ("joint_states", "topic of the joints, sensor_msgs/JointState"),
        "model": ("robot_description", "topic of the robot's URDF, std_msgs/String"),
    }
    settings = {
        "parameters": [
            LaunchConfiguration("params_file"),
            {"use_sim_time": LaunchConfiguration("use_sim_time")},
        ],
        "namespace": LaunchConfiguration("namespace"),
        "remappings": [
            ("tilt_scan", LaunchConfiguration("tilt_scan")),
            ("scan", LaunchConfiguration("scan")),
            ("odom", LaunchConfiguration("odometry")),
            ("joint_states", LaunchConfiguration("joints")),
            ("robot_description", LaunchConfiguration("model")),
        ],
        "output": "screen",
        # The last solution of a long drive takes a while; the one before is saved by then.
        "sigterm_timeout": "30",
        "sigkill_timeout": "15",
    }
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=value, description=meaning)
                for name, (value, meaning) in arguments.items()
            ),
            Node(package="tccm_ros", executable="tccm_node", name="tccm", **settings),
            Node(package="tccm_ros", executable="slam_node", name="surface_slam", **settings),
        ]
    )
