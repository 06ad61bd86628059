"""All nodes with one parameter file, for users of a full ROS installation."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Start the two nodes, or their managed twins, and on request approach_node and view_node."""
    default = PathJoinSubstitution([FindPackageShare("tccm_ros"), "config", "tccm.yaml"])
    arguments = {
        "params_file": (default, "YAML file with parameters of all nodes"),
        "use_sim_time": ("false", "whether time is that of /clock"),
        "namespace": ("", "of all nodes and their topics"),
        "managed": ("false", "whether a lifecycle manager configures and activates the nodes"),
        "approach": ("false", "whether approach_node is started, which moves the base when asked"),
        "view": ("false", "whether view_node is started, which serves the live page"),
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
    managed = LaunchConfiguration("managed")
    plain, waiting = {"condition": UnlessCondition(managed)}, {"condition": IfCondition(managed)}
    approach = {"condition": IfCondition(LaunchConfiguration("approach"))}
    view = {"condition": IfCondition(LaunchConfiguration("view"))}
    executables = {
        "tccm_node": ("tccm", plain),
        "slam_node": ("surface_slam", plain),
        "managed_tccm_node": ("tccm", waiting),
        "managed_slam_node": ("surface_slam", waiting),
        "approach_node": ("approach", approach),
        "view_node": ("view", view),
    }
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=value, description=meaning)
                for name, (value, meaning) in arguments.items()
            ),
            *(
                Node(package="tccm_ros", executable=executable, name=name, **when, **settings)
                for executable, (name, when) in executables.items()
            ),
        ]
    )
