"""The configuration: every parameter with its unit, range and meaning.

One set of classes serves the command line (``--set group.key=value``), the YAML files and the
nodes' ROS parameters (``group.key``). A parameter is declared once, by `param`; the shipped YAML,
the nodes' declarations and the README's table are made from it and a test holds them together.
"""

from tccm_ros.config.configuration import Config, parameters
from tccm_ros.config.mapping import CenterCore, Cycle, Map, Objects, Planes
from tccm_ros.config.node import Markers, Qos, Save, Tf
from tccm_ros.config.parameter import Group, Parameter, param
from tccm_ros.config.sensors import Frames, Rig, ScanFilter
from tccm_ros.config.slam import Graph, Lines, Loops, Matching, Odometry, Walls
from tccm_ros.config.surfaces import Labels, Surfaces, Views

__all__ = [
    "CenterCore",
    "Config",
    "Cycle",
    "Frames",
    "Graph",
    "Group",
    "Labels",
    "Lines",
    "Loops",
    "Map",
    "Markers",
    "Matching",
    "Objects",
    "Odometry",
    "Parameter",
    "Planes",
    "Qos",
    "Rig",
    "Save",
    "ScanFilter",
    "Surfaces",
    "Tf",
    "Views",
    "Walls",
    "param",
    "parameters",
]
