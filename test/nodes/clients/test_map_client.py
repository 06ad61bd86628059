"""The client and the examples, over DDS with both nodes."""

import numpy as np
import pytest
from example_process import run_example
from live_robot import START_NS, Listener, recording, slam, tccm
from rclpy.node import Node
from std_srvs.srv import Trigger

from tccm_ros.geometry import spatial
from tccm_ros.nodes.interfaces import has_interfaces
from tccm_ros.nodes.qos import latched_qos

pytestmark = pytest.mark.skipif(not has_interfaces(), reason="tccm_interfaces is not installed")


def test_unanswerable_or_malformed_query_is_an_error_at_once(ros):
    from tccm_interfaces.msg import SurfaceFilter

    from tccm_ros.client import RequestError, SurfaceMapClient

    client = SurfaceMapClient(Listener(ros).node, name="other_slam")
    with pytest.raises(RequestError, match="nobody answers /other_slam/find_surfaces"):
        client.find_surfaces().result()
    with pytest.raises(TypeError, match="clearnce"):
        client.find_placements((0.1, 0.1, 0.1), clearnce=0.1)
    with pytest.raises(ValueError, match=r"expected \(length, width, height\), m"):
        client.find_placements((0.1, 0.1))
    with pytest.raises(TypeError, match="filter is 'table'"):
        client.find_placements((0.1, 0.1, 0.1), "table")
    labels = SurfaceFilter()
    labels._labels = "table"  # as its setter leaves it without ROS_PYTHON_CHECK_FIELDS
    with pytest.raises(TypeError, match="expected a list of labels"):
        client.find_surfaces(labels)


