"""~/tables and collision_object over DDS: of the solution that ~/surface_map shows."""

import numpy as np
import pytest
from live_robot import Listener, recording, slam, tccm
from tccm_interfaces.msg import SurfaceMap

from tccm_ros.nodes.ros_types import is_installed, message_class
from tccm_ros.ros.collision_messages import COLLISION_OBJECT
from tccm_ros.ros.table_messages import TABLES

pytestmark = pytest.mark.skipif(
    not (is_installed(TABLES) and is_installed(COLLISION_OBJECT)),
    reason="object_recognition_msgs or moveit_msgs is not installed",
)


def points(ring):
    return np.array([[p.x, p.y, p.z] for p in ring])


def test_tables_and_collision_objects_are_of_one_solution(ros):
    tilt_node, node = tccm(ros), slam(ros)
    robot, viewer = ros.robot(), Listener(ros)
    maps = viewer.listen(SurfaceMap, "/surface_slam/surface_map", latched=True)
    arrays = viewer.listen(message_class(TABLES), "/surface_slam/tables", latched=True)
    objects = viewer.listen(message_class(COLLISION_OBJECT), "/collision_object", latched=True)
    ros.connect(tilt_node, node, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    robot.play(recording(4), tilt_node, node)
    ros.spin_until(lambda: maps and maps[-1].surfaces and arrays and objects)
    ros.spin_until(lambda: maps[-1].header == arrays[-1].header == objects[-1].header)
    surfaces = [s for s in maps[-1].surfaces if s.label != "floor"]
    assert len(surfaces) == len(arrays[-1].tables) == 1
    for surface, table in zip(surfaces, arrays[-1].tables):
        assert table.header == arrays[-1].header
        assert table.pose == surface.pose
        hull, seen = (points(ring) for ring in (table.convex_hull, surface.boundary_seen.points))
        assert np.ptp(hull[:, 0]) == pytest.approx(1.0, abs=0.06), "x lies along the longer edge"
        assert np.ptp(hull[:, 1]) == pytest.approx(np.ptp(seen[:, 0]), abs=0.02)
        assert np.abs(hull[:, 2]).max() < 1e-9
    (free,) = maps[-1].free_areas
    assert free.surface_id == surfaces[0].id
    assert (free.size_x, free.size_y) == node.config.objects.place_size
    for ring in free.outlines:
        corners = points(ring.points)
        assert np.all(np.abs(corners[:, :2] - [0.8, 0.0]) < [0.45, 0.55]), "on the true table"
        assert np.allclose(corners[:, 2], 0.70, atol=0.01)
    stamp = objects[-1].header.stamp
    newest = {o.id for o in objects if o.header.stamp == stamp}
    items = {f"tccm_object_{o.id}" for o in maps[-1].objects}
    assert newest == {f"tccm_surface_{s.id}" for s in surfaces} | items
