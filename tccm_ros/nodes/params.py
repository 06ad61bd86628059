"""ROS parameters from the configuration classes: declared once and validated by the same rules.

A parameter is named ``group.key`` as in the YAML files. Optional values (None) in the configuration
are empty arrays here, because ROS parameters have no null.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from typing import Any, get_args

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from tccm_ros.config import Config, Parameter, parameters
from tccm_ros.config.reader import REMOVED, validated
from tccm_ros.config.reference import choices_of, range_text
from tccm_ros.errors import ConfigError, TccmError, suggest

INT64_MAX = 2**63 - 1

ARRAYS = (RosParameter.Type.DOUBLE_ARRAY, RosParameter.Type.STRING_ARRAY)

COMMON_GROUPS = frozenset({"frames", "rig", "scan", "qos"})
MAPPING_GROUPS = COMMON_GROUPS | {"sensors", "localisation", "views", "surfaces", "objects", "save"}
GROUPS = {
    "tccm": MAPPING_GROUPS | {"cycle", "map", "planes", "center_core", "markers"},
    "slam": MAPPING_GROUPS
    | {"signs", "lines", "matching", "odometry", "walls", "graph", "loops", "labels", "tf"}
    | {"scan_here"},
    "approach": COMMON_GROUPS | {"approach"},
    "view": COMMON_GROUPS | {"sensors", "localisation"},
}
"""Parameter groups of each node, by `Stream.processor`; parameters without a group belong to
all."""


def ros_type(parameter: Parameter) -> RosParameter.Type:
    """Return the ROS type of a configuration parameter."""
    kinds = {bool: "BOOL", int: "INTEGER", float: "DOUBLE", str: "STRING"}
    if parameter.type in kinds:
        return RosParameter.Type[kinds[parameter.type]]
    if parameter.type == tuple[str, ...]:
        return RosParameter.Type.STRING_ARRAY
    if all(isinstance(argument, str) for argument in get_args(parameter.type)):
        return RosParameter.Type.STRING
    return RosParameter.Type.DOUBLE_ARRAY


def ros_value(parameter: Parameter, value: Any) -> Any:
    """Return a configuration value as a ROS parameter value."""
    if ros_type(parameter) is RosParameter.Type.STRING_ARRAY:
        return list(value)
    if ros_type(parameter) is RosParameter.Type.DOUBLE_ARRAY:
        return [] if value is None else [float(number) for number in value]
    return value


def _config_value(parameter: Parameter, value: Any) -> Any:
    if ros_type(parameter) is RosParameter.Type.STRING_ARRAY:
        return tuple(map(str, value or ()))
    if ros_type(parameter) is RosParameter.Type.DOUBLE_ARRAY:
        return None if value is None or len(value) == 0 else tuple(value)
    return value


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    choices = choices_of(parameter)
    allowed = f"one of: {', '.join(choices)}" if choices else ""
    descriptor = ParameterDescriptor(
        name=parameter.name,
        type=ros_type(parameter).value,
        description=f"{parameter.meaning}{unit}" + (f"; {allowed}" if allowed else ""),
        additional_constraints=allowed,
        read_only=parameter.read_only,
        # rclpy takes an empty list for a byte array; `check` validates the type instead.
        dynamic_typing=ros_type(parameter) in ARRAYS,
    )
    limits = (parameter.minimum, parameter.maximum)
    if limits == (None, None):
        return descriptor
    if parameter.type is float:
        low, high = (
            float(default if x is None else x) for x, default in zip(limits, (-math.inf, math.inf))
        )
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif parameter.type is int:
        low, high = (
            int(default if x is None else x) for x, default in zip(limits, (-INT64_MAX, INT64_MAX))
        )
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
    return descriptor


def declare_config(node: Node, groups: Collection[str] | None = None) -> Config:
    """Declare parameters on a node and return the resulting configuration.

    Parameters
    ----------
    node
        Node to declare them on; overrides come from its command line and parameter files.
    groups
        Groups to declare beside the parameters without a group; all if None.

    Raises
    ------
    ConfigError
        If a value has the wrong type or is out of range; the message gives the correct form.
    """
    defaults = Config().model_dump()
    values = {}
    for parameter in parameters():
        group = parameter.name.rpartition(".")[0].partition(".")[0]
        if groups is not None and group and group not in groups:
            continue
        default = _lookup(defaults, parameter.name)
        values[parameter.name] = _config_value(parameter, _declare(node, parameter, default))
    warn_of_unknown(node, [parameter.name for parameter in parameters()])
    return _changed(Config(), values)


def warn_of_unknown(node: Node, known: Collection[str]) -> None:
    """Warn of parameter overrides that are removed or unknown, such as misspelt names.

    Parameters
    ----------
    node
        The node; overrides come from its command line and parameter files.
    known
        Names of all parameters, including those that this node does not declare.
    """
    for name in node._parameter_overrides:
        if name in REMOVED:
            node.get_logger().warning(f"parameter {name} is ignored: {REMOVED[name]}")
        elif (
            not node.has_parameter(name)
            and name not in known
            and not name.startswith("qos_overrides.")
        ):
            hint = suggest(name, known)
            node.get_logger().warning(
                f"parameter {name} is set but there is none of this name{hint}"
            )


def _declare(node: Node, parameter: Parameter, default: Any) -> Any:
    if node.has_parameter(parameter.name):  # declared before an earlier configure failed
        return node.get_parameter(parameter.name).value
    try:
        return node.declare_parameter(
            parameter.name, ros_value(parameter, default), _descriptor(parameter)
        ).value
    except InvalidParameterTypeException:
        found = node._parameter_overrides[parameter.name].value
        advice = type_advice(ros_type(parameter), found)
        raise ConfigError(f"parameter {parameter.name}: {advice}") from None
    except InvalidParameterValueException:
        found = node._parameter_overrides[parameter.name].value
        raise ConfigError(
            f"parameter {parameter.name}: {found!r} is out of range; expected "
            f"{range_text(parameter)} {parameter.unit}".rstrip()
        ) from None


def type_advice(wanted: RosParameter.Type, found: Any) -> str:
    """Return advice for a value of the wrong type."""
    if wanted is RosParameter.Type.DOUBLE and isinstance(found, int):
        return f"a float is expected, found the integer {found}; write {found}.0"
    if wanted is RosParameter.Type.DOUBLE_ARRAY:
        return f"a list of floats is expected (write 1.0, not 1), found {found!r}"
    return f"{wanted.name.lower()} is expected, found {found!r}"


def _lookup(tree: dict[str, Any], dotted: str) -> Any:
    value: Any = tree
    for part in dotted.split("."):
        value = value[part]
    return value


def _changed(config: Config, values: dict[str, Any]) -> Config:
    """Return the configuration with some values changed, or raise ConfigError."""
    tree = config.model_dump()
    for name, value in values.items():
        path, _, key = name.rpartition(".")
        (_lookup(tree, path) if path else tree)[key] = value
    return validated(tree, "parameter")


def follow_changes(node: Node, config: Config) -> None:
    """Apply parameter changes at run time to the configuration object that the processors hold.

    A set of changes is validated as a whole before it is applied; rclpy itself refuses changes of
    read-only parameters.
    """
    known = {parameter.name: parameter for parameter in parameters()}

    def check(changes: Iterable[RosParameter]) -> SetParametersResult:
        try:
            _changed(config, _known_values(known, changes))
        except TccmError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def apply(changes: Iterable[RosParameter]) -> None:
        for name, value in _known_values(known, changes).items():
            *path, key = name.split(".")
            group: Any = config
            for part in path:
                group = getattr(group, part)
            setattr(group, key, value)

    node.add_on_set_parameters_callback(check)
    node.add_post_set_parameters_callback(apply)


def _known_values(known: dict[str, Parameter], changes: Iterable[RosParameter]) -> dict[str, Any]:
    return {c.name: _config_value(known[c.name], c.value) for c in changes if c.name in known}
