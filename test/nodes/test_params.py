"""ROS parameters agree with the configuration, and bad ones are explained."""

import pytest
from live_robot import START_NS, URDF, Listener, recording, slam, tccm
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from tccm_ros.config import Config, parameters
from tccm_ros.config.parameter import Group
from tccm_ros.errors import ConfigError
from tccm_ros.nodes.params import declare_config, follow_changes, ros_type
from tccm_ros.nodes.ros_types import has_tf2_msgs, message_class
from tccm_ros.records import RobotDescription
from tccm_ros.replay.processors import Pipeline


def make(ros, **overrides):
    values = [RosParameter(k.replace("__", "."), value=v) for k, v in overrides.items()]
    return ros.add(Node("probe", context=ros.context, parameter_overrides=values))


@pytest.mark.every_distro
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
        ("map.cell_size", 5.0, "is out of range; expected"),
        ("map.region", [1.0, 2.0], "map.region"),
        ("planes.source", "elsewhere", "'map' or 'part'"),
        ("map.window_cycles", "ten", "integer"),
    ],
)
def test_bad_value_at_start_is_an_error_with_valid_values(ros, name, value, advice):
    node = make(ros, **{name.replace(".", "__"): value})
    with pytest.raises(ConfigError, match=advice):
        declare_config(node)


def test_a_misspelt_parameter_is_named_with_the_nearest(ros, capfd):
    declare_config(make(ros, map__cel_size=0.05, use_sim_time=False))
    warnings = capfd.readouterr().err
    assert "parameter map.cel_size" in warnings
    assert "did you mean 'map.cell_size'?" in warnings
    assert "use_sim_time" not in warnings


@pytest.mark.every_distro
def test_changes_while_the_node_runs_are_checked_and_applied(ros):
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


class Reads:
    """Notes which parameters are read, while processors are made and afterwards."""

    def __init__(self, monkeypatch, config):
        self.phase, self.made, self.run = "none", set(), set()
        self._names = dict(self._walk(config, ""))
        plain = Group.__getattribute__

        def read(group, key):
            name = self._names.get((type(group), key))
            if name and self.phase != "none":
                (self.made if self.phase == "made" else self.run).add(name)
            return plain(group, key)

        monkeypatch.setattr(Group, "__getattribute__", read)

    def _walk(self, group, prefix):
        for key, value in group:
            if isinstance(value, Group):
                yield from self._walk(value, f"{prefix}{key}.")
            else:
                yield (type(group), key), prefix + key


def test_mutable_parameters_are_read_again_after_the_start(monkeypatch):
    config = Config()
    reads = Reads(monkeypatch, config)
    reads.phase = "made"
    pipeline = Pipeline(config, expects_odometry=True)
    reads.phase = "run"
    pipeline.add("robot_description", RobotDescription(URDF.format(p="", kind="revolute")))
    for topic, record in recording(4, speed=0.2):
        pipeline.add(topic, record)
    pipeline.finish()
    pipeline.solve()
    reads.phase = "none"
    live = {parameter.name for parameter in parameters() if not parameter.read_only}
    assert "map.region" in reads.run
    assert sorted((reads.made - reads.run) & live) == []


def test_a_region_set_while_the_node_runs_counts_from_the_next_cycle_on(ros):
    node, robot = tccm(ros), ros.robot()
    robot.play(recording(2), node)
    wide = node.processor.map.parts[-1].cuboids()
    region = [0.3, 1.3, -0.6, 0.6, 0.5, 1.0]
    assert node.set_parameters([RosParameter("map.region", value=region)])[0].successful
    robot.play(recording(3, start_ns=START_NS + 20_000_000_000), node)
    narrow = node.processor.map.parts[-1].cuboids()
    assert wide.ix.max() * wide.cell_size > 2.5
    assert 0.28 <= narrow.ix.min() * narrow.cell_size <= narrow.ix.max() * narrow.cell_size <= 1.3


@pytest.mark.skipif(not has_tf2_msgs(), reason="tf2_msgs is not installed")
def test_the_rate_of_tf_can_be_changed_while_the_node_runs(ros):
    node, robot, viewer = slam(ros, tf__rate=2.0), ros.robot(), Listener(ros)
    tf = viewer.listen(message_class("tf2_msgs/msg/TFMessage"), "/tf")
    ros.connect(node, viewer.node, "/tf")
    robot.play(recording(1), node)
    timer = node.live._tf_timer
    assert timer.timer_period_ns == 500_000_000
    assert node.set_parameters([RosParameter("tf.rate", value=100.0)])[0].successful
    ros.spin_until(lambda: len(tf) > 2)
    assert timer.timer_period_ns == 10_000_000


def test_choices_are_in_the_description(ros):
    node = tccm(ros)
    descriptor = node.describe_parameter("qos.reliability")
    assert descriptor.description.endswith("one of: best_effort, reliable")
    assert "best_effort, reliable" in descriptor.additional_constraints


def test_each_node_declares_the_parameters_that_it_acts_on_and_no_others(ros, monkeypatch, capfd):
    read = {"tccm": set(), "surface_slam": set()}
    plain = Config.__getattribute__
    # Both nodes are given both nodes' parameters, as by the shipped file.
    nodes = [kind(ros, map__window_cycles=9, walls__min_observations=4) for kind in (tccm, slam)]
    owners = {id(node.config): node.get_name() for node in nodes}

    def noted(config, name):
        if name in Config.model_fields and id(config) in owners:
            read[owners[id(config)]].add(name)
        return plain(config, name)

    monkeypatch.setattr(Config, "__getattribute__", noted)
    ros.robot().play(recording(4, speed=0.2), *nodes)
    for node in nodes:
        declared = {name.partition(".")[0] for name in node._parameters}
        assert read[node.get_name()] <= declared
        assert declared < {"use_sim_time", "start_type_description_service", *Config.model_fields}
    assert not nodes[0].has_parameter("walls.min_length")
    assert not nodes[1].has_parameter("map.cell_size")
    assert "there is none of this name" not in capfd.readouterr().err
