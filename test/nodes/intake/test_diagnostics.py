"""/diagnostics over DDS: an error where the node cannot work, a warning where the map suffers."""

from dataclasses import replace

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from live_robot import START_NS, Listener, end_input, recording, slam, tccm
from rcl_interfaces.msg import Log
from sensor_msgs.msg import Image, LaserScan
from std_srvs.srv import SetBool, Trigger

WINDOW_S = 10.0  # s: older refusals do not set the level

SECOND = 1_000_000_000
SILENCE = 0.2
"""Seconds of silence that are told in these tests."""


class Statuses:
    """The newest status of each name on /diagnostics."""

    def __init__(self, ros):
        self._ros = ros
        self._arrays = Listener(ros, "monitor").listen(DiagnosticArray, "/diagnostics")

    def __getitem__(self, name):
        for array in reversed(self._arrays):
            for status in array.status:
                if status.name == name:
                    return status
        return None

    def is_at(self, name, level, *words) -> bool:
        """Return whether a status has a level and some words."""
        status = self[name]
        return status and status.level == level and all(w in status.message for w in words)

    def assert_becomes(self, name, level, *words) -> None:
        """Wait until a status has a level and some words."""
        self._ros.spin_until(lambda: self.is_at(name, level, *words), what=f"{name}: {words}")

    def values(self, name) -> dict[str, str]:
        return {item.key: item.value for item in self[name].values}


def only(records, *topics):
    return [(topic, record) for topic, record in records if topic in topics]


def without(records, *topics):
    return [(topic, record) for topic, record in records if topic not in topics]


def test_no_input_at_all_is_an_error_of_both_nodes(ros):
    statuses = Statuses(ros)
    tccm(ros, qos__silence=SILENCE)
    slam(ros, namespace="/elsewhere", qos__silence=SILENCE)
    error = DiagnosticStatus.ERROR
    statuses.assert_becomes("tccm", error, "nobody publishes '/tilt_scan'")
    statuses.assert_becomes("tccm: /tilt_scan", error)
    statuses.assert_becomes("elsewhere/surface_slam", error, "nothing to map", "/elsewhere/scan")


def test_the_wrong_namespace_is_an_error_that_names_the_right_topic(ros):
    statuses, node, robot = Statuses(ros), tccm(ros, namespace="/a", qos__silence=SILENCE), None
    robot = ros.robot(namespace="/b")
    robot.play(recording(1))
    statuses.assert_becomes("a/tccm", DiagnosticStatus.ERROR, "/b/tilt_scan", "namespace")
    assert node.inputs.counts()["/a/tilt_scan"] == 0


def test_no_odometry_is_an_error_of_the_tccm_and_a_warning_of_slam(ros):
    statuses, nodes, robot = Statuses(ros), [tccm(ros), slam(ros)], ros.robot()
    robot.play(without(recording(3), "odom"), *nodes)
    words = ("nobody publishes '/odom'", "no tf")
    statuses.assert_becomes("tccm", DiagnosticStatus.ERROR, *words, "stand still")
    statuses.assert_becomes("surface_slam", DiagnosticStatus.WARN, *words)


def test_no_level_laser_is_a_warning_of_slam(ros):
    nodes = [tccm(ros, qos__silence=SILENCE), slam(ros, qos__silence=SILENCE)]
    statuses, robot = Statuses(ros), ros.robot()
    robot.play(without(recording(3), "scan"), *nodes)
    statuses.assert_becomes("surface_slam", DiagnosticStatus.WARN, "level laser", "'/scan'")
    statuses.assert_becomes("tccm", DiagnosticStatus.OK)


def test_a_robot_that_has_stopped_is_ok(ros):
    """All inputs end together, and the tilt joint came to rest before."""
    nodes = [tccm(ros, qos__silence=SILENCE), slam(ros, qos__silence=SILENCE)]
    statuses, robot = Statuses(ros), ros.robot()
    records = list(recording(4))
    robot.play(records, *nodes)
    last = next(r.positions for t, r in reversed(records) if t == "joint_states")
    rest = list(recording(4, start_ns=records[-1][1].stamp_ns + 1))
    for topic, record in rest:
        if topic == "joint_states":
            record.positions[:] = last
    robot.play(rest, *nodes)
    for node in nodes:
        end_input(node)
    assert nodes[0].dropped["joint rests"] > 20
    before = {name: statuses[name] for name in ("tccm", "surface_slam")}
    for name in before:
        ros.spin_until(lambda n=name: statuses[n] is not None and statuses[n] is not before[n])
    ros.remove(robot.node)
    seen = {name: statuses[name] for name in before}
    for name in seen:
        ros.spin_until(lambda n=name: statuses[n] is not seen[n])
        assert statuses.is_at(name, DiagnosticStatus.OK), statuses[name].message


