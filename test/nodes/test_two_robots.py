"""Two complete pairs of nodes in one domain: nothing of one is heard by the other."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_robot import Listener, recording, slam, tccm
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from tccm_ros.nodes.ros_types import has_tf2_msgs, message_class


def test_two_pairs_of_nodes_do_not_hear_each_other(ros, tmp_path):
    pairs, robots = {}, {}
    for name in ("r1", "r2"):
        common = {"namespace": name, "frames__prefix": f"{name}/"}
        pairs[name] = (tccm(ros, **common), slam(ros, **common))
        robots[name] = ros.robot(namespace=name, prefix=f"{name}/")
    viewer = Listener(ros)
    surfaces = {n: viewer.listen(PointCloud2, f"/{n}/tccm/surfaces") for n in pairs}
    reports = viewer.listen(DiagnosticArray, "/diagnostics")
    for name, (tilt_node, node) in pairs.items():
        ros.connect(tilt_node, viewer.node, f"/{name}/tccm/surfaces")
        ros.connect(tilt_node, node, f"/{name}/tccm/surfaces", f"/{name}/tccm/view")
    robots["r1"].play(recording(4, prefix="r1/"), *pairs["r1"])
    assert pairs["r1"][0].processor.counts["cycles"] >= 3
    for node in pairs["r2"]:
        assert not any(node.processor.counts.values())
        counts = node.inputs.counts()
        assert not any(n for t, n in counts.items() if t.endswith(("scan", "odom", "states")))
    robots["r2"].play(recording(3, prefix="r2/"), *pairs["r2"])
    for name, (tilt_node, node) in pairs.items():
        cycles = tilt_node.processor.counts["cycles"]
        ros.spin_until(lambda n=node, c=cycles: n.processor.counts["clouds"] == c)
        ros.spin_until(lambda n=name, c=cycles: len(surfaces[n]) == c)
        assert {m.header.frame_id for m in surfaces[name]} == {f"{name}/base"}
        transform = node.live.transform()
        assert transform.header.frame_id == f"{name}/map"
        assert transform.child_frame_id == f"{name}/odom"
        tilt_node.diagnostics.publish()
        node.diagnostics.publish()
    expected = {f"{n}/{node}" for n in pairs for node in ("tccm", "surface_slam")}
    ros.spin_until(lambda: {r.status[0].name for r in reports} >= expected)
    caller = viewer.node.create_client(Trigger, "/r2/surface_slam/reset")
    ros.call(caller, Trigger.Request())
    assert pairs["r1"][1].processor.counts["level scans"] > 0
    assert pairs["r2"][1].processor.counts["level scans"] == 0


@pytest.mark.skipif(not has_tf2_msgs(), reason="tf2_msgs is not installed")
def test_the_transforms_of_both_pairs_are_on_the_one_tf_topic(ros):
    viewer = Listener(ros)
    tf = viewer.listen(message_class("tf2_msgs/msg/TFMessage"), "/tf")
    for name in ("r1", "r2"):
        node = slam(ros, namespace=name, frames__prefix=f"{name}/")
        ros.robot(namespace=name, prefix=f"{name}/").play(recording(1, prefix=f"{name}/"), node)
    pairs = lambda m: {(t.header.frame_id, t.child_frame_id) for t in m.transforms}  # noqa: E731
    expected = {("r1/map", "r1/odom"), ("r2/map", "r2/odom")}
    ros.spin_until(lambda: expected <= set().union(*map(pairs, tf)))
    # Each message is of one robot, and no frame of one hangs on a frame of the other.
    assert set().union(*map(pairs, tf)) == expected
    assert all(len(pairs(message)) == 1 for message in tf)