@pytest.mark.every_distro
def test_a_python_node_hears_of_the_map_and_asks_it(ros):
    from tccm_interfaces.msg import SurfaceFilter

    from tccm_ros.client import RequestError, SurfaceMapClient

    tilt_node, node = tccm(ros), slam(ros)
    robot, own = ros.robot(), Listener(ros).node
    client = SurfaceMapClient(own)
    events, maps = [], []
    client.on_event(events.append)
    client.on_map(lambda: maps.append(len(client.surfaces)))
    ros.connect(tilt_node, node, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    ros.connect(node, own, "/surface_slam/events")
    robot.play(recording(4), tilt_node, node)
    ros.spin_until(lambda: client.is_ready and client.surfaces and events)
    assert [(e.kind, e.label, e.T_before) for e in events] == [("appeared", "table", None)]
    (table,) = (s for s in client.surfaces if s.label == "table")
    # The table of the room: 0.8 m by 1.0 m, its middle at (0.8, 0).
    assert table.height == pytest.approx(0.70, abs=0.01)
    assert np.abs(table.T_map_surface[:2, 3] - (0.8, 0.0)).max() < 0.1
    found = client.find_placements((0.1, 0.1, 0.12), max_count=1)
    ros.spin_until(found.done)
    (place,) = found.result()
    assert place.surface_id == table.id
    assert place.T_map_object[2, 3] == pytest.approx(0.70, abs=0.01)
    # Numbers may be whole ones: messages take floats alone.
    assert place.clearance > 0.02
    assert place.free_height > 0.5
    (wider,) = answered(ros, client.find_placements((0.1, 0.1, 1), clearance=0, max_count=1))
    assert wider.surface_id == table.id
    with pytest.raises(RequestError, match=r"size_x is -0.1 m; expected 0.001 to 10 m"):
        answered(ros, client.find_placements((-0.1, 0.1, 0.12)))
    for size, labels, why in (
        ((3.0, 3.0, 0.12), [], "none of 1 surfaces has room for 3 x 3 x 0.12 m"),
        ((0.1, 0.1, 0.12), ["tabel"], "no surface is labelled tabel; there are: table"),
    ):
        none = answered(ros, client.find_placements(size, SurfaceFilter(labels=labels)))
        assert (len(none), why in none.message) == (0, True), none.message
    assert answered(ros, client.find_surfaces()).message == "1 of 2 surfaces"
    assert f"table {table.id} at 0.70 m" in run_example(ros, "list_counters.py")


def answered(ros, future):
    """Return the answer to a question."""
    ros.spin_until(future.done)
    return future.result()


def test_a_python_node_corrects_labels_checks_boxes_and_saves_maps(ros, tmp_path):
    from tccm_interfaces.msg import SurfaceMap

    from tccm_ros.client import RequestError, SurfaceMapClient

    tilt_node, node = tccm(ros), slam(ros, save__directory=str(tmp_path))
    robot, own = ros.robot(), Listener(ros).node
    client = SurfaceMapClient(own)
    ros.connect(tilt_node, node, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    ros.spin_until(lambda: client.has_services)
    with pytest.raises(RequestError, match="there is no map yet"):
        answered(ros, client.set_pose(np.eye(4)))
    robot.play(recording(4), tilt_node, node)
    ros.spin_until(lambda: client.is_ready and client.can_check_boxes)
    ros.spin_until(lambda: client.surfaces and client.localisation)
    assert (client.localisation.state, client.localisation.reason) == ("tracking", "")
    # The walls of the room, each in the plane of z = 0.
    assert len(client.walls) >= 3
    assert all(np.ptp(wall.endpoints[:, :2], axis=0).max() > 1.0 for wall in client.walls)
    assert not any(wall.endpoints[:, 2].any() for wall in client.walls)

    (table,) = (s for s in client.surfaces if s.label == "table")
    assert answered(ros, client.set_label(table.id, "counter")) == f"surface {table.id} was 'table'"
    ros.spin_until(lambda: [s.label for s in client.surfaces if s.id == table.id] == ["counter"])
    with pytest.raises(RequestError, match="no label 'throne'"):
        answered(ros, client.set_label(table.id, "throne"))

    # The table's top, 0.70 m over the floor, and 2 m over that.
    boxes = [
        answered(
            ros, client.check_box(spatial(np.array([0.8, 0.0, 0.0])) @ up(z), (0.1,) * 3, "odom")
        )
        for z in (0.70, 2.7)
    ]
    assert [box.state for box in boxes] == ["occupied", "unknown"]
    assert (boxes[0].cycle >= 0, boxes[0].stamp_ns > 0) == (True, True)
    with pytest.raises(RequestError, match="nowhere"):
        answered(ros, client.check_box(np.eye(4), (0.1, 0.1, 0.1), "nowhere"))

    assert answered(ros, client.list_maps()) == []
    saved = answered(ros, client.save_named_map("home"))
    assert (saved.name, saved.message.surfaces) == ("home", len(client.surfaces))
    assert saved.saved_ns > 0
    assert [m.name for m in answered(ros, client.list_maps())] == ["home"]
    robot.play(recording(1, tilt=False, start_ns=START_NS + 60_000_000_000), node)
    ros.spin_until(lambda: client.localisation.message.map_name == "home")
    with pytest.raises(RequestError, match="overwrite"):
        answered(ros, client.save_named_map("home"))
    assert answered(ros, client.set_pose(np.eye(4))) is None
    trigger = own.create_client(Trigger, "/surface_slam/reset")
    assert answered(ros, trigger.call_async(Trigger.Request())).success
    names = []
    own.create_subscription(
        SurfaceMap, "/surface_slam/surface_map",
        lambda message: names.append((message.name, message.localisation.map_name)), latched_qos(),
    )  # fmt: skip
    assert answered(ros, client.load_named_map("home")).name == "home"
    ros.spin_until(lambda: names and names[-1] == ("home", "home"))


def up(z):
    T = np.eye(4)
    T[2, 3] = z
    return T


def map_server(ros):
    """Return a node that answers the requests of `SurfaceMapClient`, and has no map yet."""
    from tccm_ros.nodes.clients.map_client import MAP_SERVICES

    server = ros.add(Node("surface_slam", context=ros.another_context()))

    def answer(_, response):
        response.success = True
        return response

    for kind, name in MAP_SERVICES.items():
        server.create_service(kind, f"~/{name}", answer)
    return server


def test_a_client_is_ready_with_an_empty_map(ros):
    from tccm_interfaces.msg import SurfaceMap

    from tccm_ros.client import SurfaceMapClient

    server = map_server(ros)
    client = SurfaceMapClient(ros.add(Node("asker", context=ros.context)))
    ros.spin_until(lambda: client.has_services)
    assert not client.is_ready, "no map has come"
    maps = server.create_publisher(SurfaceMap, "~/surface_map", latched_qos())
    maps.publish(SurfaceMap())
    ros.spin_until(lambda: client.is_ready)
    assert (client.surfaces, client.stamp_ns) == ((), 0)


def test_the_hundredth_question_takes_no_more_steps_than_the_first(ros):
    from tccm_ros.client import SurfaceMapClient

    map_server(ros)
    own = ros.add(Node("asker", context=ros.context))
    client, steps, step = SurfaceMapClient(own), [], ros.executor.wait_for_ready_callbacks
    ros.spin_until(lambda: client.has_services)

    def counted(*args):
        steps[-1] += 1
        return step(*args)

    ros.executor.wait_for_ready_callbacks = counted
    for _ in range(100):
        steps.append(0)
        ros.executor.spin_until_future_complete(client.list_maps())
    assert sum(steps[-10:]) < 3 * sum(steps[:10])


def test_a_pose_that_is_none_is_refused_before_it_is_asked(ros):
    """The quaternion of a matrix of zeros is one of a rotation."""
    from tccm_ros.client import SurfaceMapClient

    client = SurfaceMapClient(ros.add(Node("asker", context=ros.context)))
    mirrored = np.diag([1.0, 1.0, -1.0, 1.0])
    for T in (np.zeros((4, 4)), mirrored, np.eye(3), np.full((4, 4), np.nan)):
        with pytest.raises(ValueError, match="a pose"):
            client.set_pose(T)
        with pytest.raises(ValueError, match="a pose"):
            client.check_box(T, (1.0, 1.0, 1.0), "base")
