"""Masks and shapes of what is under furniture, for Nav2's costmaps, over DDS."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from bag_player import play_bag
from live_robot import Listener, recording, slam, tccm
from nav_msgs.msg import OccupancyGrid
from outlined_surfaces import surface
from rclpy.node import Node
from shapely.geometry import box
from tccm_interfaces.msg import SurfaceMap

from tccm_ros.nodes.ros_types import RosidlMessages
from tccm_ros.nodes.services.keepout import VectorShapes
from tccm_ros.scene.scene import KnownSurface, Scene

nav2 = pytest.importorskip("nav2_msgs.msg")
services = pytest.importorskip("nav2_msgs.srv")

WALKTHROUGH = Path(__file__).resolve().parents[3] / "bags" / "walkthrough"
LEAVES_S = 12.3
"""Time before the stool is carried away, s."""

TABLE = surface(box(0.0, 0.0, 1.2, 0.8), number=4)
MOVED = surface(box(0.4, 0.0, 1.6, 0.8), number=4)
SHELF = surface(box(2.0, 0.0, 3.0, 0.3), number=7, label="shelf")
FLOOR = surface(box(-3.0, -3.0, 3.0, 3.0), number=1, label="floor")


def scene(*surfaces) -> Scene:
    known = tuple(KnownSurface(surface, 2) for surface in surfaces)
    return Scene(1, "map", 0.0, (), None, known)


def outline(points):
    return shapely.Polygon([(p.x, p.y) for p in points])


def test_the_mask_of_the_keepout_filter_is_that_of_each_solution(ros):
    tilt_node, node = tccm(ros), slam(ros)
    robot, viewer = ros.robot(), Listener(ros)
    masks = viewer.listen(OccupancyGrid, "/surface_slam/keepout_mask", latched=True)
    maps = viewer.listen(SurfaceMap, "/surface_slam/surface_map", latched=True)
    ros.connect(tilt_node, node, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    robot.play(recording(4), tilt_node, node)
    ros.spin_until(lambda: maps and masks and any(s.label != "floor" for s in maps[-1].surfaces))
    ros.spin_until(lambda: maps[-1].header == masks[-1].header, what="the mask of the newest map")
    mask, (table,) = masks[-1], [s for s in maps[-1].surfaces if s.label != "floor"]
    info = mask.info
    cells = np.array(mask.data, np.int8).reshape(info.height, info.width)
    rows, columns = np.nonzero(cells == 100)
    x = info.origin.position.x + (columns + 0.5) * info.resolution
    y = info.origin.position.y + (rows + 0.5) * info.resolution
    under = outline(table.boundary.points)
    assert shapely.contains_xy(under.buffer(1e-6), x, y).all()
    assert len(x) * info.resolution**2 == pytest.approx(under.area, rel=0.15)
    assert set(np.unique(cells)) == {0, 100}, "no cell is unknown"
    # The filter may start later: what it needs is latched.
    late = Listener(ros, "keepout_filter")
    infos = late.listen(nav2.CostmapFilterInfo, "/surface_slam/keepout_info", latched=True)
    again = late.listen(OccupancyGrid, "/surface_slam/keepout_mask", latched=True)
    ros.spin_until(lambda: infos and again)
    (info,) = infos
    assert (info.type, info.filter_mask_topic) == (0, "/surface_slam/keepout_mask")
    assert (info.base, info.multiplier) == (0.0, 1.0)
    assert again[-1].data == mask.data


def test_vector_object_server_receives_moves_and_removals(ros):
    publisher = ros.add(Node("surface_slam", context=ros.another_context()))
    server = ros.add(Node("vector_object_server", context=ros.another_context()))
    added, removed = [], []

    def answer(kept):
        def done(request, response):
            kept.append(request)
            response.success = True
            return response

        return done

    server.create_service(services.AddShapes, "~/add_shapes", answer(added))
    server.create_service(services.RemoveShapes, "~/remove_shapes", answer(removed))
    shapes = VectorShapes(publisher, RosidlMessages())
    ros.spin_until(lambda: shapes._add.service_is_ready() and shapes._remove.service_is_ready())
    shapes.send(scene(FLOOR, TABLE, SHELF))
    ros.spin_until(lambda: len(added) == 1)
    assert [outline(p.points).area for p in added[0].polygons] == pytest.approx([0.96, 0.3])
    assert {p.header.frame_id for p in added[0].polygons} == {"map"}
    assert all(p.closed and p.value == 100 for p in added[0].polygons)
    shapes.send(scene(FLOOR, MOVED))
    ros.spin_until(lambda: len(added) == 2 and removed)
    (moved,) = added[1].polygons
    assert (moved.uuid.uuid == added[0].polygons[0].uuid.uuid).all()
    assert outline(moved.points).bounds == pytest.approx((0.4, 0.0, 1.6, 0.8))
    (gone,) = removed[0].uuids
    assert (gone.uuid == added[0].polygons[1].uuid.uuid).all()


def test_without_the_server_nothing_is_sent(ros):
    node = ros.add(Node("surface_slam", context=ros.another_context()))
    shapes = VectorShapes(node, RosidlMessages())
    shapes.send(scene(TABLE))
    assert shapes._shown == {}


def test_mask_follows_removed_surfaces(ros):
    """The stool of the walkthrough is carried away after 12.3 s; its table stays."""
    tilt_node, node = tccm(ros), slam(ros)
    masks = Listener(ros).listen(OccupancyGrid, "/surface_slam/keepout_mask", latched=True)
    ros.connect(tilt_node, node, "/tccm/surfaces", "/tccm/view", "/tccm/object_boxes")
    world = json.loads((WALKTHROUGH / "truth.json").read_text())
    (stool,) = world["gone"]
    table = max((s for s in world["surfaces"] if "table" in s["label"]), key=lambda s: s["area"])

    def blocks(top):
        """Return whether the newest mask has the middle of a true top."""
        info = masks[-1].info
        x, y = np.mean(np.array(top["boundary"])[:, :2], axis=0)
        column = int((x - info.origin.position.x) / info.resolution)
        row = int((y - info.origin.position.y) / info.resolution)
        inside = 0 <= row < info.height and 0 <= column < info.width
        return inside and masks[-1].data[row * info.width + column] == 100

    play_bag(ros, WALKTHROUGH, tilt_node, node, duration=LEAVES_S)
    ros.spin_until(lambda: masks and blocks(stool) and blocks(table), what="both in the mask")
    play_bag(ros, WALKTHROUGH, tilt_node, node, start=LEAVES_S)
    ros.spin_until(lambda: blocks(table) and not blocks(stool), what="the mask without the stool")
    assert len(masks) > 1
    assert masks[-1].header.frame_id == "map"
