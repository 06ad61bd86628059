"""The configuration as text: the shipped YAML file."""

from collections.abc import Iterator
from typing import Any, get_args

import yaml

from tccm_ros.config import Parameter, parameters

HEADER = """\
# Every parameter of tccm_ros with its default. Made by `tccm parameters`; each line: unit, range,
# meaning. Use it with `tccm replay --config FILE` or `ros2 run tccm_ros tccm_node --ros-args
# --params-file FILE`. Lines that are commented out are empty by default.
/**:
  ros__parameters:
"""


def as_yaml() -> str:
    """Return the defaults as a ROS parameter file, a comment on each line."""
    return HEADER + "".join(_yaml_lines())


def _yaml_lines() -> Iterator[str]:
    group = ""
    for parameter in parameters():
        path, _, key = parameter.name.rpartition(".")
        if path and path != group:
            yield f"    {path}:\n"
            group = path
        indent = "      " if path else "    "
        hidden = "# " if parameter.default is None else ""
        yield f"{indent}{hidden}{key}: {value_text(parameter.default)}  # {_notes(parameter)}\n"


def value_text(value: Any) -> str:
    """Return a default as YAML on one line."""
    if value is None:
        return "[]"
    value = list(value) if isinstance(value, tuple) else value
    text = yaml.safe_dump(value, default_flow_style=True, width=1000)
    return text.removesuffix("\n").removesuffix("\n...").strip()


def choices_of(parameter: Parameter) -> list[str]:
    """Return the allowed words of a parameter; none if it has no list of words."""
    return [choice for choice in get_args(parameter.type) if isinstance(choice, str)]


def range_text(parameter: Parameter) -> str:
    """Return the range or the choices of a parameter; empty where it has none."""
    choices = choices_of(parameter)
    if choices:
        return " or ".join(choices)
    low, high = parameter.minimum, parameter.maximum
    if low is None and high is None:
        return ""
    above = ">" if parameter.excludes_minimum else ">="
    if high is None:
        return f"{above} {low:g}"
    if low is None:
        return f"<= {high:g}"
    return f"> {low:g}, <= {high:g}" if parameter.excludes_minimum else f"{low:g} to {high:g}"


def _notes(parameter: Parameter) -> str:
    parts = [parameter.unit, range_text(parameter), parameter.meaning]
    fixed = " (fixed at start)" if parameter.read_only else ""
    return "; ".join(part for part in parts if part) + fixed
