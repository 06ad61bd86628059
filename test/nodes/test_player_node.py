"""The player over real DDS: everything arrives, in order, with the bag's QoS and clock."""

import time

import pytest
from processes import PATIENCE_S, started
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool

from tccm_ros.bags.typestore import TypestoreMessages
from tccm_ros.bags.writer import BagWriter
from tccm_ros.errors import BagError, ConfigError
from tccm_ros.nodes.player_node import PARAMETERS, PlayerNode
from tccm_ros.records import JointSample, RobotDescription
from tccm_sim.sensor_messages import joint_sample_message, robot_description_message

STABLE_S = 0.5  # s, without a new subscriber before playing starts

COUNT = 300
PERIOD_NS = 10_000_000
START_NS = 1_700_000_000_000_000_000


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    import numpy as np

    types = TypestoreMessages()
    path = tmp_path_factory.mktemp("bags") / "small"
    with BagWriter(path) as writer:
        model = robot_description_message(types, RobotDescription("<robot name='r'/>"))
        writer.write("/robot_description", "std_msgs/msg/String", START_NS, model)
        for i in range(COUNT):
            stamp = START_NS + i * PERIOD_NS
            sample = JointSample(stamp, ("tilt",), np.array([i * 0.01]))
            message = joint_sample_message(types, sample)
            writer.write("/joint_states", "sensor_msgs/msg/JointState", stamp, message)
    return path


def player(ros, bag, *words, **values):
    overrides = [Parameter("bag", value=str(bag))]
    overrides += [Parameter(name, value=value) for name, value in values.items()]
    return ros.add(
        PlayerNode(
            context=ros.context,
            parameter_overrides=overrides,
            cli_args=["--ros-args", *words] if words else None,
        )
    )


def listener(ros):
    node, got = ros.add(Node("listener", context=ros.context)), []
    node.create_subscription(JointState, "joint_states", got.append, QoSProfile(depth=COUNT))
    return node, got


def listener_to_clock(ros):
    node, got = ros.add(Node("clock_listener", context=ros.context)), []
    node.create_subscription(
        Clock, "/clock", lambda c: got.append(c.clock.sec * 10**9 + c.clock.nanosec), 100
    )
    return got


@pytest.mark.every_distro
def test_all_messages_arrive_in_order_and_the_clock_runs(ros, bag):
    _, got = listener(ros)
    times = listener_to_clock(ros)
    playing = player(ros, bag, rate=20.0, wait_for_subscribers=20.0, topics=["/joint_states"])
    ros.spin_until(lambda: playing.is_done and len(got) == COUNT)
    positions = [message.position[0] for message in got]
    assert positions == pytest.approx([i * 0.01 for i in range(COUNT)])
    assert times == sorted(times)
    assert START_NS <= times[0] <= times[-1] <= START_NS + COUNT * PERIOD_NS


def test_a_late_listener_gets_the_robot_description(ros, bag):
    playing = player(ros, bag, rate=100.0)
    ros.spin_until(lambda: playing.is_done)
    node, got = ros.add(Node("late", context=ros.context)), []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(String, "robot_description", got.append, latched)
    ros.spin_until(lambda: len(got) == 1)
    assert got[0].data == "<robot name='r'/>"


def test_start_and_duration_cut_the_bag(ros, bag):
    _, got = listener(ros)
    playing = player(
        ros, bag, rate=20.0, wait_for_subscribers=20.0, topics=["/joint_states"],
        start=1.0, duration=0.5,
    )  # fmt: skip
    ros.spin_until(lambda: playing.is_done and len(got) == playing.published)
    assert [round(m.position[0], 6) for m in got] == [round(i * 0.01, 6) for i in range(100, 151)]


@pytest.mark.every_distro
def test_a_topic_is_remapped_alone(ros, bag):
    node, got = listener(ros)
    elsewhere, models = [], []
    node.create_subscription(JointState, "/arm/states", elsewhere.append, QoSProfile(depth=COUNT))
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(String, "robot_description", models.append, latched)
    playing = player(
        ros, bag, "-r", "/joint_states:=/arm/states", rate=20.0, wait_for_subscribers=20.0
    )
    ros.spin_until(lambda: playing.is_done and len(elsewhere) == COUNT and models)
    assert not got


def test_pause_holds_and_loop_starts_over(ros, bag):
    _, got = listener(ros)
    playing = player(ros, bag, rate=50.0, loop=True, paused=True, topics=["/joint_states"])
    client = ros.add(Node("caller", context=ros.context)).create_client(SetBool, "/player/pause")
    ros.spin_until(client.service_is_ready)
    assert playing.published == 0
    future = client.call_async(SetBool.Request(data=False))
    ros.spin_until(future.done)
    ros.spin_until(lambda: playing.published > 2 * COUNT)
    future = client.call_async(SetBool.Request(data=True))
    ros.spin_until(future.done)
    held = playing.published
    ros.spin_until(lambda: len(got) > 0)
    assert playing.published == held


