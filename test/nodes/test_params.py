"""ROS parameters agree with the configuration, and bad ones are explained."""

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from tccm_ros.config import Config, parameters
from tccm_ros.errors import ConfigError
from tccm_ros.nodes.params import declare_config, follow_changes, ros_type


def make(ros, **overrides):
    values = [RosParameter(k.replace("__", "."), value=v) for k, v in overrides.items()]
    return ros.add(Node("probe", context=ros.context, parameter_overrides=values))


def test_every_parameter_is_declared_with_its_meaning_and_range(ros):
    node = make(ros)
    assert declare_config(node) == Config()
    for parameter in parameters():
        descriptor = node.describe_parameter(parameter.name)
        assert parameter.meaning in descriptor.description
        assert descriptor.read_only == parameter.read_only
        assert descriptor.type == ros_type(parameter).value or descriptor.dynamic_typing
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        if parameter.minimum is not None:
            assert ranges[0].from_value == parameter.minimum
        if parameter.maximum is not None:
            assert ranges[0].to_value == parameter.maximum


@pytest.mark.parametrize(
    ("name", "value", "advice"),
    [
        ("map.cell_size", 1, "write 1.0"),
        ("map.cell_size", 5.0, "outside"),
        ("map.region", [1.0, 2.0], "map.region"),
        ("planes.source", "elsewhere", "'map' or 'part'"),
        ("map.window_cycles", "ten", "integer"),
    ],
)
def test_a_bad_value_at_start_says_what_to_write(ros, name, value, advice):
    node = make(ros, **{name.replace(".", "__"): value})
    with pytest.raises(ConfigError, match=advice):
        declare_config(node)


def test_live_changes_are_checked_and_applied(ros):
    node = make(ros)
    config = declare_config(node)
    follow_changes(node, config)

    def change(name, value):
        return node.set_parameters([RosParameter(name, value=value)])[0]

    assert change("planes.height_threshold", 0.02).successful
    assert config.planes.height_threshold == 0.02
    assert change("map.region", [0.0, 1.0, 0.0, 1.0, 0.0, 2.0]).successful
    assert config.map.region == (0.0, 1.0, 0.0, 1.0, 0.0, 2.0)
    assert change("map.region", []).successful
    assert config.map.region is None
    for name, value in [
        ("planes.height_threshold", 2.0),
        ("planes.height_threshold", 1),
        ("planes.source", "elsewhere"),
        ("map.window_cycles", 3),
        ("map.region", [1.0]),
    ]:
        result = change(name, value)
        assert not result.successful
        assert result.reason
    assert config.planes.source == "map"