def test_a_tilting_laser_that_pauses_while_the_robot_drives_is_ok(ros):
    node, statuses, robot = tccm(ros, qos__silence=SILENCE), Statuses(ros), ros.robot()
    records = list(recording(4))
    robot.play(records, node)
    (laser,) = (entry for entry in node.inputs if entry.topic == "/tilt_scan")
    while not node.inputs._is_silent(laser):  # odometry and joints go on meanwhile
        records = list(recording(1, start_ns=records[-1][1].stamp_ns + 1, tilt=False))
        robot.play(records, node)
    assert robot.node.count_publishers("/tilt_scan") == 1
    assert node.inputs.problem(laser) is None
    before = statuses["tccm"]
    ros.spin_until(lambda: statuses["tccm"] is not None and statuses["tccm"] is not before)
    assert "silent" not in statuses["tccm: /tilt_scan"].message


def test_each_input_has_counts_that_agree_and_a_latency(ros):
    nodes, statuses, robot = [tccm(ros), slam(ros)], Statuses(ros), ros.robot()
    records = list(recording(5))
    robot.play(records, *nodes)
    for node in nodes:
        end_input(node)
    sent = {t: sum(topic == t for topic, _ in records) for t in ("tilt_scan", "scan", "odom")}
    for name, topic, fewest in (
        ("tccm", "tilt_scan", 60),
        ("tccm", "odom", sent["odom"]),
        ("surface_slam", "scan", sent["scan"] - 1),
    ):
        full = f"{name}: /{topic}"

        def has_all(full=full, topic=topic, fewest=fewest) -> bool:
            values = statuses.values(full) if statuses[full] else {"received": 0, "used": 0}
            return int(values["received"]) == sent[topic] and int(values["used"]) >= fewest

        ros.spin_until(has_all, what=full)
        values = statuses.values(full)
        assert int(values["expected"]) == sent[topic]
        assert int(values["used"]) <= int(values["received"])
        assert "latency [s]" in values
    used = nodes[0].processor.counts["scans used"] + sum(nodes[0].dropped.values())
    assert used == sent["tilt_scan"]


def test_counts_go_on_after_a_reset(ros):
    nodes, robot, caller = [tccm(ros), slam(ros)], ros.robot(), Listener(ros).node
    first, then = (list(recording(3, start_ns=START_NS + k * 10 * SECOND)) for k in (0, 1))
    robot.play(first, *nodes)
    for node in nodes:
        reset = caller.create_client(Trigger, f"/{node.get_name()}/reset")
        assert ros.call(reset, Trigger.Request()).success
    robot.play(then, *nodes)
    for node, topic in zip(nodes, ("tilt_scan", "scan")):
        end_input(node)
        sent = sum(t == topic for t, _ in (*first, *then))
        assert node.inputs.counts()[f"/{topic}"] == sent
        assert node.used()[topic] + sum(node.dropped.values()) >= sent - 1, topic


def test_scans_that_come_during_a_pause_are_counted_and_no_fault(ros):
    node, robot, caller = tccm(ros), ros.robot(), Listener(ros).node
    pause = caller.create_client(SetBool, "/tccm/pause")
    robot.play(recording(2), node)
    ros.call(pause, SetBool.Request(data=True))
    paused = list(recording(2, start_ns=START_NS + 10 * SECOND))
    robot.play(paused, node)
    ros.call(pause, SetBool.Request(data=False))
    end_input(node)
    assert node.dropped["paused"] >= sum(t == "tilt_scan" for t, _ in paused) - 1
    assert not any("dropped" in text for text in node.all_problems())
    used = node.used()["tilt_scan"] + sum(node.dropped.values())
    assert used == node.inputs.counts()["/tilt_scan"]