def test_a_bad_bag_or_rate_is_an_error_of_one_line(ros, tmp_path, bag):
    with pytest.raises(BagError, match="nowhere"):
        player(ros, tmp_path / "nowhere")
    with pytest.raises(ConfigError, match="rate"):
        player(ros, bag, rate=0.0)
    with pytest.raises(ConfigError, match=r"integer 2; write 2\.0"):
        player(ros, bag, rate=2)
    with pytest.raises(ConfigError, match="the bag has 0 to 3"):
        player(ros, bag, start=1000.0)
    with pytest.raises(ConfigError, match="duration"):
        player(ros, bag, duration=-1.0)
    with pytest.raises(BagError, match="no topic /absent"):
        player(ros, bag, topics=["/absent"])


def test_the_clock_is_published_at_100_hz_or_less(ros, bag):
    node, times = ros.add(Node("watch", context=ros.context)), []
    node.create_subscription(Clock, "/clock", times.append, 1000)
    listener(ros)
    playing = player(ros, bag, wait_for_subscribers=PATIENCE_S, topics=["/joint_states"])
    start = time.monotonic()
    ros.spin_until(lambda: playing.is_done)
    seconds = time.monotonic() - start
    assert seconds >= 2.9
    assert 0 < len(times) <= 100 * seconds + 2


def test_help_names_the_parameters_of_the_player(domain):
    with started(domain, "player_node", "--help") as process:
        output, _ = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert "usage: player_node" in output
    for name, (_, meaning) in PARAMETERS.items():
        assert name in output
        assert meaning in output


def test_a_misspelt_parameter_is_named_with_the_nearest(ros, bag, capfd):
    player(ros, bag, loops=True, use_sim_time=False)
    warnings = capfd.readouterr().err
    assert "parameter loops is set but there is none of this name" in warnings
    assert "did you mean 'loop'?" in warnings
    assert "use_sim_time" not in warnings


def test_player_reports_waiting_and_start(ros, bag):
    log = []
    watcher = ros.add(Node("watcher", context=ros.context))
    latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    watcher.create_subscription(Log, "/rosout", lambda m: log.append(m.msg), latched)
    player(ros, bag, rate=50.0, wait_for_subscribers=PATIENCE_S, topics=["/joint_states"])
    ros.spin_until(lambda: "ready; waits for subscribers of /joint_states" in log)
    assert not any(text.startswith("plays") for text in log)
    listener(ros)
    ros.spin_until(lambda: f"plays {bag}" in log)


def test_a_player_that_is_paused_says_so(ros, bag):
    log = []
    watcher = ros.add(Node("watcher", context=ros.context))
    latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    watcher.create_subscription(Log, "/rosout", lambda m: log.append(m.msg), latched)
    player(ros, bag, paused=True, topics=["/joint_states"])
    ros.spin_until(lambda: "ready; paused, waits for ~/pause" in log)
    assert not any(text.startswith("plays") for text in log)


def test_player_starts_once_the_subscribers_are_stable(ros, bag):
    playing = player(ros, bag, rate=50.0, wait_for_subscribers=PATIENCE_S, topics=["/joint_states"])
    before = time.monotonic()
    _, got = listener(ros)
    ros.spin_until(lambda: playing.published)
    assert time.monotonic() - before >= STABLE_S
    ros.spin_until(lambda: playing.is_done and len(got) == COUNT)


def test_bag_time_waits_until_readers_have_the_first_message_of_a_topic(ros, bag, monkeypatch):
    """A reader that finds the writer late would miss what is more than the writer's queue."""
    slow_s, waits = 1.0, []

    def wait_for_all_acked(publisher, timeout):
        end = time.monotonic() + slow_s
        while time.monotonic() < end:
            pass
        waits.append(publisher.topic)
        return True

    monkeypatch.setattr(Publisher, "wait_for_all_acked", wait_for_all_acked)
    _, got = listener(ros)
    clock = listener_to_clock(ros)
    before = time.monotonic()
    player(ros, bag, wait_for_subscribers=PATIENCE_S, topics=["/joint_states"])
    ros.spin_until(lambda: len(got) > 40 and len(clock) > 5)
    assert waits == ["/joint_states"]
    assert clock[-1] - START_NS <= (time.monotonic() - before - STABLE_S - slow_s) * 1e9
