"""The configuration: all parameters with their units, ranges and meanings.

The same classes serve the command line (``--set group.key=value``), the YAML files and the ROS
parameters of the nodes (``group.key``). A parameter is declared once, by `param`; the shipped YAML
file, the declarations of the nodes and the table of the reference are made from that.
"""

from tccm_ros.config.configuration import Config, parameters
from tccm_ros.config.parameter import Parameter
from tccm_ros.config.sensors import RigConfig

__all__ = ["Config", "Parameter", "RigConfig", "parameters"]
