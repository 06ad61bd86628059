"""The configuration: all parameters with their units, ranges and meanings.

The same classes serve the command line (``--set group.key=value``), the YAML files and the ROS
parameters of the nodes (``group.key``). A parameter is declared once, by `param`; the shipped YAML
file, the declarations of the nodes and the table of the reference are made from that.
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