def test_input_with_refused_messages_is_an_error_until_they_are_used(ros):
    """Of the level laser nothing is used, and each kind is told; then one is over."""
    node, statuses, robot = tccm(ros), Statuses(ros), ros.robot()
    clock_s = [100.0]
    node.refusals._now = lambda: clock_s[0]
    said = Listener(ros, "log").listen(Log, "/rosout", latched=True)
    for bad in (
        LaserScan(angle_increment=float("nan")),
        LaserScan(time_increment=1e3, ranges=[1.0, 1.0]),
    ):
        robot.publish("tilt_scan", bad, node)
    words = ("all messages of 'tilt_scan' are refused", "angle_increment nan", "expected at most")
    statuses.assert_becomes("tccm: /tilt_scan", DiagnosticStatus.ERROR, *words)
    statuses.assert_becomes("tccm", DiagnosticStatus.ERROR, *words)
    robot.play(recording(3), node)
    word = "some messages of 'tilt_scan' are refused"
    statuses.assert_becomes("tccm: /tilt_scan", DiagnosticStatus.WARN, word)
    clock_s[0] += WINDOW_S + 1.0
    statuses.assert_becomes("tccm: /tilt_scan", DiagnosticStatus.OK)
    ros.spin_until(lambda: any(m.name == "tccm" and "is over" in m.msg for m in said))


def test_a_bad_frame_is_over_with_the_next_good_one(ros):
    node, statuses, robot = tccm(ros), Statuses(ros), ros.robot()
    records = list(recording(2))
    wrong = [(t, replace(r, frame_id="nowhere") if t == "tilt_scan" else r) for t, r in records]
    robot.play(wrong, node)
    statuses.assert_becomes("tccm", DiagnosticStatus.ERROR, "nowhere")
    robot.play(recording(3, start_ns=records[-1][1].stamp_ns + 1), node)
    ros.spin_until(lambda: node.processor.counts["cycles"])
    before = statuses["tccm"]
    ros.spin_until(
        lambda: statuses["tccm"] is not before and "nowhere" not in statuses["tccm"].message
    )


def test_an_input_that_lags_behind_the_others_is_a_warning_with_the_figure(ros):
    """All stamps are of now, but those of the laser, which comes 2 s late."""
    node, statuses, robot = tccm(ros), Statuses(ros), ros.robot()
    lag_ns = 2 * SECOND
    start_ns = node.get_clock().now().nanoseconds
    for topic, record in recording(2, start_ns=start_ns):
        now_ns = node.get_clock().now().nanoseconds - (lag_ns if topic == "tilt_scan" else 0)
        robot.play([(topic, replace(record, stamp_ns=now_ns))], node)
    words = ("'/tilt_scan' comes 2.", "s later than the other inputs")
    statuses.assert_becomes("tccm: /tilt_scan", DiagnosticStatus.WARN, *words)
    ros.spin_until(lambda: statuses["tccm"] and words[0] in statuses["tccm"].message)


def test_a_publisher_that_has_sent_nothing_yet_is_waited_for(ros):
    node, statuses, robot = tccm(ros, qos__silence=SILENCE), Statuses(ros), ros.robot()
    said = Listener(ros, "log").listen(Log, "/rosout", latched=True)
    robot.node.create_publisher(LaserScan, "tilt_scan", 10)
    statuses.assert_becomes("tccm: /tilt_scan", DiagnosticStatus.WARN, "waits for '/tilt_scan'")
    said.clear()  # what was said before the publisher was there
    before = statuses["tccm: /tilt_scan"]
    ros.spin_until(lambda: statuses["tccm: /tilt_scan"] is not before)
    assert statuses.is_at("tccm: /tilt_scan", DiagnosticStatus.WARN)
    assert not any(m.name == "tccm" and "'/tilt_scan'" in m.msg and m.level >= 40 for m in said)
    assert node.inputs.counts()["/tilt_scan"] == 0


def test_a_robot_with_a_depth_camera_lacks_no_tilting_laser(ros):
    """The camera is there, and has not sent anything yet either."""
    node, statuses, robot = tccm(ros, qos__silence=SILENCE), Statuses(ros), ros.robot()
    (image,) = node.config.sensors.depth_images[:1]
    robot.node.create_publisher(Image, image, 10)
    ros.spin_until(lambda: node.inputs.is_published(node.resolve_topic_name(image)))
    before = statuses["tccm: /tilt_scan"]
    (laser,) = (entry for entry in node.inputs if entry.topic == "/tilt_scan")
    ros.spin_until(lambda: node.inputs._is_silent(laser))
    ros.spin_until(lambda: statuses["tccm: /tilt_scan"] is not before)
    assert statuses.is_at("tccm: /tilt_scan", DiagnosticStatus.OK)
